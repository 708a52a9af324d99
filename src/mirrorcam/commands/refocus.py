"""`mirrorcam refocus`: pictures of a light field, focused, seen from elsewhere, without what stands in the way."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal, Self

import tyro
from pydantic import Field, model_validator

from mirrorcam.commands.light_fields import LightFieldsOptions, say_some
from mirrorcam.console.progress import long_work, say


class RefocusOptions(LightFieldsOptions):
    """Focus light fields after the shot: on any plane, on everything, from between the views, past what is near."""

    depth_mm: Annotated[
        tuple[Annotated[float, Field(allow_inf_nan=True)], ...],
        tyro.conf.arg(metavar="MM...", help_behavior_hint="(the reference plane's)"),
    ] = Field(default=(), description="depths from the pupil to focus on, a picture each; inf is one")
    tilt_deg: Annotated[tuple[float, float], tyro.conf.arg(metavar="RIGHT DOWN")] = Field(
        default=(0.0, 0.0), description="turn the plane about the middle: its right, its lower side moves away"
    )
    combine: Literal["mean", "median", "weighted"] = Field(
        default="mean",
        description="of the views: median leaves out what few show; weighted counts those far from the central less",
    )
    scale: int = Field(default=1, ge=1, le=8, description="super-sample: pixels of the picture along one of a view")
    all_in_focus: bool = Field(default=False, description="also a picture with everything sharp, by depth")
    from_mm: Annotated[tuple[float, float] | None, tyro.conf.arg(metavar="RIGHT DOWN", help_behavior_hint="")] = Field(
        default=None, description="also a sharp picture as seen from so far beside the central view"
    )
    behind_mm: Annotated[float | None, tyro.conf.arg(metavar="MM", help_behavior_hint="")] = Field(
        default=None, gt=0, description="leave out of all pictures what lies nearer than this"
    )
    orbit: Annotated[Literal["gif", "mp4"] | None, tyro.conf.arg(help_behavior_hint="")] = Field(
        default=None, description="also a loop around the views"
    )
    sweep: Annotated[Literal["gif", "mp4"] | None, tyro.conf.arg(help_behavior_hint="")] = Field(
        default=None, description="also a loop of the focus from --near-mm to --far-mm and back"
    )
    near_mm: Annotated[float | None, tyro.conf.arg(metavar="MM", help_behavior_hint="(what depth looks for)")] = Field(
        default=None, gt=0, description="nearest depth that is looked for, and swept from"
    )
    far_mm: Annotated[float | None, tyro.conf.arg(metavar="MM", help_behavior_hint="(what depth looks for)")] = Field(
        default=None, gt=0, allow_inf_nan=True, description="farthest depth that is looked for, and swept to"
    )
    out: Path = Field(
        default=Path("output/refocus"),
        description=(
            "folder for NAME_focus_MMmm.png and .npz (NumPy: image (h, w, c) 0 to 1, weights (h, w)), and alike "
            "NAME_all_in_focus, NAME_from; NAME_orbit.gif or .mp4, NAME_sweep"
        ),
    )

    @model_validator(mode="after")
    def _check(self) -> Self:
        for at, depth in enumerate(self.depth_mm):
            if not depth > 0:
                raise ValueError(f"focus at {depth:g} mm, expected a positive depth")
            if depth in self.depth_mm[:at]:
                raise ValueError(f"focus at {depth:g} mm twice, expected different depths")
        return self


def run(options: RefocusOptions) -> int:
    """Focus and write pictures."""
    from mirrorcam.workflow.refocusing_files import RefocusRequest, write_refocused

    request = RefocusRequest(
        depths_mm=options.depth_mm,
        tilt_deg=options.tilt_deg,
        combine=options.combine,
        scale=options.scale,
        all_in_focus=options.all_in_focus,
        from_mm=options.from_mm,
        behind_mm=options.behind_mm,
        orbit=options.orbit,
        sweep=options.sweep,
        near_mm=options.near_mm,
        far_mm=options.far_mm,
    )
    inputs = options.inputs()
    with long_work("refocus", options.counted, "files") as advance:
        grey = write_refocused(inputs, options.out, request, advance)
    say_some("refocus", [f"{each.name}: no view shows {each.hidden:.0%} of it (grey)" for each in grey])
    say("refocus", f"pictures and arrays (.npz) written to {options.out}")
    return 0
