"""Trajectories as files, read back, by evo too where it is installed."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mirrorcam.optics.geometry.transforms import rigid
from mirrorcam.optics.light_field.motion import TrackedPose, save_json, save_tum

TURN = Rotation.from_euler("xyz", [10.0, -20.0, 150.0], degrees=True).as_matrix()
LOST = TrackedPose(np.full((4, 4), np.nan), np.full((6, 6), np.nan), 0, False)
POSES = [
    TrackedPose(np.eye(4), np.zeros((6, 6)), 300, True),
    LOST,
    TrackedPose(rigid(TURN, [1200.0, -30.5, 7.25]), np.diag(np.arange(1.0, 7.0)), 250, False),
]


def test_tum_files_hold_metres_and_quaternions(tmp_path: Path) -> None:
    save_tum(tmp_path / "a.tum", [0.0, 0.5, 1.0], POSES)
    rows = np.loadtxt(tmp_path / "a.tum")
    assert rows.shape == (2, 8)
    assert rows[:, 0].tolist() == [0.0, 1.0]
    assert np.allclose(rows[1, 1:4], [1.2, -0.0305, 0.00725])
    assert np.allclose(Rotation.from_quat(rows[1, 4:]).as_matrix(), TURN, atol=1e-8)


def test_json_files_hold_all_that_is_known(tmp_path: Path) -> None:
    save_json(tmp_path / "a.json", ["a", "b", "c"], [0.0, 0.5, 1.0], POSES)
    read = json.loads((tmp_path / "a.json").read_text(encoding="utf-8"))
    assert read["schema"] == "mirrorcam.trajectory/1"
    assert [each["name"] for each in read["frames"]] == ["a", "b", "c"]
    assert read["frames"][1]["world_from_view"] is None
    assert read["frames"][1]["covariance"] is None
    assert np.array_equal(read["frames"][2]["world_from_view"], POSES[2].world_from_view)
    assert np.array_equal(read["frames"][2]["covariance"], POSES[2].covariance)


def test_evo_reads_it(tmp_path: Path) -> None:
    file_interface = pytest.importorskip("evo.tools.file_interface", reason="evo is not installed")
    save_tum(tmp_path / "a.tum", [0.0, 0.5, 1.0], POSES)
    read = file_interface.read_tum_trajectory_file(tmp_path / "a.tum")
    assert read.num_poses == 2
    assert read.check()[0]
    assert np.allclose(read.poses_se3[1][:3, :3], TURN)
    assert read.path_length == pytest.approx(np.linalg.norm([1.2, -0.0305, 0.00725]))
