"""`mirrorcam filter`: 4-D filters of light fields."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal, Self

import tyro
from pydantic import Field, model_validator

from mirrorcam.core.bounds import DEPTH_MM, DEPTH_OR_INF_MM, DepthOrInf
from mirrorcam.core.console.option_texts import FORCE
from mirrorcam.core.console.progress import long_work, say
from mirrorcam.lightfield.light_fields import LightFieldsOptions, check_range, say_some


class FilterOptions(LightFieldsOptions):
    """Filter light fields in the frequency domain: keep what lies between two depths, without noise, rain and snow."""

    kind: Literal["hyperfan", "dual-fan", "hypercone"] = Field(
        default="hyperfan",
        description=(
            "what is kept. hyperfan: everything between two depths; dual-fan: the same, without comparing slopes along "
            "x and y; hypercone: everything at any one depth"
        ),
    )
    near_mm: Annotated[float | None, tyro.conf.arg(metavar="MM", help_behavior_hint="(as a scene states)")] = (
        DEPTH_MM.field(None, "nearest depth that is kept, from the pupil")
    )
    far_mm: Annotated[DepthOrInf | None, tyro.conf.arg(metavar="MM", help_behavior_hint="(as a scene states)")] = Field(
        default=None, description=f"farthest depth that is kept, {DEPTH_OR_INF_MM}"
    )
    leave_out: bool = Field(
        default=False,
        description="leave out samples that disagree with the others: rain, snow and particles nearer than --near-mm",
    )
    out: Path = Field(
        default=Path("output/filter"),
        description=(
            "folder for NAME_filtered.npz, a light field that other commands read, and NAME_filtered_views.png of each"
        ),
    )
    force: bool = FORCE

    @model_validator(mode="after")
    def _check(self) -> Self:
        check_range(self.near_mm, self.far_mm)
        if self.kind == "hypercone" and (self.near_mm is not None or self.far_mm is not None):
            raise ValueError("--kind hypercone keeps all depths, expected no --near-mm and --far-mm")
        return self


def run(options: FilterOptions) -> int:
    """Filter and write light fields."""
    from mirrorcam.lightfield.filtering import write_filtered

    inputs = options.inputs()
    with long_work("filter", options.counted, "files") as advance:
        found = write_filtered(
            inputs,
            options.out,
            options.kind,
            near_mm=options.near_mm,
            far_mm=options.far_mm,
            leave_out=options.leave_out,
            force=options.force,
            progress=advance,
        )
    lines = [f"{each.name}: {255 * each.outside:.1f} grey levels outside of the {options.kind}" for each in found]
    if options.leave_out:
        lines = [
            f"{line}, {each.left_out:.1%} of the samples left out" for line, each in zip(lines, found, strict=True)
        ]
    say_some("filter", lines)
    say("filter", f"light fields (.npz) and pictures written to {options.out}")
    return 0
