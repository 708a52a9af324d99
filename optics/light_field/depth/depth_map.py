"""Depth maps of the reference view, with uncertainty, confidence and the views that define their frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.light_field.light_field import Axis, Views

Float32 = NDArray[np.float32]


@dataclass(frozen=True, eq=False, kw_only=True)
class DepthMap:
    """Depth of the reference view, pixel by pixel.

    Attributes
    ----------
    views : Views
        Geometry of the light field used for the measurement.
    view : tuple of int
        Row t and column s of the reference view.
    depth_mm : ndarray of float32
        (v, u), from the pupil along view z; NaN where fewer than two other views see the point.
    sigma_mm : ndarray of float32
        (v, u), standard deviation of the depth; where `confidence` is low, it includes wrong depths, and where nothing
        determines the depth, it is as wide as the search. NaN without depth.
    confidence : ndarray of float32
        (v, u), probability that the depth is right to within half a pixel of disparity at the longest baseline; 0
        without depth.
    """

    views: Views
    view: tuple[int, int]
    depth_mm: Float32
    sigma_mm: Float32
    confidence: Float32

    def __post_init__(self) -> None:
        expected = (self.views.height_px, self.views.width_px)
        for name in ("depth_mm", "sigma_mm", "confidence"):
            array = getattr(self, name)
            if array.shape != expected or array.dtype != np.float32:
                raise ValueError(f"{name} is {array.dtype} of shape {array.shape}, expected float32 {expected}")
            read_only = array.view()
            read_only.flags.writeable = False
            object.__setattr__(self, name, read_only)

    @property
    def valid(self) -> NDArray[np.bool_]:
        """Mask (v, u) of the pixels with a depth."""
        return np.isfinite(self.depth_mm)

    def disparity_px(self, axis: Axis = "s") -> FloatArray:
        """Disparity (v, u) in px per mean view step, positive nearer than the reference plane; NaN without depth."""
        return self.views.disparity_px_from_depth(self.depth_mm.astype(np.float64), axis)

    def points_in_rig(self) -> FloatArray:
        """The points (v, u, 3) in the rig frame, mm, that the pixels show; NaN without depth."""
        reference_view_depth_mm = self.views.reference_view_depth_mm
        distance = self.depth_mm.astype(np.float64) - reference_view_depth_mm
        offsets = (self.views.pixel_grid() - self.views.centre_px) * (distance / self.views.focal_px)[..., None]
        in_view = np.concatenate([offsets, distance[..., None]], axis=-1)
        return in_view @ self.views.view_from_rig + self.views.reference_view_in_rig_mm
