"""`mirrorcam epi`: epipolar-plane images of light fields."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import tyro
from pydantic import Field

from mirrorcam.core.bounds import DEPTH_MM, LINE_PX
from mirrorcam.core.console.option_texts import FORCE
from mirrorcam.core.console.progress import long_work, say
from mirrorcam.lightfield.light_fields import LightFieldsOptions, say_some


class EpiOptions(LightFieldsOptions):
    """Extract epipolar-plane images of light fields: a figure, in which depth shows as slope, and arrays."""

    axis: Literal["s", "t"] = Field(default="s", description="views along one row (s) or one column (t)")
    line: Annotated[int | None, tyro.conf.arg(metavar="PX", help_behavior_hint="(the middle)")] = LINE_PX.field(
        None, "pixel row of the central view for s, pixel column for t"
    )
    depth_mm: Annotated[float | None, tyro.conf.arg(metavar="MM", help_behavior_hint="(the reference plane's)")] = (
        DEPTH_MM.field(None, "depth from the pupil at which points form vertical lines")
    )
    out: Path = Field(
        default=Path("output/epi"),
        description=(
            "folder for NAME_epi.png and NAME_epi.npz (NumPy: samples (n, length, c) 0 to 1, weights (n, length), "
            "positions_mm (n,)) of each light field"
        ),
    )
    force: bool = FORCE


def run(options: EpiOptions) -> int:
    """Cut and write epipolar-plane images; 1 where one has no sample."""
    from mirrorcam.lightfield.light_field_results import write_epipolar_images

    inputs = options.inputs()
    with long_work("epi", options.counted, "files") as advance:
        empty = write_epipolar_images(
            inputs,
            options.out,
            axis=options.axis,
            line=options.line,
            depth_mm=options.depth_mm,
            force=options.force,
            progress=advance,
        )
    say_some("epi", [f"{name}: no view shows anything of this line" for name in empty])
    say("epi", f"pictures and arrays (.npz) written to {options.out}")
    return 1 if empty else 0
