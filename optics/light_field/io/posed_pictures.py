"""Light fields of pictures with known cameras, as structure-from-motion tools state them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.disk.array_files import check_bytes
from mirrorcam.core.errors import InputError
from mirrorcam.core.images.pictures import read_image, read_opacity, set_common_bit_depth
from mirrorcam.optics.light_field.camera_array import MAX_VIEWS, PosedCamera, common_orientation, rectified
from mirrorcam.optics.light_field.io.light_field_format import Assumed, Contents
from mirrorcam.optics.light_field.io.view_images import Bytes, check_size, weights_of
from mirrorcam.optics.light_field.light_field import LightField

_PIXEL_BYTES = 7
"""Bytes per pixel of a view: three for colour, and four for the weight."""


@dataclass(frozen=True, eq=False)
class PosedPicture:
    """A picture, the picture of its weights or None, and its camera in mm."""

    file: Path
    mask: Path | None
    posed: PosedCamera


def read_posed(path: Path, pictures: Sequence[PosedPicture], assumed: Assumed) -> Contents:
    """Read the light field of pictures in any order, rectified if their cameras are not parallel or not alike.

    An assumed step scales all lengths, as the files of these tools have no unit, and an assumed reference depth
    replaces that of the cameras. A note says what is lost. Raises a one-line InputError, beginning with `path`, if
    pictures do not fit their cameras, or are not the views of a light field.
    """
    if not 1 <= len(pictures) <= MAX_VIEWS:
        raise InputError(f"{path}: {len(pictures)} pictures, expected 1 to {MAX_VIEWS} views of a light field")
    cameras = [picture.posed for picture in pictures]
    common_orientation(cameras, f"{path}: ")  # before anything is read
    files = [picture.file for picture in pictures]
    largest = max(picture.posed.camera.width_px * picture.posed.camera.height_px for picture in pictures)
    stored = sum(file.stat().st_size for file in files if file.is_file())
    check_bytes(path, _PIXEL_BYTES * largest * len(files), stored)
    has_bit_depth = False

    def load(number: int) -> tuple[Bytes, NDArray[np.float32] | None]:
        nonlocal has_bit_depth
        if not has_bit_depth:
            set_common_bit_depth(files)
            has_bit_depth = True
        picture = pictures[number]
        size = (picture.posed.camera.width_px, picture.posed.camera.height_px)
        colours = read_image(picture.file)
        check_size(picture.file, colours, size)
        if picture.mask is None:
            opacity = read_opacity(picture.file)
        else:
            opacity = read_image(picture.mask, grey=True)
            check_size(picture.mask, opacity, size)
        return colours, None if opacity is None or (opacity.all() and opacity.min() == 255) else weights_of(opacity)

    result = rectified(cameras, load, f"{path}: ", assumed.reference_depth_mm)
    light_field = LightField(**result.geometry, samples=result.samples, weights=result.weights)
    if assumed.step_mm is not None and len(pictures) > 1:
        light_field = _scaled(light_field, assumed.step_mm)
    return Contents((light_field,), notes=() if result.note is None else (result.note,))


def _scaled(light_field: LightField, step_mm: float) -> LightField:
    """Return the light field with all lengths scaled so that its mean step is `step_mm`."""
    step = light_field.step_mm("s" if light_field.cols > 1 else "t")
    if step <= 0:
        raise InputError("all cameras have the same position, expected different ones for a step")
    scale = step_mm / step
    return replace(
        light_field,
        positions_mm=scale * light_field.positions_mm,
        reference_depth_mm=scale * light_field.reference_depth_mm,
        reference_view_in_rig_mm=scale * light_field.reference_view_in_rig_mm,
    )
