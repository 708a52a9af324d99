"""A light field in any format becomes one in another."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mirrorcam.optics.base.values import InputError
from mirrorcam.optics.light_field.depth import DepthEstimator
from mirrorcam.optics.light_field.depth.depth_files import load_depth
from mirrorcam.optics.light_field.io.formats.registry import ENDINGS, Format, format_of, named, read_any, write_any
from mirrorcam.optics.light_field.io.formats.views_file import Assumed
from mirrorcam.optics.light_field.light_field import LightField

SURE = 0.5
"""Confidence above which a measured depth is exported."""


@dataclass(frozen=True)
class Exported:
    """What was written: where, from which format, of which light field.

    `measured` is the share of its pixels with a sure depth where depth was measured for the export, else None.
    """

    path: Path
    source_format: str
    light_field: LightField
    measured: float | None = None


def export_light_field(
    source: Path,
    to: Format,
    folder: Path,
    *,
    frame: int = 0,
    depth: Path | None = None,
    assumed: Assumed,
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
    """
    light_field, depth_mm = read_any(source, assumed, frame)
    if depth is not None:
        depth_mm = load_depth(depth, light_field)
    measured = None
    if depth_mm is None and to == "ply":
        found = DepthEstimator(light_field).estimate(light_field)
        depth_mm = np.where(found.valid & (found.confidence > SURE), found.depth_mm, np.float32(np.nan))
        measured = float(np.isfinite(depth_mm).mean())
        if not measured:
            raise InputError(f"{source}: no depth with confidence above {SURE:g}; is the layout calibrated?")
    path = folder / f"{named(source)}{ENDINGS[to]}"
    write_any(path, light_field, to, depth_mm)
    return Exported(path, str(format_of(source)), light_field, measured)
