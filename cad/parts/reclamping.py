"""How well a camera comes back to where it was when it is taken out of its clip and put in again."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mirrorcam.cad.parts.clip import ClipPlan
from mirrorcam.cad.parts.nest import motion_of_errors
from mirrorcam.cad.plan.hardware import Hardware
from mirrorcam.optics.base.values import FloatArray
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.working_distance import working_distance_mm

# How well each point repeats, along its normal: an assumption, of a pad of printed plastic wiped clean, whose lines of
# 0.2 mm meet a moulded body where they met it before. One standard deviation.
CONTACT_MM = 0.02


@dataclass(frozen=True)
class Repeatability:
    """One standard deviation of what a camera does when it is taken out of its nest and put back.

    The pupil's shift, the body's turn, and how far the sub-image moves that moves most: in all, and against the mean of
    all sub-images, which is what the views' disparities feel.
    """

    shift_mm: float
    turn_deg: float
    image_px: float
    between_views_px: float


def repeatability(clip: ClipPlan, layout: Layout, hardware: Hardware) -> Repeatability | None:
    """What re-clamping does, of independent errors of `CONTACT_MM` at the six points; None of a board."""
    if clip.nest is None:
        return None
    motion = CONTACT_MM * motion_of_errors(clip.nest)
    moved = _moved_px(layout, working_distance_mm(layout) or hardware.holder.depth_without_spec_mm) @ motion
    between = moved - moved.mean(axis=0)
    return Repeatability(
        shift_mm=float(np.linalg.norm(motion[:3])),
        turn_deg=float(np.degrees(np.linalg.norm(motion[3:]))),
        image_px=_largest(moved),
        between_views_px=_largest(between),
    )


def _largest(moved_px: FloatArray) -> float:
    """The largest standard deviation, over views, of moves (n, 2, 6) by six independent errors of 1."""
    return float(np.sqrt((moved_px**2).sum(axis=(1, 2))).max())


def _moved_px(layout: Layout, distance_mm: float) -> FloatArray:
    """How the image of a point at the working distance in the middle of each view moves (n, 2, 6) with the camera.

    The columns are those of a shift in mm and a turn in rad, w. Seen from the camera, the point's image in the mirror,
    p, moves by -(t + w x p); of its pixel, f (dx - x/z dz) / z, distortion left out.
    """
    camera, rows = layout.camera, []
    for mirror in layout.mirrors:
        middle = mirror.outline_in_rig_mm.mean(axis=0)
        away = float(np.linalg.norm(middle))
        point = middle / away * (away + distance_mm)
        x, y, z = point
        turned = np.array([[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]])
        in_camera = -np.hstack([np.eye(3), turned])
        pixel = np.array([[camera.fx_px, 0.0, -camera.fx_px * x / z], [0.0, camera.fy_px, -camera.fy_px * y / z]]) / z
        rows.append(pixel @ in_camera)
    return np.array(rows)
