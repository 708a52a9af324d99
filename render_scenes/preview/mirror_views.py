"""Mirrors as arrays: the fraction of a pixel's total that each mirror reflects, and its ray in the scene.

The scalar counterpart of `fast.pixel_footprints`. At a corner of a mirror, the pupil fractions of its two edges are
multiplied.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from mirrorcam.core.compiled import inlined
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror import Mirror
from mirrorcam.optics.geometry.pupil import Pupil
from mirrorcam.render_scenes.preview.triangle_tree import add_scaled, cross, dot, load3, map_vector, scale

MIN_PUPIL_FRACTION = 1.0 / 512.0
"""Minimum fraction of the pupil at which a mirror is considered."""


# Columns of the table of mirrors.
INDEX, WINDOW, NORMAL, DISTANCE, THICKNESS, REFRACTIVE_INDEX, REFLECTANCE = 0, 1, 5, 8, 9, 10, 11
CENTRE_IN_VIEW, NORMAL_IN_VIEW, VIEW_FROM_CAMERA, EDGES = 12, 15, 18, 30
EDGE = 6
"""Number of columns per edge."""

BLUR_MARGIN = 1.25
"""Margin of a window around an outline, relative to the blur at the corner with the least z."""


class MirrorViews(NamedTuple):
    """Mirrors, ordered by the distance of their front from the pupil.

    Attributes
    ----------
    table
        (m, 30 + 6 e), one mirror per row: its number in the layout; its window of pixels (first row, last + 1, first
        column, last + 1); its normal in the rig frame; distance of its front from the pupil, mm; thickness of the
        glass in front of the coating, mm (0 for a first surface); refractive index; reflectance of the coating; in view
        axes, the virtual centre of the front, mm, its normal, and the map (3, 4) of ray directions from the camera; for
        each edge of the front, the cross product of its ends (its triple product with a point inside is positive) and
        the vector along it. The last edge is repeated if other mirrors have more.
    radius_mm, inverse_focus_per_mm, fx_px
        Radius of the pupil, reciprocal of the focus distance, and the focal length.
    """

    table: FloatArray
    radius_mm: float
    inverse_focus_per_mm: float
    fx_px: float


def mirror_views(layout: Layout, pupil: Pupil, reflectance: float) -> MirrorViews:
    """Return the mirrors of a layout as arrays, without curvature and pupil walk."""
    order = sorted(range(len(layout.mirrors)), key=lambda k: layout.mirrors[k].distance_mm - layout.mirrors[k].front_mm)
    mirrors = [layout.mirrors[k] for k in order]
    edge_count = max(len(mirror.outline_in_rig_mm) for mirror in mirrors)
    view_from_rig = layout.view_from_rig
    rows = []
    for number, mirror in zip(order, mirrors, strict=True):
        front_mm, normal = mirror.distance_mm - mirror.front_mm, view_from_rig @ mirror.normal_in_rig
        rows.append(
            [
                number,
                *_window(layout.camera, mirror, pupil),
                *mirror.normal_in_rig,
                front_mm,
                mirror.front_mm,
                mirror.refractive_index,
                reflectance,
                *(-2.0 * front_mm * normal),
                *normal,
                *np.column_stack([view_from_rig @ mirror.reflection, np.zeros(3)]).ravel(),
                *_edges(mirror, edge_count).ravel(),
            ]
        )
    return MirrorViews(np.array(rows), pupil.radius_mm, 1.0 / pupil.focus_mm, layout.camera.fx_px)


def _front(mirror: Mirror) -> FloatArray:
    """Return the corners (n, 3) of the front of a mirror in the rig frame, mm."""
    return np.asarray(mirror.outline_in_rig_mm + mirror.front_mm * mirror.normal_in_rig)


def _edges(mirror: Mirror, count: int) -> FloatArray:
    """Return the edges (count, 6) of the front of a mirror, see `MirrorViews.table`."""
    corners = _front(mirror)
    ends = np.roll(corners, -1, axis=0)
    cross_products = np.cross(corners, ends)
    sign = np.sign(cross_products @ corners.mean(axis=0))[:, None]
    padded = np.minimum(np.arange(count), len(corners) - 1)
    return np.concatenate([cross_products * sign, (ends - corners) * sign], axis=1)[padded]


def _window(camera: Camera, mirror: Mirror, pupil: Pupil) -> tuple[int, int, int, int]:
    """Return the window of pixels that may show a mirror: the bounds of its outline, widened by defocus."""
    corners = _front(mirror)
    steps = np.linspace(0.0, 1.0, 16, endpoint=False)[None, :, None]
    edge = (corners[:, None] * (1.0 - steps) + np.roll(corners, -1, axis=0)[:, None] * steps).reshape(-1, 3)
    pixels = camera.project(edge)
    if not np.isfinite(pixels).all():
        # The mirror extends beyond the domain of the lens model.
        return 0, camera.height_px, 0, camera.width_px
    blur = BLUR_MARGIN * camera.fx_px * pupil.radius_mm * abs(1.0 / float(corners[:, 2].min()) - 1.0 / pupil.focus_mm)
    low = np.floor(pixels.min(axis=0) - blur).astype(int) - 1
    high = np.ceil(pixels.max(axis=0) + blur).astype(int) + 2
    left, top = np.clip(low, 0, [camera.width_px, camera.height_px])
    right, bottom = np.clip(high, 0, [camera.width_px, camera.height_px])
    return int(top), int(bottom), int(left), int(right)


@inlined
def pupil_fraction(mirrors: Any, number: Any, x: Any, y: Any) -> Any:
    """Return the fraction of the pupil that a mirror fills in the pixel of a ray (x, y, 1).

    An edge divides a disc with the variances of the pupil and the pixel added; for a pinhole, this
    is about the fraction of the pixel.
    """
    table = mirrors.table
    ray, normal = (x, y, 1.0), load3(table, number, NORMAL)
    along_normal = dot(ray, normal)
    if along_normal >= 0.0:
        return 0.0
    thickness, shift = table[number, THICKNESS], 0.0
    tangential = add_scaled(ray, -along_normal, normal)
    if thickness > 0.0:
        length = max(np.sqrt(dot(tangential, tangential)), 1e-12)
        shift = (
            -2.0 * thickness * along_normal * _inner_tangent(-length / along_normal, table[number, REFRACTIVE_INDEX])
        )
        tangential = scale(tangential, shift / length)
    fraction = 1.0
    for edge in range(EDGES, table.shape[1], EDGE):
        side, along_edge = load3(table, number, edge), load3(table, number, edge + 3)
        if edge > EDGES and table[number, edge] == table[number, edge - EDGE]:
            break
        constant = dot(ray, side)
        if thickness > 0.0:
            # Light leaves the front farther out than it enters; both points must be inside the edge.
            constant = min(constant, constant + dot(tangential, cross(along_edge, normal)))
        gradient_x = y * along_edge[2] - along_edge[1] - mirrors.inverse_focus_per_mm * side[0]
        gradient_y = along_edge[0] - x * along_edge[2] - mirrors.inverse_focus_per_mm * side[1]
        squared_radius = mirrors.radius_mm * mirrors.radius_mm * (gradient_x * gradient_x + gradient_y * gradient_y)
        # A square of width w has the variance of a disc with the squared radius w^2 / 3.
        squared_radius += (side[0] * side[0] + side[1] * side[1]) / (3.0 * mirrors.fx_px * mirrors.fx_px)
        if constant * abs(constant) <= -squared_radius:
            return 0.0
        if constant * constant < squared_radius:
            clearance = constant / np.sqrt(squared_radius)
            fraction *= 1.0 - (np.arccos(clearance) - clearance * np.sqrt(1.0 - clearance * clearance)) / np.pi
    return fraction


@inlined
def _inner_tangent(tangent: Any, refractive_index: Any) -> Any:
    """Return the tangent of a ray's angle in glass from the tangent of its angle in air (Snell's law)."""
    squared = tangent * tangent
    return tangent / np.sqrt(refractive_index * refractive_index * (1.0 + squared) - squared)


@inlined
def reflectance_and_shift(mirrors: Any, number: Any, x: Any, y: Any) -> Any:
    """Return a mirror's total reflectance for a ray (x, y, 1), and the shift of its virtual centre by the glass, mm.

    See `fast.pixel_footprints`: light through a plate seems to come from a point behind the front's virtual centre.
    Ghosts of the front and of multiple reflections are assumed to coincide with the image.
    """
    table = mirrors.table
    thickness, index, reflectance = (
        table[number, THICKNESS],
        table[number, REFRACTIVE_INDEX],
        table[number, REFLECTANCE],
    )
    if thickness == 0.0:
        return reflectance, 0.0
    towards = -dot((x, y, 1.0), load3(table, number, NORMAL))
    cosine = towards / np.sqrt(x * x + y * y + 1.0)
    inner = np.sqrt(1.0 - (1.0 - cosine * cosine) / (index * index))
    s_wave = (cosine - index * inner) / (cosine + index * inner)
    p_wave = (inner - index * cosine) / (inner + index * cosine)
    front = 0.5 * (s_wave * s_wave + p_wave * p_wave)
    total = front + (1.0 - front) * (1.0 - front) * reflectance / (1.0 - front * reflectance)
    # By Snell's law, tan' / tan = cos / (n cos').
    return total, 2.0 * thickness * cosine / (index * inner)


@inlined
def scene_ray(mirrors: Any, number: Any, x: Any, y: Any, shift_mm: Any) -> Any:
    """Return the ray in the scene, in view axes, that a mirror reflects to the camera ray (x, y, 1).

    Returns its start, its direction, and `t` where it leaves the mirror. t is a multiple of the
    direction, and therefore the distance along the axis of the camera, mm.
    """
    table = mirrors.table
    normal = load3(table, number, NORMAL_IN_VIEW)
    start = add_scaled(load3(table, number, CENTRE_IN_VIEW), -shift_mm, normal)
    direction = map_vector(table, number, VIEW_FROM_CAMERA, (x, y, 1.0))
    t_min = -(table[number, DISTANCE] + dot(start, normal)) / dot(direction, normal)
    return start, direction, t_min


@inlined
def scene_ray_step(mirrors: Any, number: Any, x: Any, y: Any) -> Any:
    """Return the change (3,) of the direction of `scene_ray` for a change (x, y) of the camera ray."""
    return map_vector(mirrors.table, number, VIEW_FROM_CAMERA, (x, y, 0.0))
