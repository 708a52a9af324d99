"""`mirrorcam filter`: 4-D filters of light fields."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from mirrorcam.core.console.options import Force
from mirrorcam.core.console.progress import long_work, say
from mirrorcam.core.progress import Progress, no_progress
from mirrorcam.lightfield.light_fields import AssumedViews, FrameLayout, LightFieldPaths, say_first
from mirrorcam.lightfield.requests import FilterRequest
from mirrorcam.optics.light_field.io.light_field_format import NOTHING

if TYPE_CHECKING:
    from mirrorcam.lightfield.light_field_inputs import LightFieldInputs

ENDINGS = ("filtered.npz", "filtered_views.png")


def filter(  # the command's name
    light_fields: LightFieldPaths,
    /,
    *,
    layout: FrameLayout = None,
    views: AssumedViews = NOTHING,
    request: FilterRequest = FilterRequest(),
    out: Annotated[Path, Parameter(help="output folder")] = Path("output/filter"),
    force: Force = False,
) -> int:
    """Filter light fields in the frequency domain.

    Keeps surfaces between two depths; removes noise and, with --leave-out, rain and snow. Writes, for each light field,
    NAME_filtered.npz, a light field that other commands read, and NAME_filtered_views.png.

    Examples:
        mirrorcam filter decoded/frame_0000.npz --near-mm 300 --far-mm 600
        mirrorcam filter decoded/frame_0000.npz --near-mm 300 --far-mm 600 --leave-out
    """
    from mirrorcam.core.console.reporter import TERMINAL
    from mirrorcam.lightfield.light_field_inputs import LightFieldInputs

    inputs = LightFieldInputs(light_fields, layout, TERMINAL, views)
    with long_work("filter", inputs.count_text, "files") as advance:
        summaries = write_filtered(inputs, out, request, force=force, progress=advance)
    lines = []
    for summary in summaries:
        left_out = f", {summary.left_out:.1%} of the samples left out" if request.leave_out else ""
        lines.append(f"{summary.name}: {255 * summary.outside:.1f} grey levels outside the {request.kind}{left_out}")
    say_first("filter", lines)
    say("filter", f"light fields (.npz) and pictures written to {out}")
    return 0


@dataclass(frozen=True)
class FilterSummary:
    """A filtered light field: RMS signal `outside` its passband (0 to 1), and the fraction of samples left out."""

    name: str
    outside: float
    left_out: float


def write_filtered(
    inputs: LightFieldInputs,
    folder: Path,
    request: FilterRequest = FilterRequest(),
    *,
    force: bool = False,
    progress: Progress = no_progress,
) -> list[FilterSummary]:
    """Filter light fields, between the depths of the request or those that their files state.

    Writes NAME_filtered.npz and NAME_filtered_views.png into a folder.
    `force` also replaces files that it did not write.
    """
    from mirrorcam.core.disk.output_folder import output_folder
    from mirrorcam.core.images.pictures import write_image
    from mirrorcam.optics.light_field.filters import Passband, filter_light_field
    from mirrorcam.optics.light_field.io.formats.npz import save_npz
    from mirrorcam.optics.light_field.io.view_images import tiled_views

    summaries = []
    with output_folder(folder, "filter", force=force) as output:
        for named in inputs.open_for(output, ENDINGS, progress):
            near, far = named.depths_to_search(request.near_mm, request.far_mm)
            passband = Passband.of(named.light_field, request.kind, near, far)
            filtered = filter_light_field(named.light_field, passband, leave_out=request.leave_out)
            with output.staged(complete=False) as staged:
                save_npz(staged / f"{named.name}_filtered.npz", filtered.light_field)
                write_image(staged / f"{named.name}_filtered_views.png", tiled_views(filtered.light_field))
            summaries.append(FilterSummary(named.name, filtered.outside, filtered.left_out))
    return summaries
