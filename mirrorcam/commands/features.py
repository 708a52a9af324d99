"""`mirrorcam features`: points that all views agree on, with their places."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro
from pydantic import Field

from mirrorcam.commands.light_fields import LightFieldsOptions, distinct_names, opened
from mirrorcam.console.progress import count_text, long_work, say

if TYPE_CHECKING:
    from mirrorcam.optics.light_field.features import FeatureFinder


class FeaturesOptions(LightFieldsOptions):
    """Find features in light fields: a picture of them, coloured by depth, and arrays."""

    detector: Literal["SIFT", "ORB", "AKAZE"] = Field(
        default="SIFT", description="of the keypoints; AKAZE needs the contributed modules of OpenCV"
    )
    keypoints: int = Field(default=600, ge=1, description="how many of a view's keypoints to start from, at most")
    max_distance_px: float = Field(
        default=0.5, gt=0, description="how far from where its slope expects it a view may see a feature"
    )
    min_views: Annotated[int | None, tyro.conf.arg(metavar="N_MIN", help_behavior_hint="(most)")] = Field(
        default=None, ge=1, description="in how many views beside the central one a feature must be found"
    )
    near_mm: Annotated[
        float | None, tyro.conf.arg(metavar="MM", help_behavior_hint="(the scene's, or halfway to the reference plane)")
    ] = Field(default=None, description="nearest depth that is looked for, from the pupil")
    far_mm: Annotated[float | None, tyro.conf.arg(metavar="MM", help_behavior_hint="(the scene's, or infinity)")] = (
        Field(default=None, description="farthest depth that is looked for")
    )
    two_slope_sigma: float = Field(
        default=4.0,
        gt=0,
        description="features whose slopes along two directions are more standard deviations apart are refracted",
    )
    out: Path = Field(
        default=Path("output/features"),
        description=(
            "folder for NAME_features.png, NAME_features.csv (a line each: pixel, depth, sigma, point in rig, ...) and "
            "NAME_features.npz (NumPy: the fields of Features, with descriptors and where each view sees them)"
        ),
    )


def run(options: FeaturesOptions) -> int:
    """Find and write features."""
    import numpy as np

    from mirrorcam.figures.features_figure import draw_features
    from mirrorcam.optics.light_field.features import FeatureFinder
    from mirrorcam.optics.light_field.features.feature_files import save_csv, save_npz

    names = distinct_names(options.light_fields, "features")
    finder: FeatureFinder | None = None
    depths_mm: tuple[float, float] | None = None
    summary: list[str] = []
    with long_work("features", count_text(len(names), "light field"), "files") as advance:
        for done, path in enumerate(options.light_fields, start=1):
            for name, light_field, known in opened(path, options.layout):
                if finder is None or known != depths_mm or not finder.fits(light_field):
                    depths_mm = known
                    near, far = known or (None, np.inf)
                    finder = FeatureFinder(
                        light_field,
                        options.detector,
                        keypoints=options.keypoints,
                        max_distance_px=options.max_distance_px,
                        min_views=options.min_views,
                        nearest_mm=near if options.near_mm is None else options.near_mm,
                        farthest_mm=far if options.far_mm is None else options.far_mm,
                        two_slope_sigma=options.two_slope_sigma,
                    )
                found = finder.find(light_field)
                save_npz(options.out / f"{name}_features.npz", found)
                save_csv(options.out / f"{name}_features.csv", found)
                draw_features(options.out / f"{name}_features.png", light_field, found)
                flagged = int(found.refracted.sum())
                sigma = f", median sigma {np.median(found.depth_sigma_mm):.2f} mm" if len(found) else ""
                summary.append(f"{name}: {len(found)} features, {flagged} of them with two slopes{sigma}")
            advance(done, len(names))
    for line in summary[:20]:
        say("features", line)
    say("features", f"pictures, tables (.csv) and arrays (.npz) written to {options.out}")
    return 0
