"""Refocusing after capture: all views, warped to a focal plane as seen by the reference view, are combined.

A plane a X + b Y + c Z = 1 of the view frame induces a homography between two pinholes (Hartley and Zisserman, Multiple
View Geometry, 13.1): with p = (a, b, c), a reference pixel of direction r shows the plane's point r / (p . r), which
the view at c_i with matrix K_i shows at K_i (I - c_i p^T) r. Irregular positions thus cost no more than a regular grid.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.light_field.depth.parallax import reference_index
from mirrorcam.optics.light_field.light_field import LightField, Views
from mirrorcam.optics.light_field.render.linear_light import levels_from_light, light_from_levels
from mirrorcam.optics.light_field.render.super_resolution import super_resolve

Float32 = NDArray[np.float32]
Combine = Literal["mean", "median"]

MIN_WEIGHT = 1e-3
"""Weight below which a pixel has no sample."""
MAX_SCALE = 8
MAX_TILT_DEG = 85.0
ROWS_PER_BLOCK = 64


@dataclass(frozen=True, eq=False)
class RenderedPicture:
    """A picture combined from several views, in the frame of the reference view.

    Attributes
    ----------
    image
        Picture (h, w, c), float32, 0 to 1, zero where `weights` is zero.
    weights
        Sum (h, w), float32, of the weights of the samples in each pixel.
    """

    image: Float32
    weights: Float32

    @property
    def valid(self) -> NDArray[np.bool_]:
        """Mask (h, w) of the pixels with samples."""
        return self.weights > 0


@dataclass(frozen=True)
class FocalPlane:
    """The plane of all (X, Y, Z) in the view frame, mm, with normal . (X, Y, Z) = 1; normal (0, 0, 0) is infinity."""

    normal_per_mm: tuple[float, float, float]

    @classmethod
    def at_depth(cls, views: Views, depth_mm: float, tilt_deg: tuple[float, float] = (0.0, 0.0)) -> FocalPlane:
        """Return the plane at a depth from the pupil, possibly infinite, at the centre of the reference view's picture.

        `tilt_deg` tilts it about that point: the first angle moves its right side away, the second its lower side.

        Raises InputError if the plane is not in front of all views, or so steep that the reference view sees its back.
        """
        if not all(abs(angle) <= MAX_TILT_DEG for angle in tilt_deg):
            raise InputError(f"tilt of {tilt_deg[0]:g} and {tilt_deg[1]:g} degrees, expected at most {MAX_TILT_DEG:g}")
        reference_view_depth_mm = views.reference_view_depth_mm
        min_depth_mm = reference_view_depth_mm + max(float(views.positions_mm[..., 2].max()), 0.0)
        if not depth_mm > min_depth_mm:
            raise InputError(
                f"focus at {depth_mm:g} mm, expected a depth beyond the views, more than {min_depth_mm:.0f} mm"
            )
        slope = np.tan(np.radians(tilt_deg))
        size = np.array([views.width_px, views.height_px])
        picture_centre = ((size - 1.0) / 2.0 - views.centre_px) / views.focal_px
        front = 1.0 - float(slope @ picture_centre)
        if front <= 0:
            raise InputError(f"tilt of {tilt_deg[0]:g} and {tilt_deg[1]:g} degrees would show the back of the plane")
        inverse_distance = 1.0 / ((depth_mm - reference_view_depth_mm) * front)
        return cls((float(-slope[0] * inverse_distance), float(-slope[1] * inverse_distance), float(inverse_distance)))

    @classmethod
    def through(cls, views: Views, pixels: FloatArray, depths_mm: FloatArray) -> FocalPlane:
        """Fit the plane through three or more reference pixels (n, 2) at depths (n,), by least squares of 1 / Z.

        Raises InputError if the pixels are collinear.
        """
        reference_view_depth_mm = views.reference_view_depth_mm
        directions = (np.asarray(pixels, dtype=np.float64) - views.centre_px) / views.focal_px
        rays = np.concatenate([directions, np.ones((len(directions), 1))], axis=1)
        normal, _, rank, _ = np.linalg.lstsq(
            rays, 1.0 / (np.asarray(depths_mm, dtype=np.float64) - reference_view_depth_mm), rcond=None
        )
        if rank < 3:
            raise InputError(f"{len(rays)} pixels are collinear, expected three or more that span a plane")
        return cls((float(normal[0]), float(normal[1]), float(normal[2])))

    def inverse_distance(self, views: Views) -> FloatArray:
        """Return 1 / Z (v, u), 1/mm, where the reference view's rays meet the plane; negative where they do not."""
        directions = (views.pixel_grid() - views.centre_px) / views.focal_px
        return directions @ np.array(self.normal_per_mm[:2]) + self.normal_per_mm[2]


def homography(views: Views, index: tuple[int, int], plane: FocalPlane) -> FloatArray:
    """Return the homography (3, 3) of a plane from reference pixels (u, v, 1) to w (u', v', 1) of view (t, s).

    w is positive for points in front of the view.
    """
    reference = views.matrices[reference_index(views)]
    displacement = np.eye(3) - np.outer(views.positions_mm[index], plane.normal_per_mm)
    return np.asarray(views.matrices[index] @ displacement @ np.linalg.inv(reference))


def aperture(views: Views, sigma_mm: float | None = None) -> Float32:
    """Return Gaussian weights (t, s) of the views, for a blur without hard-edged ghosts.

    They fall with distance from the reference view; the default sigma is the RMS of these distances.
    """
    distance_squared = np.square(views.positions_mm[..., :2]).sum(axis=-1)
    others = distance_squared[distance_squared > 0]
    if sigma_mm is None:
        sigma_mm = float(np.sqrt(others.mean())) if len(others) else 1.0
    return np.exp(-distance_squared / (2.0 * sigma_mm**2)).astype(np.float32)


def refocus(
    light_field: LightField,
    plane: FocalPlane,
    *,
    combine: Combine = "mean",
    view_weights: Float32 | None = None,
    scale: float = 1.0,
) -> RenderedPicture:
    """Render the picture in focus on a plane, in the frame of the reference view.

    Parameters
    ----------
    light_field
        Two or more views.
    plane
        The focal plane, from `FocalPlane.at_depth` or `FocalPlane.through`.
    combine
        `mean` blurs objects off the plane; `median` removes those that few views show.
    view_weights
        Weights (t, s) of the views, for the mean.
    scale
        Pixels of the picture per pixel of a view. Above 1, the picture that best explains all samples is computed
        (`super_resolve`): views that sample between each other's pixels resolve more than one view does. With the
        median, absolute differences are minimised.

    Returns
    -------
    RenderedPicture
        Image (h, w, c) from 0 to 1 and weights (h, w).

    Raises
    ------
    InputError
        If the scale is out of range.

    Notes
    -----
    Samples are assumed to be sRGB grey levels: they are averaged as light and converted back to sRGB.
    """
    if view_weights is not None and combine != "mean":
        raise ValueError(f"{combine=} does not support weights of views, expected the mean")
    if not 1 <= scale <= MAX_SCALE:
        raise InputError(f"scale is {scale:g}, expected 1 to {MAX_SCALE}")
    size = round(light_field.width_px * scale), round(light_field.height_px * scale)
    # Pixel centres: the first of `scale` fine pixels is offset by (1 - scale) / (2 scale) from the view's pixel.
    coarse_from_fine = np.diag([1.0 / scale, 1.0 / scale, 1.0])
    coarse_from_fine[:2, 2] = (1.0 - scale) / (2.0 * scale)
    in_front = _plane_in_front(light_field, plane, coarse_from_fine, size)
    indices = list(np.ndindex(light_field.rows, light_field.cols))
    matrices = [homography(light_field, index, plane) @ coarse_from_fine for index in indices]
    views = [_weighted_light(light_field, index) for index in indices]

    def warp_view(view: Float32, matrix: FloatArray, index: tuple[int, int]) -> Float32:
        warped = _warp(view, matrix, size)
        if view_weights is not None:
            warped *= view_weights[index]
        return warped

    with ThreadPoolExecutor(max(1, cv2.getNumThreads())) as pool:
        warped = pool.map(warp_view, views, matrices, indices)
        total = sample_median(list(warped)) if combine == "median" else _sum(warped)
    if in_front is not None:
        total *= in_front[..., None]
    picture = normalised_picture(total)
    if scale > 1:
        picture = _super_resolve(picture, views, indices, matrices, view_weights, scale, combine)
    return RenderedPicture(levels_from_light(picture.image), picture.weights)


def _super_resolve(
    picture: RenderedPicture,
    views: Sequence[Float32],
    indices: Sequence[tuple[int, int]],
    matrices: Sequence[FloatArray],
    view_weights: Float32 | None,
    scale: float,
    combine: Combine,
) -> RenderedPicture:
    """Refine a picture of light by the views (v, u, c + 1), weighted light and weights, to a finer scale."""
    weights = [view[..., -1] for view in views]
    light = [
        np.divide(view[..., :-1], view[..., -1:], out=np.zeros_like(view[..., :-1]), where=view[..., -1:] > 0)
        for view in views
    ]
    if view_weights is not None:
        weights = [weight * view_weights[index] for weight, index in zip(weights, indices, strict=True)]
    image = super_resolve(
        light,
        weights,
        [np.asarray(np.linalg.inv(matrix), dtype=np.float64) for matrix in matrices],
        picture.image,
        scale,
        absolute=combine == "median",
    )
    return RenderedPicture(image * picture.valid[..., None], picture.weights)


def premultiplied(light_field: LightField, index: tuple[int, int]) -> Float32:
    """Return a view's samples, 0 to 1, times their weights, and the weights: (v, u, c + 1), float32."""
    samples: Any = light_field.samples[index]
    weights = light_field.weights[index][..., None]
    unit = np.float32(1.0 / 255.0) if samples.dtype == np.uint8 else np.float32(1.0)
    return np.concatenate([samples * (weights * unit), weights], axis=-1, dtype=np.float32)


def _weighted_light(light_field: LightField, index: tuple[int, int]) -> Float32:
    """Return a view's light times its weights, and the weights: (v, u, c + 1), float32."""
    weights = light_field.weights[index][..., None]
    return np.concatenate([light_from_levels(light_field.samples[index]) * weights, weights], axis=-1, dtype=np.float32)


def normalised_picture(total: Float32) -> RenderedPicture:
    """Normalise sums (h, w, c + 1) of weighted samples and weights to a picture."""
    weights = total[..., -1]
    valid = weights > MIN_WEIGHT
    reciprocal = np.where(valid, 1.0 / np.maximum(weights, np.float32(MIN_WEIGHT)), np.float32(0.0))
    return RenderedPicture(total[..., :-1] * reciprocal[..., None].astype(np.float32), np.where(valid, weights, 0.0))


def sample_median(parts: list[Float32]) -> Float32:
    """Return the median of weighted samples, per channel, times their number, and the number: (h, w, c + 1).

    An even number of samples gives the mean of the two middle ones. A sample counts if its weight is at least half.
    """
    height, width, channels = parts[0].shape
    total = np.zeros((height, width, channels), np.float32)
    for start in range(0, height, ROWS_PER_BLOCK):
        block = np.stack([part[start : start + ROWS_PER_BLOCK] for part in parts])
        valid = block[..., -1:] >= 0.5
        values = np.divide(block[..., :-1], block[..., -1:], out=np.full_like(block[..., :-1], np.inf), where=valid)
        values.sort(axis=0)
        count = np.count_nonzero(valid, axis=0)
        lower_index, upper_index = np.maximum(count - 1, 0)[None] // 2, np.minimum(count, len(parts) - 1)[None] // 2
        shape = (1, *values.shape[1:])
        lower = np.take_along_axis(values, np.broadcast_to(lower_index, shape), axis=0)[0]
        upper = np.take_along_axis(values, np.broadcast_to(np.where(count > 0, upper_index, 0), shape), axis=0)[0]
        median = np.where(count > 0, np.float32(0.5) * (lower + upper), np.float32(0.0))
        total[start : start + ROWS_PER_BLOCK] = np.concatenate([median * count, count], axis=-1)
    return total


def _sum(parts: Iterator[Float32]) -> Float32:
    total = next(parts)
    for part in parts:
        total += part
    return total


def _warp(picture: Float32, matrix: NDArray[np.floating], size: tuple[int, int]) -> Float32:
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    if np.abs(matrix[2, :2]).max() < 1e-12 * abs(matrix[2, 2]):
        return np.asarray(cv2.warpAffine(picture, matrix[:2] / matrix[2, 2], size, flags=flags), dtype=np.float32)
    return np.asarray(cv2.warpPerspective(picture, matrix, size, flags=flags), dtype=np.float32)


def _plane_in_front(
    views: Views, plane: FocalPlane, coarse_from_fine: FloatArray, size: tuple[int, int]
) -> Float32 | None:
    """Return the mask (h, w), as float, of where the plane is in front of all views; None if it is everywhere."""
    reference = np.linalg.inv(views.matrices[reference_index(views)])
    plane_row = np.array(plane.normal_per_mm) @ reference
    in_front = [homography(views, index, plane)[2] for index in np.ndindex(views.rows, views.cols)]
    corners = np.array([[0, 0, 1], [size[0] - 1, 0, 1], [0, size[1] - 1, 1], [size[0] - 1, size[1] - 1, 1.0]])
    corners = corners @ coarse_from_fine.T
    if (corners @ plane_row >= 0).all() and (corners @ np.array(in_front).T > 0).all():
        return None
    columns, lines = np.meshgrid(np.arange(size[0]), np.arange(size[1]))
    fine = np.stack([columns, lines, np.ones_like(columns)], axis=-1) @ coarse_from_fine.T
    return np.asarray((fine @ plane_row >= 0) & (fine @ np.array(in_front).T > 0).all(axis=-1), dtype=np.float32)


def to_bytes(picture: RenderedPicture, missing: tuple[int, int, int] = (64, 64, 64)) -> NDArray[np.uint8]:
    """Convert a picture to 8-bit RGB (h, w, 3), dark grey where there is no sample."""
    image = np.rint(np.clip(picture.image, 0.0, 1.0) * np.float32(255.0)).astype(np.uint8)
    return np.where(picture.valid[..., None], image, np.array(missing, dtype=np.uint8))
