"""The trajectory of a camera from light fields as files."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mirrorcam.core.disk.output_folder import output_folder
from mirrorcam.core.progress import Progress, no_progress
from mirrorcam.core.values import InputError
from mirrorcam.lightfield.light_field_inputs import LightFieldInputs
from mirrorcam.optics.light_field.features import FeatureDetector
from mirrorcam.optics.light_field.motion import LightFieldTracker, TrackedPose, save_json, save_tum

FILES = ("trajectory.tum", "trajectory.json", "trajectory.png")


@dataclass(frozen=True)
class TrackSearch:
    """Parameters of a tracker, as `LightFieldTracker` documents them, and the rate of light fields without times."""

    detector: FeatureDetector = "ORB"
    keypoints: int = 600
    near_mm: float | None = None
    far_mm: float | None = None
    rate_hz: float = 30.0


@dataclass(frozen=True)
class Trajectory:
    """Names, times and poses of light fields, in order."""

    names: list[str]
    times_s: list[float]
    poses: list[TrackedPose]

    @property
    def path_mm(self) -> float:
        """Length of the path between the poses that are known."""
        places = [pose.world_from_view[:3, 3] for pose in self.poses if not pose.is_lost]
        return float(np.linalg.norm(np.diff(np.array(places), axis=0), axis=1).sum())


def write_trajectory(
    inputs: LightFieldInputs,
    folder: Path,
    search: TrackSearch,
    *,
    force: bool = False,
    progress: Progress = no_progress,
) -> Trajectory:
    """Track the camera through light fields, in their order, and write trajectory.tum, .json and .png into a folder.

    `force` also replaces files of others there. Raises InputError for less than two light fields, and for light fields
    of different views.
    """
    from mirrorcam.lightfield.trajectory_figure import draw_trajectory

    found = Trajectory([], [], [])
    tracker: LightFieldTracker | None = None
    with output_folder(folder, "track", force=force) as output:
        output.refuse_others(*FILES)
        for each in inputs.each(progress):
            if tracker is None:
                near, far = each.depths_to_search(search.near_mm, search.far_mm)
                tracker = LightFieldTracker(
                    each.light_field,
                    search.detector,
                    keypoints=search.keypoints,
                    nearest_mm=near,
                    farthest_mm=np.inf if far is None else far,
                )
            found.poses.append(tracker.track(each.light_field))
            found.names.append(each.name)
            number = len(found.times_s)
            found.times_s.append(number / search.rate_hz if each.time_s is None else each.time_s)
        if len(found.poses) < 2:
            raise InputError(f"{len(found.poses)} light field, expected at least two, in the order of time")
        with output.staged(complete=False, result=FILES[1]) as staged:
            save_tum(staged / FILES[0], found.times_s, found.poses)
            save_json(staged / FILES[1], found.names, found.times_s, found.poses)
            draw_trajectory(staged / FILES[2], found.times_s, found.poses)
    return found
