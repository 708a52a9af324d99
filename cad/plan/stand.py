"""The stand frame, in which a device stands: x as in the rig frame, y level towards the scene, z up; origin the pupil.

The rig's z axis, which is the lens axis, leans back from upright by the lean, so that the views look level or at a
given angle above the horizon. Adapters are planned in this frame.
"""

from __future__ import annotations

import numpy as np

from mirrorcam.cad.plan.hardware import Hardware
from mirrorcam.cad.plan.seats import Frustum
from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.layout import Layout

# Largest lean: the foot of a mount that leans further is longer than the mount is deep.
MAX_LEAN_DEG = 60.0


def lean_deg(layout: Layout, hardware: Hardware) -> float:
    """The angle by which the lens axis leans back, so that the views look `back.look_deg` above the horizon.

    It is fold - 90 deg + look. Raises InputError if it is beyond `MAX_LEAN_DEG`.
    """
    look_deg = hardware.back.look_deg
    _, forward, upward = layout.view_from_rig[2]
    elevation = float(np.degrees(np.arctan2(upward, forward)))
    lean = round(look_deg - elevation, 6) + 0.0
    if abs(lean) > MAX_LEAN_DEG:
        raise InputError(
            f"look_deg {look_deg:g} makes the device lean by {lean:.1f} deg, expected at most {MAX_LEAN_DEG:g} deg: "
            f"set --look-deg between {elevation - MAX_LEAN_DEG:.1f} and {elevation + MAX_LEAN_DEG:.1f}"
        )
    return lean


def rig_from_stand(lean: float) -> FloatArray:
    """The rotation (3, 3) from the stand frame to the rig frame for a lean in deg, about their common x and origin."""
    cosine, sine = np.cos(np.deg2rad(lean)), np.sin(np.deg2rad(lean))
    return np.array([[1.0, 0.0, 0.0], [0.0, cosine, sine], [0.0, -sine, cosine]])


def rotated(solid: Frustum, rotation: FloatArray) -> Frustum:
    """A solid rotated about the origin by a rotation (3, 3)."""
    return Frustum(solid.base @ rotation.T, solid.top @ rotation.T)


def aim_in_rig(layout: Layout, depth_mm: float) -> FloatArray:
    """The mean point (3,), mm, at which the central rays of all mirrors reach a depth along the views' axis."""
    forward = layout.view_from_rig[2]
    points = []
    for mirror in layout.mirrors:
        centre = mirror.outline_in_rig_mm.mean(axis=0)
        ray = centre - mirror.virtual_centre_in_rig_mm
        points.append(centre + (depth_mm - centre @ forward) / (ray @ forward) * ray)
    return np.mean(points, axis=0)


def design_depths_mm(layout: Layout, hardware: Hardware) -> tuple[float, ...]:
    """The depths for which the layout is designed, along the views' axis from the pupil, mm, in ascending order."""
    return tuple(sorted(layout.spec.depths_mm)) if layout.spec else (hardware.holder.depth_without_spec_mm,)
