"""`mirrorcam features`: points that all views agree on, with their places."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import tyro
from pydantic import Field

from mirrorcam.commands.light_fields import LightFieldsOptions, say_some
from mirrorcam.commands.option_texts import FORCE
from mirrorcam.console.progress import long_work, say


class FeaturesOptions(LightFieldsOptions):
    """Find features that all views of a light field agree on: a figure, coloured by depth, a table and arrays."""

    detector: Literal["SIFT", "ORB", "AKAZE"] = Field(
        default="SIFT", description="keypoint detector; AKAZE needs the contributed modules of OpenCV"
    )
    keypoints: int = Field(default=600, ge=1, description="maximum number of keypoints per view to start from")
    max_distance_px: float = Field(
        default=0.5, gt=0, description="maximum distance of a feature in a view from where its slope predicts it"
    )
    min_views: Annotated[int | None, tyro.conf.arg(metavar="N_MIN", help_behavior_hint="(most of them)")] = Field(
        default=None, ge=1, description="number of views, besides the central one, in which a feature must be found"
    )
    near_mm: Annotated[
        float | None, tyro.conf.arg(metavar="MM", help_behavior_hint="(the scene's, or halfway to the reference plane)")
    ] = Field(default=None, description="nearest depth that is searched, from the pupil")
    far_mm: Annotated[float | None, tyro.conf.arg(metavar="MM", help_behavior_hint="(the scene's, or infinity)")] = (
        Field(default=None, description="farthest depth that is searched")
    )
    two_slope_sigma: float = Field(
        default=4.0,
        gt=0,
        description=(
            "standard deviations between the slopes along two directions beyond which a feature counts as refracted"
        ),
    )
    out: Path = Field(
        default=Path("output/features"),
        description=(
            "folder for NAME_features.png, NAME_features.csv (pixel, depth, sigma, point in rig, ... per line) and "
            "NAME_features.npz (NumPy: the fields of Features, with descriptors and where each view sees them)"
        ),
    )
    force: bool = FORCE


def run(options: FeaturesOptions) -> int:
    """Find and write features."""
    from mirrorcam.workflow.light_field_results import FeatureSearch, write_features

    search = FeatureSearch(
        detector=options.detector,
        keypoints=options.keypoints,
        max_distance_px=options.max_distance_px,
        min_views=options.min_views,
        near_mm=options.near_mm,
        far_mm=options.far_mm,
        two_slope_sigma=options.two_slope_sigma,
    )
    inputs = options.inputs()
    with long_work("features", options.counted, "files") as advance:
        found = write_features(inputs, options.out, search, force=options.force, progress=advance)
    lines = []
    for each in found:
        sigma = f", median sigma {each.median_sigma_mm:.2f} mm" if each.count else ""
        lines.append(f"{each.name}: {each.count} features, {each.refracted} of them with two slopes{sigma}")
    say_some("features", lines)
    say("features", f"pictures, tables (.csv) and arrays (.npz) written to {options.out}")
    return 0
