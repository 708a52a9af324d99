"""Devices with plates of another thickness than in the layout: the corners determine the true one."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.optics.calibration.diagnostics.model_selection import select_model
from mirrorcam.optics.calibration.solver import initial_estimates
from mirrorcam.optics.calibration.solver.observations import DIRECT, Observations
from mirrorcam.optics.geometry.boards import Charuco
from mirrorcam.optics.geometry.layout import Layout
from tests.optics.calibration.synthetic_corners import as_built, direct_poses, mirrored_poses, views_of

BOARD = Charuco(cols=12, rows=8, square_mm=20.0, marker_mm=14.0)
CORNERS = BOARD.corners_in_board_mm
NOMINAL_MM, SPREAD_MM = 2.0, 0.1


def off_in_sigmas(nominal: Layout, seed: int) -> float:
    """Return the error of the thickness estimated for a device of other plates, in standard deviations."""
    thickness = NOMINAL_MM + SPREAD_MM * float(np.random.default_rng(seed).choice([-1.5, -1.0, 1.0, 1.5]))
    plates = [m.replaced(surface="second", thickness_mm=NOMINAL_MM) for m in nominal.mirrors]
    nominal = nominal.replaced(mirrors=tuple(plates))
    truth = as_built(nominal, seed=seed)
    truth = truth.replaced(mirrors=tuple(m.replaced(thickness_mm=thickness) for m in truth.mirrors))
    mirrored, direct = (
        mirrored_poses(BOARD, 8, tilt_deg=30.0, seed=seed),
        direct_poses(BOARD, 5, tilt_deg=35.0, seed=seed),
    )
    views = views_of(truth, BOARD, mirrored, direct, noise_px=0.02, seed=seed)
    frames = [o for o in [*views.mirrored, *views.base] if len(o)]
    rows = Observations.join([o.with_frame_offset(place) for place, o in enumerate(frames)])
    camera = initial_estimates.base_camera(rows.where(rows.view == DIRECT), nominal.camera, CORNERS)
    reached = select_model(initial_estimates.first_estimate(rows, camera, nominal, CORNERS), rows, CORNERS)
    assert reached.model_name == "joint+sheet", f"seed {seed}"
    place = reached.solution.parameters.index("sheet_mm")
    sigma = float(np.sqrt(reached.solution.covariance[place, place]))
    assert sigma < SPREAD_MM / 4.0, "otherwise the test proves nothing"
    return (float(reached.solution.estimate.thickness_mm[0]) - thickness) / sigma


@pytest.mark.slow
def test_the_thickness_of_another_plate_is_found_within_its_sigma(fold_90_layout: Layout) -> None:
    assert max(abs(off_in_sigmas(fold_90_layout, seed)) for seed in (0, 1)) < 3.0


@pytest.mark.slow
def test_the_thickness_of_20_other_plates_is_found_within_three_sigmas(fold_90_layout: Layout) -> None:
    off = np.array([off_in_sigmas(fold_90_layout, seed) for seed in range(20)])
    assert np.abs(off).max() < 3.0
    assert 0.6 < np.sqrt(np.mean(off**2)) < 1.5
