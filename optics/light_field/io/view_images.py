"""Views as 8-bit pictures, with weights as opacity or as a separate picture; and all views in one picture."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.disk.array_files import check_bytes
from mirrorcam.core.disk.files import write_bytes
from mirrorcam.core.errors import InputError
from mirrorcam.core.images.pictures import picture_size, read_image, read_opacity, set_common_bit_depth
from mirrorcam.optics.light_field.light_field import LightField, Samples, Views

Bytes = NDArray[np.uint8]
_PIXEL_BYTES = 7
"""Bytes per pixel of a view: three for colour, and four for the weight."""
SEPARATOR_PX = 3
SEPARATOR_GREY = 255
INVALID_GREY = 64
RATIOS = (1.0, 0.7, 1.4, 0.5, 2.0)
"""Candidate ratios of horizontal to vertical distances; the one with the smallest picture is chosen."""
LARGE_DISTANCE = 1e6


def as_bytes(samples: Samples) -> Bytes:
    """Convert samples of either type to 8 bits."""
    if samples.dtype == np.uint8:
        return np.asarray(samples, np.uint8)
    scaled: Any = np.clip(samples, 0.0, 1.0)
    return np.asarray(np.rint(scaled * np.float32(255.0)), np.uint8)


def weight_bytes(weights: NDArray[np.float32]) -> Bytes:
    """Convert weights from 0 to 1 to bytes; positive ones stay positive."""
    return np.where(weights > 0, np.clip(np.rint(weights * 255.0), 1, 255), 0).astype(np.uint8)


def weights_of(opacity: Bytes) -> NDArray[np.float32]:
    """Convert bytes written by `weight_bytes` back to weights."""
    return opacity.astype(np.float32) / np.float32(255.0)


def rgb(samples: Samples) -> Bytes:
    """Convert samples (..., 1) or (..., 3) to 8-bit RGB (..., 3)."""
    colours = as_bytes(samples)
    return np.ascontiguousarray(np.broadcast_to(colours, (*colours.shape[:-1], 3)))


def write_rgba(path: Path, colours: Bytes, opacity: Bytes | None) -> None:
    """Write a picture (h, w, 3) in RGB, and its opacity (h, w) if given, as PNG."""
    bgr = colours[..., ::-1]
    picture = bgr if opacity is None else np.concatenate([bgr, opacity[..., None]], axis=-1)
    encoded, buffer = cv2.imencode(".png", np.ascontiguousarray(picture))
    if not encoded:
        raise InputError(f"{path}: {picture.shape[1]}x{picture.shape[0]} px cannot be written as PNG")
    write_bytes(path, buffer.tobytes())


def common_size(pictures: Sequence[Path]) -> tuple[int, int]:
    """Return width and height of one light field's pictures from the first one's header, and set a common bit depth.

    Raises InputError if all together would take more memory than is plausible for their files. The other pictures'
    sizes must be checked on reading.
    """
    width, height = picture_size(pictures[0])
    stored = sum(picture.stat().st_size for picture in pictures if picture.is_file())
    check_bytes(pictures[0], _PIXEL_BYTES * width * height * len(pictures), stored)
    set_common_bit_depth(pictures)
    return width, height


def read_rgba(path: Path) -> tuple[Bytes, Bytes]:
    """Read colours (h, w, 3) in RGB and opacity (h, w) of a picture; opacity is 255 if the picture has none."""
    common_size([path])
    colours, opacity = read_image(path), read_opacity(path)
    return colours, np.full(colours.shape[:2], 255, np.uint8) if opacity is None else opacity


def light_field_of(views: Views, colours: Bytes, opacity: Bytes, channels: int = 3) -> LightField:
    """Build a light field of pictures (t, s, v, u, 3) and opacities (t, s, v, u); samples without weight are zero."""
    samples: Any = np.ascontiguousarray(colours[..., :channels])
    samples[opacity == 0] = 0
    return LightField.of(views, samples, weights_of(opacity))


def check_size(path: Path, picture: NDArray[Any], size: tuple[int, int]) -> None:
    """Raise InputError if a picture (h, w, ...) has a different width or height."""
    if (picture.shape[1], picture.shape[0]) != size:
        raise InputError(f"{path}: {picture.shape[1]}x{picture.shape[0]} px, expected {size[0]}x{size[1]}")


def tiled_views(light_field: LightField) -> NDArray[np.uint8]:
    """Arrange the views in one picture (h, w, 3), RGB, by their positions; dark grey where a view has no sample.

    For a grid, row t is below row t - 1.
    """
    samples = light_field.samples
    if samples.dtype == np.float32:
        samples = np.rint(np.clip(samples.astype(np.float32), 0.0, 1.0) * 255.0).astype(np.uint8)
    height, width = light_field.height_px, light_field.width_px
    corners = _tile_corners(light_field, np.array([width, height]) + SEPARATOR_PX)
    max_left, max_top = corners.reshape(-1, 2).max(axis=0)
    picture = np.full((max_top + height, max_left + width, 3), SEPARATOR_GREY, dtype=np.uint8)
    for t, s in np.ndindex(light_field.rows, light_field.cols):
        left, top = corners[t, s]
        tile = picture[top : top + height, left : left + width]
        tile[:] = samples[t, s]
        tile[~light_field.valid[t, s]] = INVALID_GREY
    return picture


def _tile_corners(light_field: LightField, tile_px: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return left and top (t, s, 2) of each view in a picture of non-overlapping tiles of size (width, height)."""
    if light_field.is_grid:
        t, s = np.indices((light_field.rows, light_field.cols))
        return np.stack([s, t], axis=-1) * tile_px
    positions = light_field.positions_mm[..., :2].reshape(-1, 2) / tile_px
    distances = np.abs(positions[:, None] - positions)[~np.eye(len(positions), dtype=bool)]
    scales = []
    for ratio in RATIOS:
        # Two tiles are separated along the axis of the larger distance between their views.
        horizontal = distances[:, 0] * ratio >= distances[:, 1]
        min_distances = (
            distances[horizontal, 0].min(initial=LARGE_DISTANCE),
            distances[~horizontal, 1].min(initial=LARGE_DISTANCE),
        )
        scales.append(1.0 / np.array(min_distances))
    scale = min(scales, key=lambda scale: float(np.prod(scale * np.ptp(positions, axis=0) + 1.0)))
    return np.ceil((positions - positions.min(axis=0)) * scale * tile_px).astype(np.int64)[None]
