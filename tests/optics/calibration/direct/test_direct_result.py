"""The result of a calibration with a direct view: figures for exact corners, notes, and outlines."""

from __future__ import annotations

import numpy as np
import pytest
from shapely import Polygon, contains_xy

from mirrorcam.optics.calibration.diagnostics.calibration_result import Calibration
from mirrorcam.optics.calibration.diagnostics.model_comparison import smallest_model
from mirrorcam.optics.calibration.diagnostics.model_selection import finished_selection
from mirrorcam.optics.calibration.diagnostics.nested_models import fit_as
from mirrorcam.optics.calibration.direct.direct_result import direct_result
from mirrorcam.optics.calibration.direct.direct_view import INTRINSICS
from mirrorcam.optics.calibration.solver.observations import DIRECT, Observations
from mirrorcam.optics.calibration.solver.parameterisation import Model
from mirrorcam.optics.calibration.solver.residuals import Board, Estimate
from mirrorcam.optics.geometry.mirror import reflect
from mirrorcam.optics.geometry.transforms import transform
from tests.optics.calibration.direct.two_mirrors import BOARD, CAMERA, POSES, corner_of_two_mirrors, lying

CORNERS = BOARD.corners_in_board_mm
TURNS = np.array([[0.0, 0.0, 0.0], [1e-3, 0.0, 0.0], [0.0, 2e-3, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 5e-4]])


@pytest.fixture(scope="module")
def result() -> Calibration:
    """Five of six pictures, the fourth without a board; mirror 1 shows no board in the first and half in the second."""
    truth = corner_of_two_mirrors(80.0)
    poses = np.array([lying(*pose) for pose in POSES])
    random = np.random.default_rng(0)
    parts = []
    for frame, pose in enumerate(poses):
        points = transform(pose, CORNERS)
        for view in (DIRECT, 0, 1):
            seen = points if view == DIRECT else reflect(points, truth.mirrors[view].virtual_centre_in_rig_mm)
            ids = np.arange(len(CORNERS) // (2 if (frame, view) == (1, 1) else 1))
            if (frame, view) != (0, 1):
                pixels = CAMERA.project(seen)[ids] + random.normal(0.0, 0.05, (len(ids), 2))
                parts.append(Observations.of_view(frame, view, ids, pixels))
    rows = Observations.join(parts)
    model = Model(INTRINSICS, thickness=False, curvature=False, board=Board.rigid(CORNERS))
    flat = fit_as("joint", Estimate.of(CAMERA, truth.mirrors, poses), rows, model)
    selection = finished_selection(flat, [smallest_model(flat)], rows)
    names = [f"{number}.png" for number in range(6)]
    return direct_result(selection, flat.solution, rows, pictures=[0, 1, 2, 4, 5], names=names, rotations=TURNS)


def test_figures_match_the_scene(result: Calibration) -> None:
    metrics = result.metrics
    sigma = metrics["mirrors_0_1_angle_sigma_deg"].value
    assert metrics["mirrors_0_1_angle_deg"].value == pytest.approx(100.0, abs=4.0 * sigma), "between the normals"
    assert metrics["views"].value == 14
    assert metrics["flat_board_rms_x_px"].value == metrics["rms_x_px"].value == pytest.approx(0.05, rel=0.15)
    assert metrics["board_shift_in_plane_rms_mm"].value == metrics["board_warp_rms_mm"].value == 0.0
    assert metrics["camera_turned_px"].value == pytest.approx(2e-3 * result.layout.camera.fx_px)
    assert "sheet_mm" not in metrics
    # Corners of direct views state no noise, so that there are no relative residuals.
    assert "residual_scale" not in metrics
    np.testing.assert_allclose(result.corner_sigma_px, metrics["sigma_px"].value)


def test_missing_boards_are_noted(result: Calibration) -> None:
    assert result.notes == (
        "3.png: no board found, not used",
        "0.png: mirror 0-1 not found",
        "1.png: mirror 0-1 shows 21 of 42 corners",
    )


def test_mirrors_are_cut_to_the_corners_seen_in_them(result: Calibration) -> None:
    rows = result.observations
    for mirror in range(2):
        outline = Polygon(result.layout.outline_px(mirror)).buffer(0.5)
        pixels = rows.pixels[result.inliers & (rows.view == mirror)]
        assert contains_xy(outline, *pixels.T).all()
        assert outline.area < 1.5 * Polygon(pixels).convex_hull.area


def test_the_layout_carries_level_metrics_and_covariance(result: Calibration) -> None:
    assert result.layout.kind == "calibrated"
    assert result.layout.provenance["level"] == "joint"
    assert result.layout.metrics == result.metrics
    assert result.layout.uncertainty is not None
    assert result.layout.uncertainty.parameters[: len(INTRINSICS)] == INTRINSICS
