"""Filtered light fields as files."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from mirrorcam.core.disk.output_folder import output_folder
from mirrorcam.core.images.pictures import write_image
from mirrorcam.core.progress import Progress, no_progress
from mirrorcam.lightfield.light_field_inputs import LightFieldInputs
from mirrorcam.lightfield.light_field_results import result_names
from mirrorcam.optics.light_field.filters import FilterKind, Passband, filter_light_field
from mirrorcam.optics.light_field.io.formats.npz import save_npz
from mirrorcam.optics.light_field.io.view_images import tiled_views

ENDINGS = ("filtered.npz", "filtered_views.png")


@dataclass(frozen=True)
class FilterSummary:
    """A filtered light field: what did not agree with its passband (0 to 1), and the share of samples left out."""

    name: str
    outside: float
    left_out: float


def write_filtered(
    inputs: LightFieldInputs,
    folder: Path,
    kind: FilterKind,
    *,
    near_mm: float | None = None,
    far_mm: float | None = None,
    leave_out: bool = False,
    force: bool = False,
    progress: Progress = no_progress,
) -> list[FilterSummary]:
    """Filter light fields, between the depths given or those that their files state.

    Writes NAME_filtered.npz and NAME_filtered_views.png into a folder, where `force` also replaces files of others.
    """
    summaries = []
    with output_folder(folder, "filter", force=force) as output:
        output.refuse_others(*(name for each in inputs.file_names for name in result_names(each, ENDINGS)))
        for each in inputs.each(progress):
            output.refuse_others(*result_names(each.name, ENDINGS))
            near, far = each.depths_to_search(near_mm, far_mm)
            passband = Passband.of(each.light_field, kind, near, far)
            filtered = filter_light_field(each.light_field, passband, leave_out=leave_out)
            with output.staged(complete=False) as staged:
                save_npz(staged / f"{each.name}_filtered.npz", filtered.light_field)
                write_image(staged / f"{each.name}_filtered_views.png", tiled_views(filtered.light_field))
            summaries.append(FilterSummary(each.name, filtered.outside, filtered.left_out))
    return summaries
