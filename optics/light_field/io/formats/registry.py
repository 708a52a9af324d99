"""All formats of light fields: detection, reading and writing.

A format is a module in this folder with a `Format` named `FORMAT`. Formats are imported on first use: listing their
names costs nothing.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules
from typing import TYPE_CHECKING

import numpy as np

from mirrorcam.core.arguments import AnyPath, check_type, path_of
from mirrorcam.core.disk.files import readable, refuse_pointer
from mirrorcam.core.errors import InputError
from mirrorcam.core.figures.figure_texts import count_text
from mirrorcam.core.messages import shortened
from mirrorcam.optics.light_field.io.light_field_format import (
    NOTHING,
    Assumed,
    Contents,
    Depth,
    Format,
    KnownDepth,
)
from mirrorcam.optics.light_field.light_field import LightField

if TYPE_CHECKING:
    from mirrorcam.optics.light_field.decoder import Decoder
    from mirrorcam.optics.light_field.depth import DepthMap

NAMES = tuple(sorted(module.name for module in iter_modules([str(Path(__file__).parent)]) if module.name != "registry"))
"""Names of all formats."""
MIN_CONFIDENCE = 0.5
"""Confidence above which a depth is written as a point."""
BAGS = {
    ".bag": "a ROS 1 bag; rosbags-convert turns it into a ROS 2 bag",
    ".db3": "a file of a ROS 2 bag; give its folder, with metadata.yaml",
}
"""Explanations, by suffix, of bags that cannot be read directly."""


@cache
def formats() -> Mapping[str, Format]:
    """Return all formats by name."""
    return {name: import_module(f"{__package__}.{name}").FORMAT for name in NAMES}


def format_of(path: Path) -> Format:
    """Detect the format of a file or folder by its name and contents; raises InputError if there is none."""
    with readable(path):
        refuse_pointer(path)
        detected = next((form for form in formats().values() if form.detect(path)), None)
    if detected is not None:
        return detected
    if path.is_dir():
        raise InputError(f"{path}: the folder does not have a known format, expected one of {', '.join(NAMES)}")
    endings = sorted(
        {form.ending[form.ending.index(".") :] for form in formats().values() if not form.is_folder and form.read}
    )
    problem = BAGS.get(path.suffix.lower(), "its name is not that of a light field")
    raise InputError(f"{path}: {problem}, expected {', '.join(endings)} or a folder")


def open_light_fields(path: Path, *, assumed: Assumed = NOTHING, decoder: Decoder | None = None) -> Contents:
    """Open a file or folder of any format.

    Parameters
    ----------
    path
        Light field, recording or, with a decoder, a frame of the camera (a picture).
    assumed
        Geometry of the views for files that do not state it; where None, the path's `views_toml` is used.
    decoder
        Decoder of the camera that took a frame; unused for light fields.

    Returns
    -------
    Contents
        The light fields, and the depths that the file states.

    Raises
    ------
    InputError
        In one line, for unreadable files, a geometry that is neither stated nor assumed, and views whose pictures
        contradict their order.
    """
    if decoder is not None:
        from mirrorcam.core.images.pictures import is_picture, read_image

        if is_picture(path):
            return Contents((decoder.decode(read_image(path)),))
    form = format_of(path)
    if form.read is None:
        raise InputError(f"{path}: {form.name} can only be written, expected a format that can be read")
    try:
        return _in_order(form.read(path, assumed.complete(path)))
    except InputError as error:
        reason = " ".join(str(error).split()) if "\n" in str(error) else str(error)
        raise InputError(shortened(reason if str(path.parent / path.stem) in reason else f"{path}: {reason}")) from None


def _in_order(contents: Contents) -> Contents:
    """Put views in the order that their pictures show; our light fields and recordings state it."""
    if contents.is_recording or contents.frames[0].layout_identity:
        return contents
    from mirrorcam.optics.light_field.io.view_order import in_order

    # A true depth belongs to the view that is central in the file.
    light_field, note = in_order(contents.frames[0], may_change=contents.depth_mm is None)
    return contents if note is None else replace(contents, frames=(light_field,), notes=(*contents.notes, note))


def open_light_field(
    path: AnyPath, *, frame: int = 0, assumed: Assumed = NOTHING, decoder: Decoder | None = None
) -> LightField:
    """Read one light field from a file or folder of any format.

    Parameters
    ----------
    path, assumed, decoder
        As in `open_light_fields`.
    frame
        Index of the light field in a recording, from 0.

    Returns
    -------
    LightField
        Samples (t, s, v, u, c), weights and geometry of the views.

    Raises
    ------
    InputError
        In one line, for unreadable files, and for a frame that the recording does not have.
    """
    path = path_of("path", path)
    return frame_of(open_light_fields(path, assumed=assumed, decoder=decoder), frame, path)


def frame_of(contents: Contents, frame: int, path: Path) -> LightField:
    """Return a frame of the contents of a path; raises InputError if it does not exist."""
    count = len(contents.frames)
    if not 0 <= frame < count:
        raise InputError(f"{path}: has {count_text(count, 'frame')}, but not frame {frame}")
    return contents.frames[frame]


def write_light_field(
    path: AnyPath,
    light_field: LightField,
    to: str,
    depth_mm: Depth | DepthMap | None = None,
    *,
    min_confidence: float = MIN_CONFIDENCE,
) -> None:
    """Write a light field in a format.

    Parameters
    ----------
    path
        File or folder to write.
    light_field
        Light field to write; most formats store 8 bits per sample.
    to
        Format: colmap, eslf, hci, lftoolbox, mcap, nerfstudio, npz, plenopticam, plenpy, ply, stanford, tiles or zarr.
    depth_mm
        Depth of the central view: the `DepthMap` of `estimate_depth`, or an array (v, u) of mm from the pupil. Optional
        for HCI and, as points, COLMAP and nerfstudio; required for PLY; ignored by others.
    min_confidence
        Points of a depth map must have a higher confidence; -1 keeps all.

    Raises
    ------
    InputError
        For an unknown format, a folder that exists and is not empty, whose files would mix with the new ones, and for
        light fields that the format cannot store: most need views in rows and columns.
    """
    from mirrorcam.optics.light_field.depth import DepthMap

    path = path_of("path", path)
    check_type("light_field", light_field, LightField)
    check_type("depth_mm", depth_mm, np.ndarray, DepthMap, type(None))
    if to not in NAMES:
        raise InputError(f"to: {to!r}, expected one of {', '.join(NAMES)}")
    form = formats()[to]
    if form.is_folder and path.exists() and (not path.is_dir() or any(path.iterdir())):
        raise InputError(f"{path}: exists, expected a new or empty folder")
    if form.needs_grid and not light_field.is_grid:
        others = [other.name for other in formats().values() if not other.needs_grid]
        raise InputError(
            f"{path}: {form.name} holds rows and columns of views, but these form another pattern, expected one of "
            f"{', '.join(others)}"
        )
    known = None
    if isinstance(depth_mm, DepthMap):
        sure = depth_mm.depth_mm
        if form.has_points:
            sure = np.where(depth_mm.confidence > min_confidence, sure, np.float32(np.nan))
        known = KnownDepth(sure, depth_mm.sigma_mm, depth_mm.confidence)
    elif depth_mm is not None:
        known = KnownDepth(depth_mm)
    form.write(path, light_field, known)


def name_of(path: Path) -> str:
    """Return the name of a light field: its file or folder name without the format's suffix."""
    name = path.resolve().name if path.is_dir() else path.name
    endings = (form.ending for form in formats().values())
    ending = max((ending for ending in endings if name.endswith(ending)), key=len, default=path.suffix)
    return name.removesuffix(ending) or name
