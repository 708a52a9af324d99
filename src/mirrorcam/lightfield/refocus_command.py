"""`mirrorcam refocus`: pictures of a light field: refocused, from other viewpoints, without occluders."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, Self

import tyro
from pydantic import Field, model_validator

from mirrorcam.core.bounds import DEPTH_MM, DEPTH_OR_INF_MM, OFFSET_MM, Bounds, DepthOrInf
from mirrorcam.core.console.option_texts import FORCE
from mirrorcam.core.console.progress import long_work, say
from mirrorcam.lightfield.light_fields import LightFieldsOptions, check_range, say_some

if TYPE_CHECKING:
    from mirrorcam.lightfield.refocusing_files import UsedDepth

TILT_DEG = Bounds(-85.0, 85.0)
Tilt = Annotated[float, TILT_DEG.each]
Offset = Annotated[float, OFFSET_MM.each]


class RefocusOptions(LightFieldsOptions):
    """Refocus light fields: on any plane, all in focus, from new viewpoints, or behind occluders."""

    depth_mm: Annotated[
        tuple[DepthOrInf, ...],
        tyro.conf.arg(metavar="MM...", help_behavior_hint="(the reference plane's)"),
    ] = Field(
        default=(),
        max_length=1000,
        description=f"depths from the pupil to focus on, one picture each, {DEPTH_OR_INF_MM}",
    )
    tilt_deg: Annotated[tuple[Tilt, Tilt], tyro.conf.arg(metavar="RIGHT DOWN")] = Field(
        default=(0.0, 0.0),
        description=(
            f"tilt of the focal plane about its middle: the right side and the lower side move away, {TILT_DEG}"
        ),
    )
    combine: Literal["mean", "median", "weighted"] = Field(
        default="mean",
        description=(
            "how views are combined: median suppresses what few of them show, weighted favours the central ones"
        ),
    )
    scale: float = Bounds(1, 8).field(
        1.0, "super-resolution: pixels of the picture per pixel of a view, along each side, such as 1.5 or 2"
    )
    between: int = Bounds(0, 8).field(
        0, "views to interpolate between neighbours, by measured depth: what is out of focus blurs without ghost edges"
    )
    all_in_focus: bool = Field(
        default=False, description="also write a picture with everything in focus, from measured depth"
    )
    from_mm: Annotated[tuple[Offset, Offset] | None, tyro.conf.arg(metavar="RIGHT DOWN", help_behavior_hint="")] = (
        Field(
            default=None,
            description=(
                "also write an all-in-focus picture from a viewpoint this many mm right of and below the central view, "
                f"{OFFSET_MM}"
            ),
        )
    )
    behind_mm: Annotated[float | None, tyro.conf.arg(metavar="MM", help_behavior_hint="")] = DEPTH_MM.field(
        None, "remove what is nearer than this depth from all pictures"
    )
    orbit: Annotated[Literal["gif", "mp4"] | None, tyro.conf.arg(metavar="gif|mp4", help_behavior_hint="")] = Field(
        default=None, description="also write an animation in which the viewpoint circles"
    )
    sweep: Annotated[Literal["gif", "mp4"] | None, tyro.conf.arg(metavar="gif|mp4", help_behavior_hint="")] = Field(
        default=None, description="also write an animation in which the focus moves from --near-mm to --far-mm and back"
    )
    near_mm: Annotated[float | None, tyro.conf.arg(metavar="MM", help_behavior_hint="(as for mirrorcam depth)")] = (
        DEPTH_MM.field(None, "nearest depth that is searched, and start of the focus sweep")
    )
    far_mm: Annotated[DepthOrInf | None, tyro.conf.arg(metavar="MM", help_behavior_hint="(as for mirrorcam depth)")] = (
        Field(
            default=None,
            description=f"farthest depth that is searched, and end of the focus sweep, {DEPTH_OR_INF_MM}",
        )
    )
    depth_folder: Path = Field(
        default=Path("output/depth"),
        description=(
            "folder of mirrorcam depth: pictures that need depth use that of the same light field, from there or from "
            "--out; else it is measured and kept in --out as NAME_depth.npz"
        ),
    )
    out: Path = Field(
        default=Path("output/refocus"),
        description=(
            "folder for NAME_focus_MMmm.png and .npz (NumPy: image (h, w, c) 0 to 1, weights (h, w)), likewise "
            "NAME_all_in_focus and NAME_from, and NAME_orbit and NAME_sweep (.gif or .mp4)"
        ),
    )
    force: bool = FORCE

    @model_validator(mode="after")
    def _check(self) -> Self:
        check_range(self.near_mm, self.far_mm)
        for at, depth in enumerate(self.depth_mm):
            if depth in self.depth_mm[:at]:
                raise ValueError(f"focus at {depth:g} mm twice, expected different depths")
        return self


def run(options: RefocusOptions) -> int:
    """Focus and write pictures; 1 where no view shows anything of one."""
    from mirrorcam.lightfield.refocusing_files import RefocusRequest, write_refocused

    request = RefocusRequest(
        depths_mm=options.depth_mm,
        tilt_deg=options.tilt_deg,
        combine=options.combine,
        scale=options.scale,
        between=options.between,
        all_in_focus=options.all_in_focus,
        from_mm=options.from_mm,
        behind_mm=options.behind_mm,
        orbit=options.orbit,
        sweep=options.sweep,
        near_mm=options.near_mm,
        far_mm=options.far_mm,
        depth_folder=options.depth_folder,
    )
    inputs = options.inputs()
    with long_work("refocus", options.counted, "files") as advance:
        made = write_refocused(inputs, options.out, request, force=options.force, progress=advance)
    say_some("refocus", [_of_depth(each) for each in made.depths])
    say_some("refocus", [f"{each.name}: no view shows {each.hidden:.0%} of it (grey)" for each in made.grey])
    say("refocus", f"pictures and arrays (.npz) written to {options.out}")
    return 1 if any(each.hidden == 1.0 for each in made.grey) else 0


def _of_depth(used: UsedDepth) -> str:
    near, far = used.searched_mm
    how = f"depth measured, kept in {used.path}" if used.measured else f"depth of {used.path}"
    return f"{used.name}: {how}, searched from {near:.0f} to {far:.0f} mm"
