"""Corners handed to mrcal in another interpreter; what needs mrcal is skipped where no interpreter has it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from benchmarks.calibration_mrcal import cameras_m, centres_of, reflection, task_of
from benchmarks.referees.mrcal_runner import python_with_mrcal, run_solver
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.boards import Checkerboard
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.transforms import rigid, transform
from tests.optics.layouts import faceted_parabola

CAMERA = Camera(width_px=960, height_px=540, fx_px=680.0, fy_px=684.0, cx_px=474.0, cy_px=271.0)
LAYOUT = faceted_parabola(CAMERA, DesignSpec(camera=CAMERA, rows=2, cols=2), fill=0.92)
BOARD = Checkerboard(cols=9, rows=7, square_mm=8.0)


def poses() -> list[FloatArray]:
    """Poses, rig_from_board, of boards before the mirrors."""
    random, half = np.random.default_rng(3), np.array([*BOARD.size_mm, 0.0]) / 2.0
    made = []
    for _ in range(14):
        turn = Rotation.from_rotvec(random.normal(0.0, 0.3, 3)).as_matrix()
        centre = np.array([*random.uniform(-15.0, 15.0, 2), random.uniform(150.0, 300.0)])
        made.append(rigid(LAYOUT.view_from_rig.T @ turn, LAYOUT.view_from_rig.T @ (centre - turn @ half)))
    return made


@pytest.fixture(scope="module")
def table(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Exact corners of boards in all mirrors."""
    lines = ["picture,view,corner,x_px,y_px"]
    for number, pose in enumerate(poses()):
        points = transform(pose, BOARD.corners_in_board_mm)
        for index, name in enumerate(LAYOUT.mirror_names):
            for corner, (x, y) in enumerate(LAYOUT.project(points, index).tolist()):
                if 0.0 <= x < CAMERA.width_px and 0.0 <= y < CAMERA.height_px:
                    lines.append(f"{number},{name},{corner},{x!r},{y!r}")
    path = tmp_path_factory.mktemp("corners") / "corners.csv"
    path.write_text("\n".join(lines))
    return path


def test_poses_of_mirrors_are_rigid_and_show_what_the_mirrors_show() -> None:
    centres = centres_of(LAYOUT)
    points = transform(poses()[0], BOARD.corners_in_board_mm)
    in_first_m = transform(reflection(centres[0]), points) / 1000.0
    for index, place in enumerate(np.array(cameras_m(centres))):
        assert np.linalg.det(place[:3, :3]) == pytest.approx(1.0)
        assert CAMERA.project(transform(place, in_first_m)) == pytest.approx(LAYOUT.project(points, index), abs=1e-9)


def test_mrcal_finds_the_camera_and_the_mirrors(table: Path) -> None:
    python = python_with_mrcal(None)
    if python is None:
        pytest.skip("no interpreter with mrcal")
    layout: Layout = LAYOUT.replaced(camera=CAMERA.replaced(fx_px=700.0, fy_px=700.0))
    lens = [*CAMERA.intrinsics[:4].tolist(), *[0.0] * 5]
    task = task_of(table, layout, BOARD) | {
        "lens": "LENSMODEL_OPENCV5",
        "calibrations": {"truth": {"lens": lens, "cameras": cameras_m(centres_of(LAYOUT))}},
    }
    answer = run_solver(python, task)
    found = answer["found"]["mrcal"]
    # mrcal draws lenses towards none at all by a weak prior, which is what is left of exact corners.
    assert found["lens"][:4] == pytest.approx(lens[:4], abs=0.05)
    first = answer["differences"][0]
    assert first["of"] == ["truth", "mrcal"]
    assert first["device_px"] < 0.01
