"""Images of points in mirrors as they appear to the pupil, and the derivatives of these images.

One formula serves `Mirror.image_of` and the calibration. Arrays are as in `mirror_arrays`: component first, a column
for each point.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.bent_imaging import BentImages
from mirrorcam.optics.geometry.mirror_arrays import ImageDerivatives, MirrorArrays, MirrorImages, dot
from mirrorcam.optics.geometry.plate_imaging import PlateImages


def images(points_mm: FloatArray, mirrors: MirrorArrays, *, bent: bool = False) -> MirrorImages:
    """Images of points in mirrors, exact in direction.

    Parameters
    ----------
    points_mm : points (3, n) in rig.
    mirrors : the mirror that each point is seen in.
    bent : whether derivatives by the curvature are asked for where mirrors are flat, too.

    Returns
    -------
    Images (3, n) in rig and their derivatives. They are NaN for a point that is not before a second-surface or a bent
    mirror.
    """
    if bent or np.any(mirrors.curvature_per_m):
        return BentImages.of(points_mm, mirrors)
    return PlateImages.of(points_mm, mirrors) if np.any(mirrors.thickness_mm) else PlainImages.of(points_mm, mirrors)


@dataclass(frozen=True)
class PlainImages:
    """Images (3, n) in flat first-surface mirrors."""

    image_mm: FloatArray
    _point_mm: FloatArray
    _centre_mm: FloatArray
    _squared_mm2: FloatArray
    _along: FloatArray

    @classmethod
    def of(cls, points_mm: FloatArray, mirrors: MirrorArrays) -> PlainImages:
        centre = mirrors.centre_mm
        squared = dot(centre, centre)
        along = dot(points_mm, centre) / squared
        return cls(points_mm - (2.0 * along - 1.0) * centre, points_mm, centre, squared, along)

    def vjp(self, by_image: FloatArray) -> ImageDerivatives:
        """See `MirrorImages.vjp`: x' = x - (2 x.c / |c|^2 - 1) c; zeros by the thickness, none by the curvature."""
        to_centre = 2.0 * dot(by_image, self._centre_mm) / self._squared_mm2
        point = by_image - to_centre[:, None] * self._centre_mm
        centre = (1.0 - 2.0 * self._along) * by_image - to_centre[:, None] * (
            self._point_mm - 2.0 * self._along * self._centre_mm
        )
        none = np.empty((len(by_image), 0, by_image.shape[-1]))
        return ImageDerivatives(point, centre, np.zeros_like(to_centre), none)
