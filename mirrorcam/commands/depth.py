"""`mirrorcam depth`: how deep everything in a light field is."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro
from pydantic import Field

from mirrorcam.commands.light_fields import LightFieldsOptions, distinct_names, opened
from mirrorcam.console.progress import count_text, long_work, say

if TYPE_CHECKING:
    pass


class DepthOptions(LightFieldsOptions):
    """Measure depth in light fields: a picture with a scale in mm, and arrays."""

    near_mm: Annotated[
        float | None, tyro.conf.arg(help_behavior_hint="(0.6 reference depths, or what a scene states)")
    ] = Field(default=None, description="nearest depth that is looked for, from the pupil")
    far_mm: Annotated[
        float | None, tyro.conf.arg(help_behavior_hint="(2 reference depths, or what a scene states)")
    ] = Field(default=None, description="farthest depth that is looked for")
    out: Path = Field(
        default=Path("output/depth"),
        description=(
            "folder for NAME_depth.png (view, depth, confidence), NAME_depth.npz (NumPy: depth_mm, sigma_mm and "
            "confidence (v, u) of the central view) and NAME_depth.pfm (mm) of each light field"
        ),
    )


def run(options: DepthOptions) -> int:
    """Measure and write depths."""
    import numpy as np

    from mirrorcam.figures.depth_figure import draw_depth
    from mirrorcam.optics.base.files import atomic
    from mirrorcam.optics.light_field.depth import DepthEstimator
    from mirrorcam.optics.light_field.io.formats.pfm import write_pfm

    names = distinct_names(options.light_fields, "depth map")
    estimator: DepthEstimator | None = None
    summary: list[str] = []
    with long_work("depth", count_text(len(names), "light field"), "files") as advance:
        for done, path in enumerate(options.light_fields, start=1):
            for name, light_field, known in opened(path, options.layout):
                if estimator is None or not estimator.fits(light_field):
                    near, far = known or (None, None)
                    near = near if options.near_mm is None else options.near_mm
                    far = far if options.far_mm is None else options.far_mm
                    estimator = DepthEstimator(light_field, near_mm=near, far_mm=far)
                depth = estimator.estimate(light_field)
                with atomic(options.out / f"{name}_depth.npz") as temporary:
                    np.savez_compressed(
                        temporary,
                        depth_mm=depth.depth_mm,
                        sigma_mm=depth.sigma_mm,
                        confidence=depth.confidence,
                        view=np.array(depth.view),
                        layout_identity=np.array(depth.views.layout_identity),
                    )
                write_pfm(options.out / f"{name}_depth.pfm", depth.depth_mm)
                draw_depth(options.out / f"{name}_depth.png", light_field, depth)
                sure = depth.valid & (depth.confidence > 0.5)
                middle = f"median {np.median(depth.depth_mm[sure]):.0f} mm" if sure.any() else "nothing sure"
                summary.append(f"{name}: {sure.mean():.0%} of the pixels with confidence above 0.5, {middle}")
            advance(done, len(names))
    for line in summary[:20]:
        say("depth", line)
    say("depth", f"pictures, arrays (.npz) and maps (.pfm) written to {options.out}")
    return 0
