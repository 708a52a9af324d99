"""What is handed to mrcal and how its covariance is read; its own run is skipped where no interpreter has it."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from benchmarks.calibrators import mrcal_joint
from benchmarks.calibrators.mrcal_joint import calibrate_set, covariance_of, left_jacobian
from benchmarks.calibrators.set_corners import DetectedBoard, SetCorners
from benchmarks.referees.mrcal_runner import python_with_mrcal
from mirrorcam.bench.scores.calibration_score import score_calibration
from mirrorcam.bench.scores.consistency import with_covariance
from mirrorcam.core.disk.files import write_text
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.camera_files.read.registry import read_rig
from mirrorcam.optics.camera_files.write.virtual_cameras import virtual_cameras
from mirrorcam.optics.geometry.boards import Checkerboard
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.transforms import inverse, rigid, transform
from tests.optics.layouts import faceted_parabola

CAMERA = Camera(width_px=960, height_px=540, fx_px=680.0, fy_px=684.0, cx_px=474.0, cy_px=271.0)
LAYOUT = faceted_parabola(CAMERA, DesignSpec(camera=CAMERA, rows=2, cols=2), fill=0.92)
BOARD = Checkerboard(cols=9, rows=7, square_mm=8.0)
NOISE_PX = 0.02


@pytest.mark.parametrize("turn", [[0.3, -1.2, 0.4], [1e-9, 0.0, 0.0], [2.0, 1.0, -1.5]])
def test_a_change_of_a_rodrigues_vector_is_a_turn_on_the_left(turn: list[float]) -> None:
    at, jacobian, step = np.array(turn), left_jacobian(np.array(turn)), 1e-6
    before = Rotation.from_rotvec(at)
    for axis in np.eye(3):
        moved = (Rotation.from_rotvec(at + step * axis) * before.inv()).as_rotvec() / step
        assert moved == pytest.approx(jacobian @ axis, abs=1e-5)


def test_shifts_become_millimetres_and_the_lens_stays() -> None:
    """Against finite differences of a place: turned about the camera, then shifted."""
    turn, shift_m, step = np.array([0.1, 0.2, -0.3]), np.array([1.0, 2.0, 3.0]), 1e-6
    place = rigid(Rotation.from_rotvec(turn).as_matrix(), shift_m)
    found = covariance_of(np.eye(4 + 6), np.array([np.eye(4), place]), 4)
    slopes = np.empty((6, 6))
    for number, change in enumerate(step * np.eye(6)):
        moved = rigid(Rotation.from_rotvec(turn + change[:3]).as_matrix(), shift_m + change[3:]) @ inverse(place)
        slopes[:3, number] = Rotation.from_matrix(moved[:3, :3]).as_rotvec() / step
        slopes[3:, number] = 1000.0 * moved[:3, 3] / step
    assert found[:4, :4] == pytest.approx(np.eye(4))
    assert found[:4, 4:] == pytest.approx(np.zeros((4, 6)))
    assert found[4:, 4:] == pytest.approx(slopes @ slopes.T, rel=1e-4, abs=1.0)


def seen_corners() -> SetCorners:
    """Corners with a little noise of boards in all views, in the flipped frame."""
    random, half = np.random.default_rng(3), np.array([*BOARD.size_mm, 0.0]) / 2.0
    views, seen = virtual_cameras(LAYOUT), {}
    for frame in range(14):
        turn = Rotation.from_rotvec(random.normal(0.0, 0.3, 3)).as_matrix()
        centre = np.array([*random.uniform(-15.0, 15.0, 2), random.uniform(150.0, 300.0)])
        pose = rigid(LAYOUT.view_from_rig.T @ turn, LAYOUT.view_from_rig.T @ (centre - turn @ half))
        points = transform(pose, BOARD.corners_in_board_mm)
        for number in range(len(views)):
            pixels: FloatArray = np.array(LAYOUT.project(points, number))
            pixels[:, 0 if views[0].flip == "left-right" else 1] *= -1.0
            pixels[:, 0 if views[0].flip == "left-right" else 1] += (
                CAMERA.width_px if views[0].flip == "left-right" else CAMERA.height_px
            ) - 1
            inside = ((pixels >= 0.0) & (pixels < [CAMERA.width_px, CAMERA.height_px])).all(axis=1)
            if inside.sum() >= 12:
                noisy = pixels[inside] + random.normal(0.0, NOISE_PX, (int(inside.sum()), 2))
                seen[frame, number] = DetectedBoard(np.flatnonzero(inside), noisy)
    return SetCorners(
        names=tuple(view.name for view in views),
        flip=views[0].flip,
        size_px=(CAMERA.width_px, CAMERA.height_px),
        matrix=views[0].camera.matrix,
        points_in_board=BOARD.corners_in_board_mm,
        seen=seen,
    )


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A set of which the corners are known without pictures."""
    LAYOUT.save(tmp_path / "layout.json")
    write_text(tmp_path / "board.toml", 'kind = "checkerboard"\ncols = 9\nrows = 7\nsquare_mm = 8.0\n')
    monkeypatch.setattr(mrcal_joint, "corners_of_set", lambda folder: seen_corners())
    return tmp_path


def test_mrcal_finds_the_cameras_and_how_certain_they_are(folder: Path) -> None:
    python = python_with_mrcal(None)
    if python is None:
        pytest.skip("no interpreter here has mrcal (in Debian: python3-mrcal)")
    out, covariance = folder / "cameras.yaml", folder / "covariance.json"
    calibrate_set(folder, out, python, covariance)
    rig = with_covariance(read_rig(out), covariance)
    found = score_calibration(rig, LAYOUT, LAYOUT, 300.0).figures
    assert found["rms_px"].value < NOISE_PX
    assert 0.4 < found["nees"].value < 2.5
    assert len(json.loads(covariance.read_text())["parameters"]) == 9 + 6 * 3
