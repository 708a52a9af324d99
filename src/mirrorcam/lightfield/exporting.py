"""A light field in any format becomes one in another."""

from __future__ import annotations

import glob
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mirrorcam.core.disk.output_folder import output_folder
from mirrorcam.core.values import InputError
from mirrorcam.optics.light_field.depth import DepthEstimator
from mirrorcam.optics.light_field.depth.depth_files import load_depth
from mirrorcam.optics.light_field.io.formats.registry import (
    format_of,
    formats,
    frame_of,
    name_of,
    open_light_fields,
    write_light_field,
)
from mirrorcam.optics.light_field.io.light_field_format import NOTHING, Assumed, Contents, Depth
from mirrorcam.optics.light_field.light_field import LightField

SURE = 0.5
"""Confidence above which a measured depth is exported."""


@dataclass(frozen=True)
class Exported:
    """An exported light field: its path, the format it was read from, and its samples.

    `measured` is the share of its pixels with a sure depth where depth was measured for the export, else None. `notes`
    are lines about views that were read in another order.
    """

    path: Path
    source_format: str
    light_field: LightField
    measured: float | None = None
    notes: tuple[str, ...] = ()


def export_light_field(
    source: Path,
    to: str,
    folder: Path,
    *,
    frame: int = 0,
    depth: Path | None = None,
    assumed: Assumed = NOTHING,
    force: bool = False,
) -> Exported:
    """Read a light field from any format and write it into a folder in another.

    Parameters
    ----------
    source
        File or folder of a light field.
    to
        Name of the format to write.
    folder
        Folder of the file or folder that is written, which is called as the light field.
    frame
        Frame of a recording, counted from 0.
    depth
        Depth map of the light field, NAME_depth.npz of `mirrorcam depth`; PLY measures depth without it.
    assumed
        Geometry of the views for files that do not state it.
    force
        Whether files of others may be replaced, too.
    """
    name = f"{name_of(source)}{formats()[to].ending}"
    with output_folder(folder, "export", force=force) as output:
        # Files of others in the folder of a format would be read as part of it.
        within = f"{glob.escape(name)}/**/*"
        output.refuse_others(*([within] if output.path.joinpath(name).is_dir() else [within, glob.escape(name)]))
        contents = open_light_fields(source, assumed=assumed)
        light_field, depth_mm, measured = _read(contents, source, to, frame, depth)
        with output.staged(complete=False) as staged:
            write_light_field(staged / name, light_field, to, depth_mm)
    return Exported(folder / name, format_of(source).name, light_field, measured, contents.notes)


def _read(
    contents: Contents, source: Path, to: str, frame: int, depth: Path | None
) -> tuple[LightField, Depth | None, float | None]:
    """The light field, its depth where there is one, and the share of pixels where that was measured for the export."""
    light_field, depth_mm = frame_of(contents, frame, source), contents.depth_mm
    if depth is not None:
        depth_mm = load_depth(depth, light_field)
    measured = None
    if depth_mm is None and to == "ply":
        found = DepthEstimator(light_field).estimate(light_field)
        depth_mm = np.where(found.valid & (found.confidence > SURE), found.depth_mm, np.float32(np.nan))
        measured = float(np.isfinite(depth_mm).mean())
        if not measured:
            raise InputError(f"{source}: no depth with confidence above {SURE:g}; is the layout calibrated?")
    return light_field, depth_mm, measured
