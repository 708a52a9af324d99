"""`mirrorcam features`: points that all views agree on, with their places."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal, Self

import tyro
from pydantic import Field, model_validator

from mirrorcam.core.bounds import DEPTH_MM, Bounds
from mirrorcam.core.console.option_texts import FORCE
from mirrorcam.core.console.progress import long_work, say
from mirrorcam.lightfield.light_fields import LightFieldsOptions, check_range, say_some


class FeaturesOptions(LightFieldsOptions):
    """Find features that all views of a light field agree on: a figure, coloured by depth, a table and arrays."""

    detector: Literal["SIFT", "ORB", "AKAZE", "SIFT4D"] = Field(
        default="SIFT",
        description=(
            "keypoint detector; SIFT4D searches in place, scale and slope at once, for little light; AKAZE needs the "
            "contributed modules of OpenCV"
        ),
    )
    keypoints: int = Bounds(1, 100_000).field(600, "maximum number of keypoints per view to start from")
    max_distance_px: float = Bounds(0.001, 100.0).field(
        0.5, "maximum distance of a feature in a view from where its slope predicts it"
    )
    min_views: Annotated[int | None, tyro.conf.arg(metavar="N_MIN", help_behavior_hint="(most of them)")] = Bounds(
        1, 1_000_000
    ).field(None, "number of views, besides the central one, in which a feature must be found")
    near_mm: Annotated[
        float | None, tyro.conf.arg(metavar="MM", help_behavior_hint="(the scene's, or halfway to the reference plane)")
    ] = DEPTH_MM.field(None, "nearest depth that is searched, from the pupil")
    far_mm: Annotated[float | None, tyro.conf.arg(metavar="MM", help_behavior_hint="(the scene's, or infinity)")] = (
        DEPTH_MM.field(None, "farthest depth that is searched")
    )
    two_slope_sigma: float = Bounds(0.001, 1e6).field(
        4.0, "standard deviations between the slopes along two directions beyond which a feature counts as refracted"
    )
    out: Path = Field(
        default=Path("output/features"),
        description=(
            "folder for NAME_features.png, NAME_features.csv (pixel, depth, sigma, point in rig, ... per line) and "
            "NAME_features.npz (NumPy: the fields of Features, with descriptors and where each view sees them)"
        ),
    )
    force: bool = FORCE

    @model_validator(mode="after")
    def _check(self) -> Self:
        check_range(self.near_mm, self.far_mm)
        return self


def run(options: FeaturesOptions) -> int:
    """Find and write features; 1 where a light field has none."""
    from mirrorcam.lightfield.light_field_results import FeatureSearch, write_features

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
    return 0 if all(each.count for each in found) else 1
