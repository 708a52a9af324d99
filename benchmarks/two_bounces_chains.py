"""Chains of flat mirrors, one of each view: what light does that meets one after the other."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.camera import Camera

SQUARE = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
THICKNESS_MM = 1.0


@dataclass(frozen=True)
class Question:
    """What is asked for: views, mirrors per view, the angle from the camera's axis to that of the views, a box."""

    rows: int
    cols: int
    bounces: int
    fold_deg: float
    box_mm: tuple[float, float, float]
    least_efficiency: float = 0.0
    depths_mm: tuple[float, ...] = (300.0, 500.0)
    camera: Camera = field(default_factory=Camera.c920)

    @property
    def view_from_rig(self) -> FloatArray:
        cosine, sine = np.cos(np.deg2rad(self.fold_deg)), np.sin(np.deg2rad(self.fold_deg))
        return np.array([[1.0, 0.0, 0.0], [0.0, cosine, -sine], [0.0, sine, cosine]])

    @property
    def half_field(self) -> FloatArray:
        return np.array([self.camera.width_px, self.camera.height_px]) / (2.0 * self.camera.fx_px)


@dataclass(frozen=True)
class Chain:
    """The mirrors of one view, in the order of the light, in rig, mm.

    Attributes
    ----------
    normals
        Unit normals (bounces, 3) along the light that arrives; each plane is normal . x = offset.
    offsets_mm
        Offsets (bounces,).
    outlines_mm
        Corners (bounces, 4, 3) of the reflecting faces.
    cell
        Corners (4, 2) of the part of the sensor, normalized, that the whole pupil serves.
    """

    normals: FloatArray
    offsets_mm: FloatArray
    outlines_mm: FloatArray
    cell: FloatArray

    def scene_from_unfolded(self, points: FloatArray) -> FloatArray:
        """Points (..., 3) on straight continued light, after the last mirror."""
        for normal, offset in zip(self.normals, self.offsets_mm, strict=True):
            points = points - 2.0 * (points @ normal - offset)[..., None] * normal
        return points

    def normalized(self, points_in_rig: FloatArray) -> FloatArray:
        """Normalized coordinates (..., 2) at which points (..., 3) of the scene appear."""
        points = points_in_rig
        for normal, offset in zip(self.normals[::-1], self.offsets_mm[::-1], strict=True):
            points = points - 2.0 * (points @ normal - offset)[..., None] * normal
        return np.asarray(points[..., :2] / points[..., 2:])

    @property
    def virtual_centre_in_rig_mm(self) -> FloatArray:
        return self.scene_from_unfolded(np.zeros(3))


@dataclass(frozen=True)
class Found:
    """An arrangement: chains of all views, and the regions (depths, 4, 3) in rig, mm, that all of them see."""

    question: Question
    chains: tuple[Chain, ...]
    regions_mm: FloatArray
