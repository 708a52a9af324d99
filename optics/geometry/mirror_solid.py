"""The glass of a mirror as a convex solid: a right prism between its reflecting face and the opposite face."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mirrorcam.core.values import FloatArray


@dataclass(frozen=True)
class MirrorSolid:
    """A prism over a convex outline.

    Attributes
    ----------
    corners_in_rig_mm
        Corners (2n, 3): those of the reflecting face, then those of the opposite face, alike.
    normal_in_rig
        Unit normal (3,) of the reflecting face, towards the pupil.
    """

    corners_in_rig_mm: FloatArray
    normal_in_rig: FloatArray

    @cached_property
    def half_spaces(self) -> tuple[FloatArray, FloatArray]:
        """Outward unit normals (k, 3) and offsets (k,) of the faces: a point x is inside where n.x <= d, mm."""
        face, opposite = np.split(self.corners_in_rig_mm, 2)
        middle = self.corners_in_rig_mm.mean(axis=0)
        sides = np.cross(np.roll(face, -1, axis=0) - face, opposite - face)
        normals = np.concatenate([[self.normal_in_rig, self.normal_in_rig], sides])
        points = np.concatenate([face[:1], opposite[:1], face])
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        normals *= np.sign(np.sum(normals * (points - middle), axis=1, keepdims=True))
        return normals, np.sum(normals * points, axis=1)
