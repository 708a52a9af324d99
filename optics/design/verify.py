"""A second opinion on a layout, by polygon clipping and ray casting; shares nothing with the optimiser."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import permutations
from typing import Literal

import numpy as np

from optics.design.errors import InfeasibleDesign
from optics.design.metrics import common_region, hull_distance, sheet_in_rig_mm, smallest_gap_mm
from optics.layout import Layout
from optics.mirror import Mirror
from optics.spec import DesignSpec
from optics.values import FloatArray

GAP_TOLERANCE_MM = 1e-4
SENSOR_TOLERANCE_PX = 0.05
TOUCH_MM = 1e-6


@dataclass(frozen=True)
class Blocked:
    """Part of the light of one mirror that the sheet of another stops, on its way in or out."""

    light_of: int
    sheet_of: int
    leg: Literal["in", "out"]
    fraction: float


def half_spaces(mirror: Mirror) -> tuple[FloatArray, FloatArray]:
    """Outward unit normals (k, 3) and offsets (k,) of the faces of the mirror's sheet: inside where n.x <= d, mm."""
    corners = sheet_in_rig_mm(mirror)
    front, back = corners[: len(corners) // 2], corners[len(corners) // 2 :]
    middle = corners.mean(axis=0)
    sides = np.cross(np.roll(front, -1, axis=0) - front, back - front)
    normals = np.concatenate([[mirror.normal_in_rig, mirror.normal_in_rig], sides])
    points = np.concatenate([front[:1], back[:1], front])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    normals *= np.sign(np.sum(normals * (points - middle), axis=1, keepdims=True))
    return normals, np.sum(normals * points, axis=1)


def length_inside_mm(starts: FloatArray, ends: FloatArray, normals: FloatArray, offsets: FloatArray) -> FloatArray:
    """Length (n,) of each segment from `starts` to `ends` (n, 3) inside the convex body n.x <= d (k faces)."""
    heights, slopes = starts @ normals.T - offsets, (ends - starts) @ normals.T
    with np.errstate(divide="ignore", invalid="ignore"):
        crossings = -heights / slopes
    entered = np.where(slopes < 0, crossings, np.where((slopes == 0) & (heights > 0), np.inf, -np.inf)).max(axis=1)
    left = np.where(slopes > 0, crossings, np.inf).min(axis=1)
    inside = np.minimum(left, 1.0) - np.maximum(entered, 0.0)
    return np.maximum(inside, 0.0) * np.linalg.norm(ends - starts, axis=1)


def sampled(polygon: FloatArray, steps: int) -> FloatArray:
    """Points (n, 2) that cover a convex polygon evenly, its border included."""
    i, j = np.meshgrid(np.arange(steps + 1), np.arange(steps + 1))
    weights = np.stack([i, j], axis=-1)[i + j <= steps] / steps
    fans = [
        polygon[0] + weights @ np.array([polygon[k] - polygon[0], polygon[k + 1] - polygon[0]])
        for k in range(1, len(polygon) - 1)
    ]
    return np.concatenate(fans)


def blocked_light(mirrors: Sequence[Mirror], depth_mm: float, steps: int = 24) -> list[Blocked]:
    """Which mirrors stand in the light of which, by casting rays from the pupil through sub-images to y = depth_mm."""
    found = []
    bodies = [half_spaces(mirror) for mirror in mirrors]
    for light_of, mirror in enumerate(mirrors):
        on_mirror = mirror.cut(sampled(mirror.outline_normalized, steps))
        leaving = on_mirror - mirror.virtual_centre_in_rig_mm
        heading = leaving[:, 1] > 1e-9
        on_mirror, leaving = on_mirror[heading], leaving[heading]
        at_depth = on_mirror + leaving * ((depth_mm - on_mirror[:, 1]) / leaving[:, 1])[:, None]
        for sheet_of, body in enumerate(bodies):
            if sheet_of == light_of:
                continue
            legs: tuple[tuple[Literal["in", "out"], FloatArray, FloatArray], ...] = (
                ("in", np.zeros_like(on_mirror), on_mirror),
                ("out", on_mirror, at_depth),
            )
            for leg, starts, ends in legs:
                fraction = float(np.mean(length_inside_mm(starts, ends, *body) > TOUCH_MM))
                if fraction > 0:
                    found.append(Blocked(light_of, sheet_of, leg, fraction))
    return found


def seen_gap_mm(layout: Layout) -> float:
    """Smallest distance from the light that falls on any mirror (pupil to outline) to the face of another, mm."""
    pupil = np.zeros((1, 3))
    faces = [mirror.outline_in_rig_mm for mirror in layout.mirrors]
    return min(hull_distance(np.concatenate([pupil, light]), face) for light, face in permutations(faces, 2))


def _check_sensor(layout: Layout) -> None:
    limit = np.array([layout.camera.width_px, layout.camera.height_px]) - 0.5
    for k in range(len(layout.mirrors)):
        outline = layout.outline_px(k, points_per_edge=64)
        outside = float(np.nan_to_num(np.maximum(-0.5 - outline, outline - limit), nan=np.inf).max())
        if outside > SENSOR_TOLERANCE_PX:
            raise InfeasibleDesign("sensor", f"the sub-image of mirror {k} leaves the sensor by {outside:.3g} px")


def _check_depths(layout: Layout, depths_mm: tuple[float, ...]) -> None:
    reach_mm = max(float(mirror.outline_in_rig_mm[:, 1].max()) for mirror in layout.mirrors)
    if min(depths_mm) <= reach_mm:
        raise InfeasibleDesign(
            "depth",
            f"{min(depths_mm):g} mm is nearer than the mirrors, they reach {reach_mm - min(depths_mm):.3g} mm past it",
        )
    for depth_mm in depths_mm:
        region, _ = common_region(layout, depth_mm)
        if region.area <= 0.0:
            raise InfeasibleDesign("overlap", f"no point at {depth_mm:g} mm is seen by all views")


def _check_gaps(layout: Layout, spacing_mm: float) -> None:
    for name, gap_mm in (("", smallest_gap_mm(layout)), (" as the camera sees them", seen_gap_mm(layout))):
        if gap_mm < spacing_mm - GAP_TOLERANCE_MM:
            raise InfeasibleDesign(
                "spacing", f"two mirrors are {gap_mm:.4g} mm apart{name}, {spacing_mm - gap_mm:.3g} mm too close"
            )


def _check_light(layout: Layout, depth_mm: float) -> None:
    for k, mirror in enumerate(layout.mirrors):
        if mirror.surface == "second" and mirror.distance_mm <= mirror.thickness_mm:
            raise InfeasibleDesign(
                "occlusion",
                f"the sheet of mirror {k} reaches {mirror.thickness_mm - mirror.distance_mm:.3g} mm past the pupil",
            )
    blocked = blocked_light(layout.mirrors, depth_mm)
    if blocked:
        worst = max(blocked, key=lambda found: found.fraction)
        way = "to" if worst.leg == "in" else "from"
        raise InfeasibleDesign(
            "occlusion",
            f"mirror {worst.sheet_of} stands in {worst.fraction:.2%} of the light {way} mirror {worst.light_of}",
        )


def verify(layout: Layout, spec: DesignSpec) -> None:
    """Raise InfeasibleDesign, naming the constraint, where a layout does not keep what its spec asks for."""
    _check_sensor(layout)
    _check_gaps(layout, spec.spacing_mm)
    _check_depths(layout, spec.depths_mm)
    _check_light(layout, max(spec.depths_mm))
