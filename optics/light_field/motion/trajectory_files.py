"""Trajectories as files: the poses as TUM's RGB-D benchmark has them, and all that is known of them as JSON."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

from scipy.spatial.transform import Rotation

from mirrorcam.core.disk.files import write_text
from mirrorcam.optics.light_field.motion.tracker import TrackedPose

SCHEMA = "mirrorcam.trajectory/1"


def save_tum(path: Path, times_s: Sequence[float], poses: Sequence[TrackedPose]) -> None:
    """Write `time tx ty tz qx qy qz qw` a line, atomically: metres, world_from_view; lost frames are left out.

    Sturm et al., "A benchmark for the evaluation of RGB-D SLAM systems", IROS 2012.
    """
    lines = ["# time_s tx ty tz qx qy qz qw (metres; pose of the reference view in the first one's frame)"]
    for time_s, pose in zip(times_s, poses, strict=True):
        if not pose.is_lost:
            turn = Rotation.from_matrix(pose.world_from_view[:3, :3]).as_quat(canonical=True)
            numbers = [*(pose.world_from_view[:3, 3] / 1000.0), *turn]
            lines.append(f"{time_s:.6f} " + " ".join(f"{number:.9f}" for number in numbers))
    write_text(path, "\n".join(lines) + "\n")


def save_json(path: Path, names: Sequence[str], times_s: Sequence[float], poses: Sequence[TrackedPose]) -> None:
    """Write names, times, poses (4, 4) in mm and covariances (6, 6), atomically; null where a frame is lost."""
    frames = [
        {
            "name": name,
            "time_s": time_s,
            "world_from_view": None if pose.is_lost else pose.world_from_view.tolist(),
            "covariance": None if pose.is_lost else pose.covariance.tolist(),
            "landmarks": pose.landmarks,
            "is_key": pose.is_key,
        }
        for name, time_s, pose in zip(names, times_s, poses, strict=True)
    ]
    document = {"schema": SCHEMA, "covariance_order": "x_mm y_mm z_mm turn_x turn_y turn_z", "frames": frames}
    write_text(path, json.dumps(document, indent=1) + "\n")
