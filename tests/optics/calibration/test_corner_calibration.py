"""Calibration from corners: omissions, refusals, and refinement once the mirrors are nearly known."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import pytest

from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration import corner_calibration
from mirrorcam.optics.calibration.corner_calibration import calibrate_corners
from mirrorcam.optics.calibration.diagnostics.requested_model import RequestedModel
from mirrorcam.optics.calibration.pupil_estimate import BoardPictures
from mirrorcam.optics.calibration.solver.observations import Observations
from mirrorcam.optics.geometry.boards import CalibrationBoard
from mirrorcam.optics.geometry.layout import Layout
from tests.optics.calibration.sound_calibration import BOARD, board_poses, nominal_layout, true_layout
from tests.optics.calibration.synthetic_corners import Views, views_of

CORNERS_MM = BOARD.corners_in_board_mm


@pytest.fixture(scope="module")
def views() -> Views:
    return views_of(true_layout(), BOARD, *board_poses(), noise_px=0.05)


def worst_deg(a: Layout, b: Layout) -> float:
    """Return the largest angle between corresponding mirrors of two layouts, in degrees."""
    crosses = np.cross([m.normal_in_rig for m in a.mirrors], [m.normal_in_rig for m in b.mirrors])
    return float(np.degrees(np.linalg.norm(crosses, axis=1)).max())


def test_a_frame_without_a_board_is_named_and_left_out(views: Views) -> None:
    found = calibrate_corners([Observations.empty(), *views.mirrored[:5]], views.base, nominal_layout(), CORNERS_MM)
    assert "frame 0: no board found, not used" in found.notes
    assert len(found.rig_from_board) == 5 + len(views.base)


def test_missing_base_frames_are_noted(views: Views) -> None:
    found = calibrate_corners(views.mirrored, [], nominal_layout(), CORNERS_MM)
    assert any("no frame without mirrors" in note for note in found.notes)
    assert worst_deg(found.layout, true_layout()) < 0.2


def test_one_frame_of_one_mirror_does_not_determine_a_camera(views: Views) -> None:
    seen, nominal = views.mirrored[0], nominal_layout()
    alone = nominal.replaced(rows=1, cols=1, mirrors=nominal.mirrors[:1])
    with pytest.raises(InputError, match="one mirror without a direct view of the board, expected two or more"):
        calibrate_corners([seen.where(seen.view == 0)], [], alone, CORNERS_MM)


@pytest.mark.slow
def test_corners_in_second_surface_mirrors_are_refined_with_the_estimated_mirrors(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    nominal, true = (layout.with_surface("second", 2.0) for layout in (nominal_layout(), true_layout()))
    views = views_of(true, BOARD, *board_poses(), noise_px=0.05)
    requests: list[tuple[Layout, Mapping[int, FloatArray]]] = []

    def shifted(
        seen: Sequence[Observations],
        pictures: Sequence[object],
        poses: Mapping[int, FloatArray],
        layout: Layout,
        board: CalibrationBoard,
        *,
        workers: int,
    ) -> list[Observations]:
        assert (len(seen), board, workers) == (len(pictures), BOARD, 3)
        requests.append((layout, poses))
        return [replace(rows, pixels=rows.pixels + np.array([0.0, 0.25])) for rows in seen]

    monkeypatch.setattr(corner_calibration, "refine_with_ghosts", shifted)
    blank = np.zeros((nominal.camera.height_px, nominal.camera.width_px), dtype=np.uint8)
    pictures = BoardPictures([blank] * (len(views.mirrored) - 1) + [None], BOARD, workers=3)
    found = calibrate_corners(
        views.mirrored, views.base, nominal, CORNERS_MM, model=RequestedModel(), pictures=pictures
    )
    ((layout, poses),) = requests
    assert worst_deg(layout, true) < 0.2 * worst_deg(nominal, true)
    assert set(range(len(views.mirrored))) <= set(poses)
    plain = calibrate_corners(views.mirrored, views.base, nominal, CORNERS_MM, model=RequestedModel())
    mirrored = found.observations.view >= 0
    assert np.mean(found.observations.pixels[mirrored, 1]) - np.mean(
        plain.observations.pixels[plain.observations.view >= 0, 1]
    ) == pytest.approx(0.25, abs=0.05)
    lost = f"frame {len(views.mirrored) - 1}: not kept in memory"
    assert [note for note in found.notes if lost in note]


@pytest.mark.slow
def test_a_rational_lens_of_the_layout_is_calibrated_even_if_five_numbers_suffice() -> None:
    rational = true_layout().camera.replaced(
        lens_model="rational", distortion=[0.35, -0.13, 1e-4, -5e-4, 0.01, 0.45, -0.05, 0.02]
    )
    nominal = nominal_layout().replaced(
        camera=nominal_layout().camera.replaced(lens_model="rational", distortion=rational.distortion)
    )
    noise_px = 0.0008
    views = views_of(true_layout().replaced(camera=rational), BOARD, *board_poses(), noise_px=noise_px)
    seen, base = (
        [replace(rows, sigma_px=np.full(len(rows), noise_px)) for rows in frames]
        for frames in (views.mirrored, views.base)
    )
    found = calibrate_corners(seen, base, nominal, CORNERS_MM)
    assert found.diagnostics is not None
    assert (found.diagnostics.model_name, found.diagnostics.alarms) == ("joint", ())
    assert found.layout.camera.fx_px == pytest.approx(rational.fx_px, abs=0.2)
