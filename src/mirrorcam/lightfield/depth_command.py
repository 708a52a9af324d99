"""`mirrorcam depth`: depth maps of light fields."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Self

import tyro
from pydantic import Field, model_validator

from mirrorcam.core.bounds import DEPTH_MM
from mirrorcam.core.console.option_texts import FORCE
from mirrorcam.core.console.progress import long_work, say
from mirrorcam.lightfield.light_fields import LightFieldsOptions, check_range, say_some


class DepthOptions(LightFieldsOptions):
    """Estimate depth maps of light fields: a figure with a scale in mm, and arrays."""

    near_mm: Annotated[
        float | None,
        tyro.conf.arg(metavar="MM", help_behavior_hint="(0.6 times the reference depth, or as a scene states)"),
    ] = DEPTH_MM.field(None, "nearest depth that is searched, from the pupil")
    far_mm: Annotated[
        float | None,
        tyro.conf.arg(metavar="MM", help_behavior_hint="(2 times the reference depth, or as a scene states)"),
    ] = DEPTH_MM.field(None, "farthest depth that is searched")
    fast: bool = Field(
        default=False, description="for videos: search at half size and refine once, several times faster, less exact"
    )
    frames_apart: bool = Field(
        default=False,
        description=(
            "measure each frame of a recording on its own; without it, views are averaged over frames where nothing "
            "moves, so that depth does not flicker there"
        ),
    )
    out: Path = Field(
        default=Path("output/depth"),
        description=(
            "folder for NAME_depth.png (view, depth, confidence), NAME_depth.npz (NumPy: depth_mm, sigma_mm and "
            "confidence (v, u) of the central view) and NAME_depth.pfm (mm) of each light field"
        ),
    )
    force: bool = FORCE

    @model_validator(mode="after")
    def _check(self) -> Self:
        check_range(self.near_mm, self.far_mm)
        return self


def run(options: DepthOptions) -> int:
    """Measure and write depths; 1 where no pixel of a light field has one."""
    from mirrorcam.lightfield.light_field_results import write_depths

    inputs = options.inputs()
    with long_work("depth", options.counted, "files") as advance:
        found = write_depths(
            inputs,
            options.out,
            near_mm=options.near_mm,
            far_mm=options.far_mm,
            quality="fast" if options.fast else "best",
            frames_apart=options.frames_apart,
            force=options.force,
            progress=advance,
        )
    lines = [f"{each.name}: no pixel has a depth" for each in found if not each.known]
    empty = bool(lines)
    for each in (each for each in found if each.known):
        median = f", median {each.median_mm:.0f} mm" if each.sure else ""
        lines.append(f"{each.name}: {each.sure:.0%} of the pixels with confidence above 0.5{median}")
    say_some("depth", lines)
    say("depth", f"pictures, arrays (.npz) and maps (.pfm) written to {options.out}")
    return 1 if empty else 0
