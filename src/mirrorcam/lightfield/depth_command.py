"""`mirrorcam depth`: depth maps of light fields, as a figure and arrays."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from mirrorcam.core.console.options import Force
from mirrorcam.core.console.progress import long_work, say
from mirrorcam.lightfield.light_fields import AssumedViews, FrameLayout, LightFieldPaths, say_first
from mirrorcam.lightfield.requests import DepthRequest
from mirrorcam.optics.light_field.io.light_field_format import NOTHING


def depth(
    light_fields: LightFieldPaths,
    /,
    *,
    layout: FrameLayout = None,
    views: AssumedViews = NOTHING,
    request: DepthRequest = DepthRequest(),
    out: Annotated[Path, Parameter(help="output folder")] = Path("output/depth"),
    force: Force = False,
) -> int:
    """Estimate depth maps of light fields.

    Writes, for each light field, NAME_depth.png (view, depth, confidence), NAME_depth.npz (NumPy: depth_mm, sigma_mm
    and confidence (v, u) of the central view) and NAME_depth.pfm (mm). Exit code 1: a light field has no pixel with a
    depth.

    Examples:
        mirrorcam depth decoded/frame_0000.npz
        mirrorcam depth frame.png --layout calibrated/layout.json --near-mm 250 --far-mm 800
    """
    from mirrorcam.core.console.reporter import TERMINAL
    from mirrorcam.lightfield.depth_maps import write_depths
    from mirrorcam.lightfield.light_field_inputs import LightFieldInputs

    inputs = LightFieldInputs(light_fields, layout, TERMINAL, views)
    with long_work("depth", inputs.count_text, "files") as advance:
        summaries = write_depths(inputs, out, request, force=force, progress=advance)
    empty = [summary.name for summary in summaries if not summary.depth_fraction]
    lines = [f"{name}: no pixel has a depth" for name in empty]
    for summary in (summary for summary in summaries if summary.depth_fraction):
        median = f", median {summary.median_mm:.0f} mm" if summary.confident_fraction else ""
        lines.append(
            f"{summary.name}: {summary.confident_fraction:.0%} of the pixels with confidence above 0.5{median}"
        )
    say_first("depth", lines)
    say("depth", f"pictures, arrays (.npz) and maps (.pfm) written to {out}")
    return 1 if empty else 0
