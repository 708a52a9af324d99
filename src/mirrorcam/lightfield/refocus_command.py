"""`mirrorcam refocus`: refocused pictures of a light field, other viewpoints, removed occluders."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from mirrorcam.core.console.options import Force
from mirrorcam.core.console.progress import long_work, say
from mirrorcam.lightfield.light_fields import AssumedViews, FrameLayout, LightFieldPaths, say_first
from mirrorcam.lightfield.requests import RefocusRequest
from mirrorcam.optics.light_field.io.light_field_format import NOTHING


def refocus(
    light_fields: LightFieldPaths,
    /,
    *,
    layout: FrameLayout = None,
    views: AssumedViews = NOTHING,
    request: RefocusRequest = RefocusRequest(),
    out: Annotated[Path, Parameter(help="output folder")] = Path("output/refocus"),
    force: Force = False,
) -> int:
    """Refocus light fields, and render other viewpoints.

    Writes, for each light field, NAME_focus_MMmm.png and .npz (NumPy: image (h, w, c) 0 to 1, weights (h, w)), likewise
    NAME_all_in_focus and NAME_from, and the animations NAME_orbit and NAME_sweep. Depth, if needed, is estimated as
    by mirrorcam depth and kept as NAME_depth.npz in --out, or read from there. Exit code 1: a picture is empty, because
    no view covers it.

    Examples:
        mirrorcam refocus decoded/frame_0000.npz --depth-mm 363 490 600
        mirrorcam refocus decoded/frame_0000.npz --depth-mm 358.6 --tilt-deg 18 -12.6
        mirrorcam refocus decoded/frame_0000.npz --all-in-focus --behind-mm 390 --orbit gif
    """
    from mirrorcam.core.console.reporter import TERMINAL
    from mirrorcam.lightfield.light_field_inputs import LightFieldInputs
    from mirrorcam.lightfield.refocusing import write_refocused

    inputs = LightFieldInputs(light_fields, layout, TERMINAL, views)
    with long_work("refocus", inputs.count_text, "files") as advance:
        written = write_refocused(inputs, out, request, force=force, progress=advance)
    depth_lines = []
    for used in written.depths:
        near, far = used.searched_mm
        source = f"depth estimated and stored in {used.path}" if used.measured else f"depth of {used.path}"
        depth_lines.append(f"{used.name}: {source}, searched from {near:.0f} to {far:.0f} mm")
    say_first("refocus", depth_lines)
    say_first(
        "refocus", [f"{picture.name}: no view shows {picture.hidden:.0%} of it (grey)" for picture in written.grey]
    )
    say("refocus", f"pictures and arrays (.npz) written to {out}")
    return 1 if any(picture.hidden == 1.0 for picture in written.grey) else 0
