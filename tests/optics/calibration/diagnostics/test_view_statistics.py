"""Statistics of the views of a calibration, against the simulated boards."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mirrorcam.optics.calibration.diagnostics.calibration_result import Calibration
from mirrorcam.optics.calibration.diagnostics.view_statistics import board_normals, cell_means, view_figures
from mirrorcam.optics.calibration.solver.observations import DIRECT, Observations
from mirrorcam.optics.geometry.transforms import transform
from tests.optics.calibration.sound_calibration import (
    BOARD,
    board_poses,
    sound_calibration,
    true_layout,
)


@pytest.fixture
def calibration() -> Calibration:
    return sound_calibration()


def test_distances_and_tilts_match_the_board(calibration: Calibration) -> None:
    """Against the true poses and virtual centres; the calibration's error is far below the tolerance."""
    seen = calibration.observations
    for view in view_figures(calibration):
        centre = np.zeros(3) if view.view == DIRECT else true_layout().virtual_centres_in_rig_mm[view.view]
        for frame, distance, tilt in zip(
            np.unique(seen.frame[seen.view == view.view]), view.distances_mm, view.tilts_deg, strict=True
        ):
            pose = [*board_poses()[0], *board_poses()[1]][frame]
            corners = seen.corner[(seen.view == view.view) & (seen.frame == frame)]
            rays = transform(pose, BOARD.corners_in_board_mm[corners]) - centre
            lengths = np.linalg.norm(rays, axis=1)
            assert distance == pytest.approx(np.median(lengths), rel=2e-3)
            cosines = np.abs(rays @ pose[:3, 2]) / lengths
            assert tilt == pytest.approx(np.median(np.degrees(np.arccos(cosines))), abs=0.3)


def test_the_view_without_a_mirror_is_named(calibration: Calibration) -> None:
    *mirrors, bare = view_figures(calibration)
    assert [view.name_in_sentence for view in mirrors] == [f"mirror {name}" for name in calibration.layout.mirror_names]
    assert (bare.name, bare.name_in_sentence) == ("bare camera", "the bare camera")
    seen = calibration.observations
    in_one = seen.where((seen.frame == 0) | (seen.view == DIRECT))
    both = Observations(np.zeros(len(in_one), dtype=np.int64), in_one.view, in_one.corner, in_one.pixels)
    used = (seen.frame == 0) | (seen.view == DIRECT)
    together = replace(
        calibration, observations=both, inliers=calibration.inliers[used], residuals_px=calibration.residuals_px[used]
    )
    assert view_figures(together)[-1].name_in_sentence == "the direct view"


def test_normals_are_in_view_axes_before_mirrors_only(calibration: Calibration) -> None:
    normals, mirrored = board_normals(calibration)
    assert mirrored.tolist() == [True] * 12 + [False] * 5
    expected = [calibration.layout.view_from_rig @ pose[:3, 2] for pose in board_poses()[0]]
    np.testing.assert_allclose(normals[:12], expected, atol=1e-3)
    np.testing.assert_allclose(normals[12:], [pose[:3, 2] for pose in board_poses()[1]], atol=1e-3)
    assert (normals[:, 2] > 0.5).all()


def test_cells_of_noise_are_seldom_systematic_and_shifted_ones_are(calibration: Calibration) -> None:
    random = np.random.default_rng(0)
    sigma = 0.05
    sigmas_px = np.where(calibration.observations.corner % 3 == 0, 4.0 * sigma, sigma)
    unlike = replace(
        calibration,
        observations=replace(calibration.observations, sigma_px=sigmas_px),
        residual_scale=1.0,
    )
    noise = sigmas_px[:, None] * random.normal(0.0, 1.0, (40, *calibration.residuals_px.shape))
    found = [cell_means(replace(unlike, residuals_px=residuals), 0).systematic.mean() for residuals in noise]
    assert np.mean(found) == pytest.approx(0.01, abs=0.003)
    shifted = replace(unlike, residuals_px=noise[0] + 10.0 * sigma)
    assert cell_means(shifted, 0).systematic.mean() > 0.95
