"""`mirrorcam track`: the motion of the camera through a sequence of light fields, as poses and a figure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
from cyclopts import Parameter

from mirrorcam.core.console.options import Force
from mirrorcam.core.console.progress import long_work, say
from mirrorcam.core.errors import InputError
from mirrorcam.core.progress import Progress, no_progress
from mirrorcam.lightfield.light_fields import AssumedViews, FrameLayout, LightFieldPaths, say_first
from mirrorcam.lightfield.requests import TrackRequest
from mirrorcam.optics.light_field.io.light_field_format import NOTHING

if TYPE_CHECKING:
    from mirrorcam.lightfield.light_field_inputs import LightFieldInputs
    from mirrorcam.optics.light_field.motion import TrackedPose

FILES = ("trajectory.tum", "trajectory.json", "trajectory.png")
SIZE_IN = (15.0, 4.6)
LENGTH = 0.06
"""Length of the lines along the optical axes, as a fraction of the maximum extent of the path."""
MIN_EXTENT_MM = 1.0
COLOUR, KEY = "tab:blue", "tab:red"


def track(
    light_fields: LightFieldPaths,
    /,
    *,
    layout: FrameLayout = None,
    views: AssumedViews = NOTHING,
    request: TrackRequest = TrackRequest(),
    out: Annotated[Path, Parameter(help="output folder")] = Path("output/track"),
    force: Force = False,
) -> int:
    """Track the camera past a static scene.

    Writes its pose in every light field to trajectory.tum (a pose per line in the TUM format, metres), trajectory.json
    (poses in mm, and their covariances) and trajectory.png (a figure). Exit code 1: the camera is lost in every light
    field after the first.

    Examples:
        mirrorcam track decoded/walk.zarr
        mirrorcam track decoded/frame_*.npz --rate-hz 10
    """
    from mirrorcam.core.console.reporter import TERMINAL
    from mirrorcam.core.figures.figure_texts import count_text
    from mirrorcam.lightfield.light_field_inputs import LightFieldInputs

    inputs = LightFieldInputs(light_fields, layout, TERMINAL, views)
    with long_work("track", inputs.count_text, "files") as advance:
        trajectory = write_trajectory(inputs, out, request, force=force, progress=advance)
    lost = [name for name, pose in zip(trajectory.names, trajectory.poses, strict=True) if pose.is_lost]
    say_first("track", [f"{name}: lost, because too little of the last key frame is visible" for name in lost])
    keys = count_text(sum(pose.is_key for pose in trajectory.poses), "key frame")
    say(
        "track",
        f"{len(trajectory.poses) - len(lost)} of {len(trajectory.poses)} poses, {keys}, "
        f"path {trajectory.path_mm:.1f} mm",
    )
    say("track", f"trajectory.tum, .json and .png written to {out}")
    return 1 if len(lost) == len(trajectory.poses) - 1 else 0


@dataclass(frozen=True)
class Trajectory:
    """Names, times and poses of light fields, in order."""

    names: list[str]
    times_s: list[float]
    poses: list[TrackedPose]

    @property
    def path_mm(self) -> float:
        """Length of the path through the poses that are not lost."""
        positions_mm = [pose.world_from_view[:3, 3] for pose in self.poses if not pose.is_lost]
        return float(np.linalg.norm(np.diff(np.array(positions_mm), axis=0), axis=1).sum())


def write_trajectory(
    inputs: LightFieldInputs,
    folder: Path,
    request: TrackRequest = TrackRequest(),
    *,
    force: bool = False,
    progress: Progress = no_progress,
) -> Trajectory:
    """Track the camera through light fields, in their order, and write trajectory.tum, .json and .png into a folder.

    `force` also replaces files that it did not write. Raises InputError for fewer than two light fields, and for light
    fields with different views.
    """
    from mirrorcam.core.disk.output_folder import output_folder
    from mirrorcam.optics.light_field.motion import LightFieldTracker, save_json, save_tum

    trajectory = Trajectory([], [], [])
    tracker: LightFieldTracker | None = None
    with output_folder(folder, "track", force=force) as output:
        output.refuse_others(*FILES)
        for named in inputs.open_all(progress):
            if tracker is None:
                near, far = named.depths_to_search(request.near_mm, request.far_mm)
                tracker = LightFieldTracker(
                    named.light_field,
                    request.detector,
                    keypoints=request.keypoints,
                    nearest_mm=near,
                    farthest_mm=np.inf if far is None else far,
                )
            trajectory.poses.append(tracker.track(named.light_field))
            trajectory.names.append(named.name)
            number = len(trajectory.times_s)
            trajectory.times_s.append(number / request.rate_hz if named.time_s is None else named.time_s)
        if len(trajectory.poses) < 2:
            raise InputError(f"{len(trajectory.poses)} light field, expected at least two, in temporal order")
        with output.staged(complete=False, result=FILES[1]) as staged:
            save_tum(staged / FILES[0], trajectory.times_s, trajectory.poses)
            save_json(staged / FILES[1], trajectory.names, trajectory.times_s, trajectory.poses)
            draw_trajectory(staged / FILES[2], trajectory.times_s, trajectory.poses)
    return trajectory


def draw_trajectory(path: Path, times_s: Sequence[float], poses: Sequence[TrackedPose]) -> None:
    """Write a PNG, atomically: the path from above and from the first view, and the sigma of positions.

    Positions of the reference view are in its frame at the first light field, mm; key frames are red, and the path
    breaks where the camera is lost.
    """
    from matplotlib.figure import Figure

    from mirrorcam.core.disk.files import atomic

    world_from_view = np.array([pose.world_from_view for pose in poses])
    positions_mm, optical_axes = world_from_view[:, :3, 3], world_from_view[:, :3, 2]
    keys = np.array([pose.is_key for pose in poses])
    valid = np.isfinite(positions_mm).all(axis=1)
    extent_mm = max(float(np.ptp(positions_mm[valid], axis=0).max()), MIN_EXTENT_MM) if valid.any() else MIN_EXTENT_MM
    figure = Figure(figsize=SIZE_IN, dpi=100, layout="constrained")
    axes = figure.subplots(1, 3)
    names = ("right", "down", "ahead")
    for panel, (horizontal, vertical), title in zip(
        axes, ((0, 2), (0, 1)), ("from above", "as the first view looks"), strict=False
    ):
        panel.plot(positions_mm[:, horizontal], positions_mm[:, vertical], color=COLOUR, linewidth=1.2)
        ends = positions_mm + LENGTH * extent_mm * optical_axes
        for start, end in zip(positions_mm[valid], ends[valid], strict=True):
            panel.plot(
                [start[horizontal], end[horizontal]],
                [start[vertical], end[vertical]],
                color="0.7",
                linewidth=0.8,
                zorder=1,
            )
        panel.scatter(positions_mm[~keys, horizontal], positions_mm[~keys, vertical], s=9, color=COLOUR, zorder=2)
        panel.scatter(positions_mm[keys, horizontal], positions_mm[keys, vertical], s=22, color=KEY, zorder=3)
        panel.set_xlabel(f"{names[horizontal]}, mm")
        panel.set_ylabel(f"{names[vertical]}, mm")
        panel.set_title(f"the camera's path {title}")
        panel.set_aspect("equal", adjustable="datalim")
        panel.grid(alpha=0.3)
    axes[1].invert_yaxis()
    sigmas = np.sqrt([np.trace(pose.covariance[:3, :3]) for pose in poses])
    axes[2].plot(times_s, sigmas, color=COLOUR, marker=".")
    axes[2].set_ylim(bottom=0.0)
    axes[2].set_xlabel("time, s")
    axes[2].set_ylabel("\N{GREEK SMALL LETTER SIGMA} of the position, mm")
    axes[2].set_title("standard deviation of the position")
    axes[2].grid(alpha=0.3)
    with atomic(path) as temporary:
        figure.savefig(temporary, metadata={"Software": None})
