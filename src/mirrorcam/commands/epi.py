"""`mirrorcam epi`: epipolar-plane images of light fields."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import tyro
from pydantic import Field

from mirrorcam.commands.light_fields import LightFieldsOptions
from mirrorcam.console.progress import long_work, say


class EpiOptions(LightFieldsOptions):
    """Cut epipolar-plane images out of light fields: a picture with depths as slopes, and arrays."""

    axis: Literal["s", "t"] = Field(default="s", description="views beside each other (s), or above each other (t)")
    line: Annotated[int | None, tyro.conf.arg(metavar="PX", help_behavior_hint="(the middle)")] = Field(
        default=None, ge=0, description="row of the central view for s, column for t"
    )
    depth_mm: Annotated[float | None, tyro.conf.arg(metavar="MM", help_behavior_hint="(the reference plane's)")] = (
        Field(default=None, gt=0, description="depth from the pupil that stands upright")
    )
    out: Path = Field(
        default=Path("output/epi"),
        description=(
            "folder for NAME_epi.png and NAME_epi.npz (NumPy: samples (n, length, c) 0 to 1, weights (n, length), "
            "positions_mm (n,)) of each light field"
        ),
    )


def run(options: EpiOptions) -> int:
    """Cut and write epipolar-plane images."""
    from mirrorcam.workflow.light_field_results import write_epipolar_images

    inputs = options.inputs()
    with long_work("epi", options.counted, "files") as advance:
        write_epipolar_images(
            inputs, options.out, axis=options.axis, line=options.line, depth_mm=options.depth_mm, progress=advance
        )
    say("epi", f"pictures and arrays (.npz) written to {options.out}")
    return 0
