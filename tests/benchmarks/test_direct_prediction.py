"""Mirrored corners are predicted without having been seen."""

from __future__ import annotations

import numpy as np

from benchmarks.direct_prediction import predicted_mirrored
from mirrorcam.optics.calibration.solver.observations import DIRECT, Observations
from mirrorcam.optics.calibration.solver.parameterisation import Model
from mirrorcam.optics.calibration.solver.residuals import Board, Estimate
from mirrorcam.optics.geometry.mirror import reflect
from mirrorcam.optics.geometry.transforms import transform
from tests.optics.calibration.direct.two_mirrors import BOARD, CAMERA, POSES, corner_of_two_mirrors, lying

CORNERS = BOARD.corners_in_board_mm


def observed(estimate: Estimate, noise_px: float) -> Observations:
    random = np.random.default_rng(0)
    parts = []
    for frame, pose in enumerate(estimate.rig_from_board):
        points = transform(pose, CORNERS)
        for view in (DIRECT, 0, 1):
            seen = points if view == DIRECT else reflect(points, estimate.virtual_centres_in_rig_mm[view])
            pixels = CAMERA.project(seen) + noise_px * random.standard_normal((len(points), 2))
            parts.append(Observations.of_view(frame, view, np.arange(len(points)), pixels))
    return Observations.join(parts)


def test_mirrored_views_are_predicted_without_having_been_seen() -> None:
    poses = np.array([lying(*pose) for pose in POSES])
    truth = Estimate.of(CAMERA, corner_of_two_mirrors(80.0).mirrors, poses)
    rows = observed(truth, noise_px=0.02)
    model = Model(("fx_px", "fy_px"), thickness=False, curvature=False, board=Board.rigid(CORNERS))
    errors, _ = predicted_mirrored(truth, rows, model, np.arange(len(POSES)))
    assert np.isnan(errors[rows.view == DIRECT]).all()
    fair = errors[rows.view != DIRECT]
    assert 0.02 < np.sqrt(np.mean(fair**2)) < 0.3

    wrong = np.array(rows.pixels)
    left_out = (rows.frame == 2) & (rows.view == 1)
    wrong[left_out] += 5.0
    moved = Observations(rows.frame, rows.view, rows.corner, wrong)
    predicted, _ = predicted_mirrored(truth, moved, model, np.arange(len(POSES)))
    np.testing.assert_allclose(predicted[left_out], errors[left_out] - 5.0, atol=1e-6)
