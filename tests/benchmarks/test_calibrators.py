"""Calibrators of OpenCV's functions: of exact corners they find the true device, of rendered ones nearly so."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.calibrators import opencv_joint, opencv_per_view
from benchmarks.calibrators.set_corners import DetectedBoard, SetCorners
from benchmarks.calibrators.view_poses import mean_pose, write_cameras
from mirrorcam.bench.scores.consistency import with_covariance
from mirrorcam.optics.camera_files.read.registry import read_rig
from mirrorcam.optics.camera_files.write.virtual_cameras import virtual_cameras
from mirrorcam.optics.geometry.boards import Charuco
from mirrorcam.optics.geometry.transforms import inverse, rigid, transform
from tests.optics.camera_files.rigs import device

BOARD = Charuco(cols=10, rows=8, square_mm=14.0, marker_mm=10.0)


def corners(noise_px: float = 0.0) -> SetCorners:
    """All corners of ten boards in all views of the true device, in the flipped frame."""
    views, nominal = virtual_cameras(device().truth), virtual_cameras(device().nominal)
    random = np.random.default_rng(4)
    middle = BOARD.corners_in_board_mm.mean(axis=0)
    seen = {}
    for frame in range(10):
        turn = Rotation.from_rotvec(random.uniform(-0.5, 0.5, 3)).as_matrix()
        place = random.uniform([-40.0, -40.0, 320.0], [40.0, 40.0, 480.0])
        in_view = (BOARD.corners_in_board_mm - middle) @ turn.T + place
        in_rig = transform(inverse(views[4].camera_from_rig), in_view)
        for number, view in enumerate(views):
            pixels = view.project(in_rig)
            pixels = pixels + noise_px * random.normal(size=pixels.shape)
            seen[frame, number] = DetectedBoard(np.arange(len(pixels)), pixels)
    return SetCorners(
        names=tuple(view.name for view in views),
        flip=views[0].flip,
        size_px=(960, 600),
        matrix=nominal[0].camera.matrix + np.diag([20.0, -15.0, 0.0]),
        points_in_board=BOARD.corners_in_board_mm,
        seen=seen,
    )


def test_the_joint_one_finds_the_true_device_from_exact_corners(tmp_path: Path) -> None:
    exact = corners()
    cameras, names, covariance = opencv_joint.calibrate_joint(exact)
    write_cameras(tmp_path / "joint.yaml", cameras, exact.size_px, exact.flip)
    found = device().score(read_rig(tmp_path / "joint.yaml"))
    assert found.figures["max_px"].value < 1e-6
    assert found.figures["triangulation_max_mm"].value < 1e-6
    assert covariance.shape == (len(names), len(names)) == (8 + 5 * 6,) * 2


def test_the_joint_one_knows_how_wrong_it_is(tmp_path: Path) -> None:
    noisy = corners(noise_px=0.05)
    cameras, names, covariance = opencv_joint.calibrate_joint(noisy)
    write_cameras(tmp_path / "joint.yaml", cameras, noisy.size_px, noisy.flip)
    stated = {"schema": "mirrorcam.covariance/1", "parameters": list(names), "covariance": covariance.tolist()}
    (tmp_path / "c.json").write_text(json.dumps(stated))
    nees = device().score(with_covariance(read_rig(tmp_path / "joint.yaml"), tmp_path / "c.json")).nees
    assert nees is not None
    assert nees.freedom == len(names)  # the reference is held, so that nothing of it is the rig's motion
    assert 0.5 < nees.mean < 1.8


def test_the_separate_one_finds_the_true_device_from_exact_corners(tmp_path: Path) -> None:
    exact = corners()
    write_cameras(tmp_path / "a.yaml", opencv_per_view.calibrate_per_view(exact), exact.size_px, exact.flip)
    found = device().score(read_rig(tmp_path / "a.yaml"))
    assert found.figures["max_px"].value < 0.05  # calibrateCamera takes float32
    assert found.figures["baseline_error_max_mm"].value < 0.5


def test_poses_far_from_the_others_are_left_out_of_the_mean() -> None:
    random = np.random.default_rng(0)
    poses = [
        rigid(Rotation.from_rotvec([0.1, 0.2, 0.3 + 1e-3 * random.normal()]).as_matrix(), random.normal(size=3) + 50.0)
        for _ in range(20)
    ]
    poses[3] = rigid(np.diag([1.0, -1.0, -1.0]), [500.0, 0.0, 0.0])
    found = mean_pose(np.array(poses))
    expected = Rotation.from_rotvec([0.1, 0.2, 0.3])
    assert (Rotation.from_matrix(found[:3, :3]) * expected.inv()).magnitude() < 1e-3
    np.testing.assert_allclose(found[:3, 3], 50.0, atol=1.0)
