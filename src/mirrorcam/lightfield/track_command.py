"""`mirrorcam track`: the motion of the camera through a sequence of light fields."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal, Self

import tyro
from pydantic import Field, model_validator

from mirrorcam.core.bounds import DEPTH_MM, Bounds
from mirrorcam.core.console.option_texts import FORCE
from mirrorcam.core.console.progress import long_work, say
from mirrorcam.core.figures.figure_texts import count_text
from mirrorcam.lightfield.light_fields import LightFieldsOptions, check_range, say_some
from mirrorcam.render_scenes.settings import RATE_HZ


class TrackOptions(LightFieldsOptions):
    """Track the camera past a still scene: its pose in every light field of a recording, with covariance."""

    detector: Literal["SIFT", "ORB", "AKAZE", "SIFT4D"] = Field(
        default="ORB",
        description=(
            "keypoint detector; SIFT4D searches in place, scale and slope at once, for little light; AKAZE needs the "
            "contributed modules of OpenCV"
        ),
    )
    keypoints: int = Bounds(20, 100_000).field(600, "maximum number of keypoints per view to start from")
    near_mm: Annotated[
        float | None, tyro.conf.arg(metavar="MM", help_behavior_hint="(the scene's, or halfway to the reference plane)")
    ] = DEPTH_MM.field(None, "nearest depth of the scene, from the pupil")
    far_mm: Annotated[float | None, tyro.conf.arg(metavar="MM", help_behavior_hint="(the scene's, or infinity)")] = (
        DEPTH_MM.field(None, "farthest depth of the scene")
    )
    rate_hz: float = RATE_HZ.field(30.0, "light fields per second, where a recording does not state their times")
    out: Path = Field(
        default=Path("output/track"),
        description=(
            "folder for trajectory.tum (a pose per line in the TUM format, metres), trajectory.json (poses in mm, and "
            "their covariances) and trajectory.png (a figure)"
        ),
    )
    force: bool = FORCE

    @model_validator(mode="after")
    def _check(self) -> Self:
        check_range(self.near_mm, self.far_mm)
        return self


def run(options: TrackOptions) -> int:
    """Track and write poses; 1 where the camera is lost in every light field after the first."""
    from mirrorcam.lightfield.tracking import TrackSearch, write_trajectory

    search = TrackSearch(
        detector=options.detector,
        keypoints=options.keypoints,
        near_mm=options.near_mm,
        far_mm=options.far_mm,
        rate_hz=options.rate_hz,
    )
    inputs = options.inputs()
    with long_work("track", options.counted, "files") as advance:
        found = write_trajectory(inputs, options.out, search, force=options.force, progress=advance)
    lost = [name for name, pose in zip(found.names, found.poses, strict=True) if pose.is_lost]
    say_some("track", [f"{name}: lost, too little of the last key frame is seen" for name in lost])
    keys = count_text(sum(pose.is_key for pose in found.poses), "key frame")
    say("track", f"{len(found.poses) - len(lost)} of {len(found.poses)} poses, {keys}, path {found.path_mm:.1f} mm")
    say("track", f"trajectory.tum, .json and .png written to {options.out}")
    return 1 if len(lost) == len(found.poses) - 1 else 0
