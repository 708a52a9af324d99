"""Landmarks of a key frame, and where another light field sees them.

A landmark is a patch of the key frame's reference view: its direction a = (X / Z, Y / Z) is exact, since the patch
defines it, and its inverse distance w = 1 / Z has a standard deviation. All views of another light field are aligned
with the patch, so that they tell its direction and its inverse distance there.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.light_field.features.align import Warp, align
from mirrorcam.optics.light_field.features.keypoints import grey_views, inner_masks
from mirrorcam.optics.light_field.features.light_field_features import shown_by_views
from mirrorcam.optics.light_field.features.patches import ImagePyramid, Templates, templates
from mirrorcam.optics.light_field.features.slope import Geometry, agreeing_views, fit, moderated_variance
from mirrorcam.optics.light_field.light_field import LightField

LEAST_ALIKE = 0.8
PRIOR_FREEDOM = 4.0


@dataclass(frozen=True, eq=False)
class Frame:
    """Grey views of a light field (t * s, v, u) in a pyramid, and masks of what they show."""

    pyramid: ImagePyramid
    inner: NDArray[np.uint8]

    @classmethod
    def of(cls, light_field: LightField) -> Frame:
        images = grey_views(light_field)
        grid = images.reshape(light_field.rows, light_field.cols, *images.shape[1:])
        return cls(ImagePyramid(grid), inner_masks(light_field))


@dataclass(frozen=True, eq=False)
class Landmarks:
    """Landmarks (n) of a key frame.

    Attributes
    ----------
    directions
        Directions (n, 2) from the reference view.
    inverse_mm, sigma_per_mm
        Inverse distances (n,) and the standard deviations of their noise, 1/mm.
    shape_sigma_per_mm
        Standard deviations (n,) of what shapes of surfaces add to that. A patch of which the shape is not quite known
        has the inverse distance that it seems to have, from wherever it is seen.
    shapes
        Shapes (n, 9) of their surfaces, as of `AlignedPatches`.
    given
        Their patches.
    """

    directions: FloatArray
    inverse_mm: FloatArray
    sigma_per_mm: FloatArray
    shape_sigma_per_mm: FloatArray
    shapes: FloatArray
    given: list[Templates]


@dataclass(frozen=True, eq=False)
class Seen:
    """Where a light field sees landmarks (n).

    Attributes
    ----------
    valid
        Whether (n,) it sees them at all; other values mean nothing where it does not.
    directions, covariance
        Directions (n, 2) and their covariances (n, 2, 2).
    inverse_mm, sigma_per_mm, shape_sigma_per_mm, shapes
        As of `Landmarks`.
    """

    valid: NDArray[np.bool_]
    directions: FloatArray
    covariance: FloatArray
    inverse_mm: FloatArray
    sigma_per_mm: FloatArray
    shape_sigma_per_mm: FloatArray
    shapes: FloatArray


def landmarks_of(
    geometry: Geometry, frame: Frame, directions: FloatArray, inverse_mm: FloatArray, scale_px: FloatArray, run: Any
) -> Landmarks:
    """Landmarks at directions (n, 2) and inverse distances (n,) of a light field that it sees there in most views."""
    pixels = geometry.focal_px[geometry.reference] * directions + geometry.centre_px[geometry.reference]
    given = templates(frame.pyramid, geometry.reference, pixels, scale_px)
    seen = see(geometry, frame, given, directions, inverse_mm, Warp.none(len(directions)), run)
    kept = np.flatnonzero(seen.valid)
    return Landmarks(
        directions=directions[kept],
        inverse_mm=seen.inverse_mm[kept],
        sigma_per_mm=seen.sigma_per_mm[kept],
        shape_sigma_per_mm=seen.shape_sigma_per_mm[kept],
        shapes=seen.shapes[kept],
        given=templates(frame.pyramid, geometry.reference, pixels[kept], scale_px[kept]),
    )


def see(
    geometry: Geometry,
    frame: Frame,
    given: list[Templates],
    directions: FloatArray,
    inverse_mm: FloatArray,
    warp: Warp,
    run: Callable[..., Any],
    max_distance_px: float = 0.5,
) -> Seen:
    """Align the views of a light field with patches expected at directions (n, 2) and inverse distances (n,).

    `warp` tells how they are seen there.
    """
    views = np.arange(len(geometry.focal_px))
    start = np.stack([geometry.predict(int(view), directions, inverse_mm) for view in views])
    start[~shown_by_views(frame.inner, start)] = np.nan
    distance = 1.0 / np.maximum(inverse_mm, 1e-6)
    aligned = align(frame.pyramid, given, views, start, geometry.across_mm, distance, run, warp)
    sure = (aligned.alike >= LEAST_ALIKE) & shown_by_views(frame.inner, aligned.pixels)
    seen_px = np.where(sure[..., None], aligned.pixels, np.nan)
    mean = np.trace(aligned.precision, axis1=1, axis2=2) / 2.0
    precision = aligned.precision / mean[:, None, None]
    used = agreeing_views(geometry, seen_px, inverse_mm, precision, max_distance_px)
    solved = fit(geometry, seen_px, used, inverse_mm, precision)
    usual = moderated_variance(solved.squares_px2, solved.freedom, PRIOR_FREEDOM)
    noise = np.maximum(usual, aligned.variance / mean)
    focal = geometry.focal_px[geometry.reference]
    # The patch's own noise moves all views alike; their own noise is less in their mean.
    times = 1.0 + 1.0 / np.maximum(used.sum(axis=0), 1)
    valid = (used.sum(axis=0) > len(views) // 2) & (solved.inverse_mm > 0)
    unsure = noise / np.where(valid, solved.information, 1.0)
    return Seen(
        valid=valid,
        directions=solved.directions,
        covariance=(noise * times)[:, None, None] * np.linalg.inv(precision) / focal**2,
        inverse_mm=solved.inverse_mm,
        sigma_per_mm=np.sqrt(unsure),
        shape_sigma_per_mm=np.sqrt(aligned.shape_covariance[:, 0, 0]) / focal,
        shapes=aligned.shapes,
    )
