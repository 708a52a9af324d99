"""The result of a calibration with a direct view: figures for exact corners, notes, and outlines."""

from __future__ import annotations

import numpy as np
import pytest
from shapely import Polygon, contains_xy

from mirrorcam.optics.calibration.corner_calibration import calibration_of, fit_corners
from mirrorcam.optics.calibration.diagnostics.calibration_result import Calibration, layout_from_corners
from mirrorcam.optics.calibration.diagnostics.requested_model import RequestedModel
from mirrorcam.optics.calibration.direct.direct_result import with_direct_figures
from mirrorcam.optics.calibration.direct.motion import Shutter
from mirrorcam.optics.calibration.solver.observations import DIRECT, Observations
from mirrorcam.optics.calibration.solver.residuals import Estimate
from mirrorcam.optics.geometry.mirror import reflect
from mirrorcam.optics.geometry.transforms import transform
from tests.optics.calibration.direct.two_mirrors import BOARD, CAMERA, POSES, corner_of_two_mirrors, lying

CORNERS = BOARD.corners_in_board_mm
TURNS = np.array([[0.0, 0.0, 0.0], [1e-3, 0.0, 0.0], [0.0, 2e-3, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 5e-4]])


@pytest.fixture(scope="module")
def result() -> Calibration:
    """Five of six frames, the fourth without a board; mirror 1 shows no board in the first and half in the second."""
    truth = corner_of_two_mirrors(80.0)
    poses = np.array([lying(*pose) for pose in POSES])
    random = np.random.default_rng(0)
    frames = []
    for frame, pose in enumerate(poses):
        points = transform(pose, CORNERS)
        parts = []
        for view in (DIRECT, 0, 1):
            seen = points if view == DIRECT else reflect(points, truth.mirrors[view].virtual_centre_in_rig_mm)
            ids = np.arange(len(CORNERS) // (2 if (frame, view) == (1, 1) else 1))
            if (frame, view) != (0, 1):
                pixels = CAMERA.project(seen)[ids] + random.normal(0.0, 0.05, (len(ids), 2))
                parts.append(Observations.of_view(0, view, ids, pixels))
        frames.append(Observations.join(parts))
    joined = Observations.join([rows.with_frame_offset(number) for number, rows in enumerate(frames)])
    layout = layout_from_corners(Estimate.of(CAMERA, truth.mirrors, poses), joined)
    frames.insert(3, Observations.empty())
    names = [f"{number}.png" for number in range(6)]
    fitted = fit_corners(frames, [], layout, CORNERS, model=RequestedModel(), names=names, is_designed=False)
    return with_direct_figures(calibration_of(fitted, layout), TURNS, Shutter(0.6, 0.01, supported=True))


def test_figures_match_the_scene(result: Calibration) -> None:
    metrics = result.metrics
    sigma = metrics["mirrors_0_1_angle_sigma_deg"].value
    assert metrics["mirrors_0_1_angle_deg"].value == pytest.approx(100.0, abs=4.0 * sigma), "between the normals"
    assert metrics["rms_x_px"].value == pytest.approx(0.05, rel=0.15)
    assert metrics["camera_turned_px"].value == pytest.approx(2e-3 * result.layout.camera.fx_px)
    assert metrics["shutter_readout"].value == 0.6
    assert "sheet_mm" not in metrics
    assert "board_warp_rms_mm" not in metrics


def test_missing_boards_are_noted(result: Calibration) -> None:
    assert "3.png: no board found, not used" in result.notes
    assert "0.png: no board found in mirror 0-1" in result.notes
    assert any(note.startswith("a rolling shutter reads a frame in 0.60 ") for note in result.notes)
    assert result.pictures == ("0.png", "1.png", "2.png", "4.png", "5.png")


def test_mirrors_are_cut_to_the_corners_seen_in_them(result: Calibration) -> None:
    rows = result.observations
    for mirror in range(2):
        outline = Polygon(result.layout.outline_px(mirror)).buffer(2.0)
        pixels = rows.pixels[result.inliers & (rows.view == mirror)]
        assert contains_xy(outline, *pixels.T).all()
        assert outline.area < 1.5 * Polygon(pixels).convex_hull.area


def test_the_layout_carries_level_metrics_and_covariance(result: Calibration) -> None:
    assert result.layout.kind == "calibrated"
    assert result.layout.provenance["level"] == "joint"
    assert result.layout.metrics == result.metrics
    assert result.layout.uncertainty is not None
    intrinsics = CAMERA.intrinsic_names
    assert result.layout.uncertainty.parameters[: len(intrinsics)] == intrinsics
