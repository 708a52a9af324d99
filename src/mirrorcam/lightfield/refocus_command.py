"""`mirrorcam refocus`: pictures of a light field: refocused, from other viewpoints, without occluders."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal, Self

from cyclopts import Parameter
from pydantic import Field, model_validator

from mirrorcam.core.bounds import DEPTH_MM, DEPTH_OR_INF_MM, OFFSET_MM, Bounds, DepthOrInf
from mirrorcam.core.console.options import Force
from mirrorcam.core.console.progress import long_work, say
from mirrorcam.lightfield.light_fields import DepthRange, FrameLayout, LightFieldPaths, say_some

TILT_DEG = Bounds(-85.0, 85.0)
Tilt = Annotated[float, TILT_DEG.each]
Offset = Annotated[float, OFFSET_MM.each]
LoopFormat = Literal["gif", "mp4"]


@Parameter(name="*")
class RefocusRequest(DepthRange):
    """Pictures to make of each light field."""

    depth_mm: tuple[DepthOrInf, ...] = Field(
        default=(),
        max_length=1000,
        description=f"depths from the pupil to focus on, one picture each, {DEPTH_OR_INF_MM} [default: the reference "
        "depth, where no other picture is requested]",
    )
    tilt_deg: tuple[Tilt, Tilt] = Field(
        default=(0.0, 0.0),
        description=f"tilt of the focal plane about its middle: its right and its lower side move away, {TILT_DEG}",
    )
    combine: Literal["mean", "median", "weighted"] = Field(
        default="mean",
        description="average of the views: median suppresses what few of them show, weighted favours the central ones",
    )
    scale: float = Bounds(1, 8).field(
        1.0, "super-resolution: pixels of the picture per pixel of a view, along each side, such as 1.5 or 2"
    )
    between: int = Bounds(0, 8).field(
        0, "views to interpolate between neighbours, by their depth: what is out of focus blurs without ghost edges"
    )
    all_in_focus: bool = Field(
        default=False, description="also write a picture with everything in focus, by the depth of each pixel"
    )
    from_mm: tuple[Offset, Offset] | None = Field(
        default=None,
        description="also write an all-in-focus picture from a viewpoint this many mm right of and below the central "
        f"view, {OFFSET_MM}",
    )
    behind_mm: float | None = DEPTH_MM.field(None, "remove what is nearer than this depth from all pictures")
    orbit: LoopFormat | None = Field(default=None, description="also write an animation in which the viewpoint circles")
    sweep: LoopFormat | None = Field(
        default=None, description="also write an animation in which the focus moves from --near-mm to --far-mm and back"
    )
    near_mm: float | None = DEPTH_MM.field(
        None, "nearest depth of the search and of --sweep", unset="as for mirrorcam depth"
    )
    far_mm: DepthOrInf | None = Field(
        default=None,
        description=f"farthest depth of the search and of --sweep, {DEPTH_OR_INF_MM} [default: as for mirrorcam depth]",
    )

    @model_validator(mode="after")
    def _check(self) -> Self:
        for at, depth in enumerate(self.depth_mm):
            if depth in self.depth_mm[:at]:
                raise ValueError(f"focus at {depth:g} mm twice, expected different depths")
        return self

    @property
    def needs_depth(self) -> bool:
        """Whether the pictures take the depth of each pixel."""
        rendered = self.all_in_focus or self.from_mm is not None or self.orbit is not None
        return rendered or self.behind_mm is not None or self.between > 0


def refocus(
    light_fields: LightFieldPaths,
    /,
    *,
    layout: FrameLayout = None,
    request: RefocusRequest = RefocusRequest(),
    out: Annotated[Path, Parameter(help="output folder")] = Path("output/refocus"),
    force: Force = False,
) -> int:
    """Refocus light fields, and render other viewpoints.

    Writes, for each light field, NAME_focus_MMmm.png and .npz (NumPy: image (h, w, c) 0 to 1, weights (h, w)), likewise
    NAME_all_in_focus and NAME_from, and the animations NAME_orbit and NAME_sweep. Depth that they need is estimated as
    by mirrorcam depth and kept as NAME_depth.npz in --out, or taken from there. Exit code 1: no view shows anything of
    a picture.

    Examples:
        mirrorcam refocus decoded/frame_0000.npz --depth-mm 363 490 600
        mirrorcam refocus decoded/frame_0000.npz --depth-mm 358.6 --tilt-deg 18 -12.6
        mirrorcam refocus decoded/frame_0000.npz --all-in-focus --behind-mm 390 --orbit gif
    """
    from mirrorcam.core.console.reporter import TERMINAL
    from mirrorcam.lightfield.light_field_inputs import LightFieldInputs
    from mirrorcam.lightfield.refocusing import write_refocused

    inputs = LightFieldInputs(light_fields, layout, TERMINAL)
    with long_work("refocus", inputs.counted, "files") as advance:
        made = write_refocused(inputs, out, request, force=force, progress=advance)
    for_depth = []
    for used in made.depths:
        near, far = used.searched_mm
        how = f"depth measured, kept in {used.path}" if used.measured else f"depth of {used.path}"
        for_depth.append(f"{used.name}: {how}, searched from {near:.0f} to {far:.0f} mm")
    say_some("refocus", for_depth)
    say_some("refocus", [f"{each.name}: no view shows {each.hidden:.0%} of it (grey)" for each in made.grey])
    say("refocus", f"pictures and arrays (.npz) written to {out}")
    return 1 if any(each.hidden == 1.0 for each in made.grey) else 0
