"""Tracked poses of a rendered light field camera: accuracy, covariances, and loss of tracking."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.transforms import inverse, rigid
from mirrorcam.optics.light_field.light_field import LightField
from mirrorcam.optics.light_field.motion import LightFieldTracker, TrackedPose, save_json, save_tum
from mirrorcam.optics.light_field.motion import tracker as tracking
from mirrorcam.optics.light_field.motion.tracker import adjoint
from tests.optics.light_field.relief_scene import Card, Relief, even_views, light_field_of

SIZE: dict[str, Any] = {"width_px": 200, "height_px": 150, "focal_px": 330.0, "centre_px": np.array([99.5, 74.5])}
TURN = Rotation.from_euler("xyz", [10.0, -20.0, 150.0], degrees=True).as_matrix()
LOST = TrackedPose(np.full((4, 4), np.nan), np.full((6, 6), np.nan), 0, False)
POSES = [
    TrackedPose(np.eye(4), np.zeros((6, 6)), 300, True),
    LOST,
    TrackedPose(rigid(TURN, [1200.0, -30.5, 7.25]), np.diag(np.arange(1.0, 7.0)), 250, False),
]


def true_poses() -> list[FloatArray]:
    turns = [[0.0, 0.0, 0.0], [0.4, 0.5, 0.6], [0.8, 1.2, 1.0], [1.0, 2.0, 1.4], [8.0, -4.0, 10.0]]
    places = [[0.0, 0.0, 0.0], [6.0, 2.0, 3.0], [13.0, 3.0, 6.0], [21.0, 3.0, 8.0], [70.0, -30.0, 30.0]]
    return [
        rigid(Rotation.from_euler("yxz", turn, degrees=True).as_matrix(), place)
        for turn, place in zip(turns, places, strict=True)
    ]


@pytest.fixture(scope="module")
def filmed() -> list[LightField]:
    scene = Relief(slants=(0.0, -0.1), cards=(Card(400.0, (-60.0, -50.0, -20.0, 0.0)),))
    views = even_views(3, 10.0, **SIZE)
    return [
        light_field_of(scene, views, world_from_view=pose, seed=number, subsamples=1)[0]
        for number, pose in enumerate(true_poses())
    ]


def squares(found: TrackedPose, true: FloatArray) -> float:
    off = inverse(found.world_from_view) @ true
    xi = np.concatenate([off[:3, 3], Rotation.from_matrix(off[:3, :3]).as_rotvec()])
    return float(xi @ np.linalg.solve(found.covariance, xi)) / 6.0


def test_poses_are_accurate_within_their_covariances(filmed: list[LightField]) -> None:
    """Even the last one, after a jump that the previous motion does not predict."""
    tracker = LightFieldTracker(filmed[0])
    found = [tracker.track(each) for each in filmed]
    assert np.array_equal(found[0].world_from_view, np.eye(4))
    assert found[0].is_key and not found[0].covariance.any()
    for each, true, most_mm in zip(found[1:], true_poses()[1:], [0.15, 0.15, 0.15, 0.8], strict=True):
        assert each.landmarks > 100
        assert np.linalg.norm(each.world_from_view[:3, 3] - true[:3, 3]) < most_mm
        assert squares(each, true) < 4.0


def test_key_frames_add_their_covariances(filmed: list[LightField], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tracking, "MIN_VISIBLE_FRACTION", 2.0)
    tracker = LightFieldTracker(filmed[0])
    found = [tracker.track(each) for each in filmed[:4]]
    assert all(each.is_key for each in found)
    traces = [np.trace(each.covariance[:3, :3]) for each in found]
    assert (np.diff(traces) > 0).all()
    assert np.linalg.norm(found[3].world_from_view[:3, 3] - true_poses()[3][:3, 3]) < 0.15


@pytest.mark.slow
def test_tracking_is_lost_in_another_scene_and_recovered(filmed: list[LightField]) -> None:
    other = light_field_of(Relief(seed=5), even_views(3, 10.0, **SIZE), subsamples=1)[0]
    tracker = LightFieldTracker(filmed[0])
    tracker.track(filmed[0])
    lost = tracker.track(other)
    assert lost.is_lost and lost.landmarks == 0 and not lost.is_key
    again = tracker.track(filmed[2])
    assert np.linalg.norm(again.world_from_view[:3, 3] - true_poses()[2][:3, 3]) < 0.15


def test_light_fields_of_other_views_are_refused(filmed: list[LightField]) -> None:
    tracker = LightFieldTracker(even_views(3, 11.0, **SIZE))
    with pytest.raises(InputError, match="differs in its views from layout"):
        tracker.track(filmed[0])


def test_the_adjoint_transforms_small_motions_to_another_frame() -> None:
    dst_from_src = true_poses()[4]
    xi = np.array([1e-4, -2e-4, 3e-4, 2e-6, 1e-6, -3e-6])
    small = rigid(Rotation.from_rotvec(xi[3:]).as_matrix(), xi[:3])
    there = dst_from_src @ small @ inverse(dst_from_src)
    expected = np.concatenate([there[:3, 3], Rotation.from_matrix(there[:3, :3]).as_rotvec()])
    assert np.allclose(adjoint(dst_from_src) @ xi, expected, atol=1e-8)


def test_tum_files_contain_metres_and_quaternions(tmp_path: Path) -> None:
    save_tum(tmp_path / "a.tum", [0.0, 0.5, 1.0], POSES)
    rows = np.loadtxt(tmp_path / "a.tum")
    assert rows.shape == (2, 8)
    assert rows[:, 0].tolist() == [0.0, 1.0]
    assert np.allclose(rows[1, 1:4], [1.2, -0.0305, 0.00725])
    assert np.allclose(Rotation.from_quat(rows[1, 4:]).as_matrix(), TURN, atol=1e-8)


def test_json_files_contain_all_values(tmp_path: Path) -> None:
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
