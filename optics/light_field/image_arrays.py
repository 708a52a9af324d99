"""Pictures, weights and poses as arrays, for `LightField.from_views`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray, array_of
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.light_field.camera_array import PosedCamera, Rectified, arrangement, rectified

MAX_POSE_ERROR = 1e-4
"""Maximum deviation of a pose from a rigid transform."""
Picture = NDArray[Any]


def pictures_of(images: NDArray[Any] | Sequence[ArrayLike]) -> tuple[list[Picture], tuple[int, int] | None]:
    """Return pictures (h, w, c), uint8 or float32 from 0 to 1, and their rows and columns if the array has them.

    An array of four dimensions has colours if its last one is 1 or 3.
    """
    grid = None
    if isinstance(images, np.ndarray):
        has_colour = images.ndim == 5 or (images.ndim == 4 and images.shape[-1] in (1, 3))
        if images.ndim - has_colour == 4:
            grid = (images.shape[0], images.shape[1])
            images = images.reshape(-1, *images.shape[2:])
        elif images.ndim - has_colour != 3:
            raise InputError(f"images have shape {images.shape}, expected (t, s, h, w[, c]) or (n, h, w[, c])")
    pictures = [_picture(number, np.asarray(image)) for number, image in enumerate(images)]
    if not pictures:
        raise InputError("no images, expected at least one")
    if len({(picture.dtype.str, picture.shape[-1]) for picture in pictures}) > 1:
        raise InputError("images differ in type or colours, expected all grey or all RGB, of one type")
    return pictures, grid


def _picture(number: int, image: Picture) -> Picture:
    if image.ndim == 2:
        image = image[..., None]
    if image.ndim != 3 or image.shape[-1] not in (1, 3) or not image.size:
        raise InputError(f"image {number} has shape {image.shape}, expected (h, w), (h, w, 1) or (h, w, 3)")
    if image.dtype == np.uint8:
        return image
    if image.dtype.kind not in "fu":
        raise InputError(f"image {number} is {image.dtype}, expected uint8, uint16 or floats from 0 to 1")
    picture = image.astype(np.float32)
    if image.dtype.kind == "u":
        return picture / np.float32(np.iinfo(image.dtype).max)
    if not (np.isfinite(picture).all() and picture.min() >= 0 and picture.max() <= 1):
        raise InputError(f"image {number} has values outside 0 to 1, expected floats from 0 to 1, or uint8")
    return picture


def positions_of(
    grid: tuple[int, int] | None, step_mm: float | None, positions_mm: ArrayLike | None, count: int
) -> tuple[FloatArray, NDArray[np.int_]]:
    """Return positions (t, s, 2 or 3) of views, and the number (t, s) of the picture of each.

    Without a grid, a step means a row, and positions are arranged in the rows and columns that they fit.
    """
    numbers = np.arange(count).reshape(grid or (1, count))
    if positions_mm is None:
        if step_mm is None or not (np.isfinite(step_mm) and step_mm > 0):
            raise InputError(f"step_mm: {step_mm}, expected a positive number")
        t, s = np.indices(numbers.shape)
        return np.stack([s, t], axis=-1).astype(np.float64) * float(step_mm), numbers
    positions = numbers_in("positions_mm", positions_mm)
    if positions.shape[-1:] not in {(2,), (3,)} or positions.size != count * positions.shape[-1]:
        raise InputError(f"positions_mm has shape {positions.shape}, expected {count} views with 2 or 3 numbers")
    flat = positions.reshape(count, -1)
    order = arrangement(flat[:, :2]) if grid is None and positions.ndim == 2 else numbers
    if grid is None and positions.ndim == 3:
        order = numbers.reshape(positions.shape[:2])
    return flat[order], order


def weights_of(weights: NDArray[Any] | Sequence[ArrayLike] | None, pictures: Sequence[Picture]) -> list[Any]:
    """Return the weights (h, w) of pictures, float32; None for full weight."""
    if weights is None:
        return [None] * len(pictures)
    if isinstance(weights, np.ndarray) and weights.ndim == 4:
        weights = weights.reshape(-1, *weights.shape[2:])
    arrays = [np.asarray(weight, np.float32) for weight in weights]
    shapes = [picture.shape[:2] for picture in pictures]
    if [array.shape for array in arrays] != shapes:
        raise InputError(f"weights do not have the shapes of the images, such as {shapes[0]}")
    if not all(np.isfinite(array).all() and array.min() >= 0 and array.max() <= 1 for array in arrays):
        raise InputError("weights must lie within 0 to 1")
    return arrays


def rectified_pictures(
    pictures: Sequence[Picture],
    weights: NDArray[Any] | Sequence[ArrayLike] | None,
    poses: ArrayLike,
    focal_px: ArrayLike,
    centre_px: ArrayLike | None,
    distortion: ArrayLike,
    reference_depth_mm: float | None,
) -> Rectified:
    """Return the light field of cameras in any poses; arguments are those of `LightField.from_views`."""
    count = len(pictures)
    worlds = numbers_in("poses", poses)
    if worlds.shape[-2:] != (4, 4) or worlds.size != 16 * count:
        raise InputError(f"poses have shape {worlds.shape}, expected ({count}, 4, 4)")
    worlds = worlds.reshape(count, 4, 4)
    rotations = worlds[:, :3, :3]
    off = np.abs(rotations @ rotations.transpose(0, 2, 1) - np.eye(3)).max()
    if off > MAX_POSE_ERROR or (np.linalg.det(rotations) < 0).any() or (worlds[:, 3] != [0, 0, 0, 1]).any():
        raise InputError("poses are not rigid transforms world_from_camera")
    focal = _each("focal_px", focal_px, count, 0)
    lens = _each("distortion", distortion, count, 1)
    sizes = np.array([picture.shape[1::-1] for picture in pictures])
    centre = (sizes - 1) / 2.0 if centre_px is None else _each("centre_px", centre_px, count, 1)
    cameras = [
        PosedCamera(
            f"image {number}",
            Camera(
                width_px=sizes[number, 0],
                height_px=sizes[number, 1],
                fx_px=focal[number],
                fy_px=focal[number],
                cx_px=centre[number, 0],
                cy_px=centre[number, 1],
                distortion=lens[number],
            ),
            worlds[number],
        )
        for number in range(count)
    ]
    arrays = weights_of(weights, pictures)
    return rectified(cameras, lambda number: (pictures[number], arrays[number]), reference_depth_mm=reference_depth_mm)


def _each(name: str, values: ArrayLike, count: int, axes: int) -> FloatArray:
    """Return numbers per picture (n, ...), from those of all or of each."""
    array = numbers_in(name, values)
    if array.ndim == axes:
        array = np.broadcast_to(array, (count, *array.shape))
    if array.ndim != axes + 1 or len(array) != count:
        raise InputError(f"{name} has shape {array.shape}, expected one for all, or {count}")
    return array


def numbers_in(name: str, values: ArrayLike, shape: tuple[int, ...] | None = None) -> FloatArray:
    """Return an argument as an array of finite numbers, of a shape if given; raises like `array_of`."""
    return array_of(name, values, *((...,) if shape is None else shape), finite=True)
