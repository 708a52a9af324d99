"""Seeds of a design: flat facets of a paraboloid (the paper's seed) or an ellipsoid, tiled over the sensor."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray, InvalidValue
from mirrorcam.optics.geometry.arrangement import Arrangement
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.design_spec import GAVE_UP, DesignSpec, InfeasibleDesign
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror import Mirror, intersect_plane
from mirrorcam.optics.geometry.mirror_gaps import smallest_gap_mm
from mirrorcam.optics.geometry.sub_images import sensor_polygon

Booleans = NDArray[np.bool_]

TILE_RATIOS = (1.0, 0.8, 1.25, 0.6, 1.7, 0.4, 2.5)
"""Trial ratios between horizontal and vertical distances to decide along which axis two tiles are separated."""

CENTRE_DECIMALS_MM = 6
NORMALIZED_DECIMALS = 8
OUTLINE_DECIMALS_MM = 9


@dataclass(frozen=True)
class Seed:
    """Start values of mirrors, in the order of the layout, in units of the scale.

    Attributes
    ----------
    centres
        Virtual centres (n, 3) in view axes.
    corners
        Corners (n, sides, 2) of the sub-images, normalized.
    half_tile
        Half the size (2,) of a tile, normalized.
    """

    centres: FloatArray
    corners: FloatArray
    half_tile: FloatArray

    @cached_property
    def chief_rays(self) -> FloatArray:
        """Normalized coordinates (n, 2) of the chief rays, through the centres of the sub-images."""
        return self.corners.mean(axis=1)

    def chief_points(self, view_from_rig: FloatArray) -> FloatArray:
        """Points (n, 3) in view axes where chief rays meet the mirrors."""
        rays = np.column_stack([self.chief_rays, np.ones(len(self.corners))]) @ view_from_rig.T
        lengths = 0.5 * (self.centres**2).sum(axis=1) / (rays * self.centres).sum(axis=1)
        return rays * lengths[:, None]

    def edges(self, view_from_rig: FloatArray) -> FloatArray:
        """Lengths (n, 2) of the first and the second edge of each mirror."""
        centres = self.centres @ view_from_rig
        faces = [intersect_plane(corners, centre) for corners, centre in zip(self.corners, centres, strict=True)]
        return np.asarray(np.linalg.norm(np.diff(np.array(faces)[:, :3], axis=1), axis=-1))


@lru_cache(maxsize=64)
def sensor_rectangle(camera: Camera) -> FloatArray:
    """The largest axis-aligned rectangle ((u_low, v_low), (u_high, v_high)), normalized, inside the sensor.

    Without distortion it is the sensor itself, out to the edges of its outermost pixels. Raises InputError if the lens
    model does not cover the sensor's border.
    """
    fractions = np.linspace(-0.5, 0.5, 65)
    x, y = fractions * camera.width_px, fractions * camera.height_px
    centre = np.array([(camera.width_px - 1) / 2.0, (camera.height_px - 1) / 2.0])
    left, right, top, bottom = (
        camera.normalized_from_pixels(np.column_stack(np.broadcast_arrays(*edge)) + centre)
        for edge in ((x[0], y), (x[-1], y), (x, y[0]), (x, y[-1]))
    )
    rectangle = np.array(
        [[left[:, 0].max(), top[:, 1].max()], [right[:, 0].min(), bottom[:, 1].min()]], dtype=np.float64
    )
    if not np.isfinite(rectangle).all():
        raise InputError(
            f"camera {camera.name}: distortion {camera.distortion.tolist()} is not monotonic on the sensor"
        )
    rectangle.setflags(write=False)
    return rectangle


def sensor_bounds(camera: Camera) -> FloatArray:
    """The smallest axis-aligned rectangle ((u_low, v_low), (u_high, v_high)), normalized, around the sensor."""
    return np.array(sensor_polygon(camera).bounds).reshape(2, 2)


def corner_pattern(sides: int) -> FloatArray:
    """Corners (sides, 2) of a tile as fractions of its width and height, along the image's u and v.

    A rectangle. A fifth corner divides the edge with the largest v; a fifth and a sixth divide the left and the right.
    """
    rectangle = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]
    if sides == 5:
        rectangle.insert(3, [0.5, 1.0])
    if sides == 6:
        rectangle = [[0.0, 0.0], [1.0, 0.0], [1.0, 0.5], [1.0, 1.0], [0.0, 1.0], [0.0, 0.5]]
    return np.array(rectangle)


def _ranks(order: Booleans) -> tuple[FloatArray, FloatArray]:
    """Earliest and latest rank (n,) of each item in a partial order; the longest chain has one item per rank.

    `order[i, j]` states that i precedes j by at least one rank; it holds only for i < j.
    """
    count = len(order)
    first, after = np.zeros(count), np.zeros(count)
    for k in range(count):
        first[k] = (first[:k][order[:k, k]] + 1.0).max(initial=0.0)
    for k in reversed(range(count)):
        after[k] = (after[k + 1 :][order[k, k + 1 :]] + 1.0).max(initial=0.0)
    return first, first.max() - after


def _positions_along(steps: FloatArray, is_separated: Booleans) -> FloatArray:
    """Positions (n,) along one axis, near the steps (n,), and at least 1 apart for pairs in a mask (n, n)."""
    sorted_by_step = np.argsort(steps, kind="stable")
    order = np.triu(is_separated[np.ix_(sorted_by_step, sorted_by_step)], 1)
    first, last = _ranks(order)
    ordered = steps[sorted_by_step]
    target = (ordered - ordered[0]) / max(ordered[-1] - ordered[0], 1e-12) * float(last.max())
    rising, falling = first.copy(), last.copy()
    for k in range(len(steps)):
        rising[k] = min(last[k], max(target[k], (rising[:k][order[:k, k]] + 1.0).max(initial=first[k])))
    for k in reversed(range(len(steps))):
        falling[k] = max(first[k], min(target[k], (falling[k + 1 :][order[k, k + 1 :]] - 1.0).min(initial=last[k])))
    positions = np.empty(len(steps))
    positions[sorted_by_step] = (rising + falling) / 2.0
    return positions


@lru_cache
def tile_positions(arrangement: Arrangement) -> FloatArray:
    """Positions (n, 2) of equal tiles that do not overlap, in units of a tile; for a grid, columns and rows.

    Two tiles are separated along the axis with the greater distance between their views. Among trial ratios between
    the axes, the one with the smallest area in tiles is used, which gives the largest tiles.
    """
    dx, dy = (np.abs(steps[:, None] - steps) for steps in arrangement.steps.T)
    candidates = []
    for ratio in TILE_RATIOS:
        horizontal = dx * ratio >= dy - 1e-9
        candidates.append(
            np.column_stack(
                [
                    _positions_along(steps, is_separated)
                    for steps, is_separated in zip(arrangement.steps.T, (horizontal, ~horizontal), strict=True)
                ]
            )
        )
    return min(candidates, key=lambda positions: float(np.prod(positions.max(axis=0) + 1.0)))


def tiles(spec: DesignSpec, gap: float) -> FloatArray:
    """Sub-images (n, sides, 2) in normalized coordinates: equal tiles of the sensor with a gap between neighbours.

    The highest views have the largest v, because the fold turns the image upside down. Corners are ordered as in
    `corner_pattern`.
    """
    low, high = sensor_rectangle(spec.camera)
    positions = tile_positions(spec.arrangement)
    last = positions.max(axis=0)
    size = (high - low - last * gap) / (last + 1.0)
    origins = low + np.column_stack([positions[:, 0], last[1] - positions[:, 1]]) * (size + gap)
    return np.asarray(origins[:, None] + corner_pattern(spec.sides) * size)


def _rays(chief_rays: FloatArray, view_from_rig: FloatArray) -> FloatArray:
    """Unit viewing rays (..., 3) in view axes of normalized coordinates (..., 2)."""
    rays = np.concatenate([chief_rays, np.ones((*chief_rays.shape[:-1], 1))], axis=-1) @ view_from_rig.T
    return rays / np.linalg.norm(rays, axis=-1, keepdims=True)


def parabola_centres(chief_rays: FloatArray, scale: float, view_from_rig: FloatArray) -> FloatArray:
    """Virtual centres (..., 3), in view axes, of facets tangent to a paraboloid where chief rays meet it.

    The paraboloid has its focus at the pupil and the view axis as its axis. `chief_rays` (..., 2) are normalized
    coordinates. All virtual centres lie in the directrix plane, so all chief rays leave along the view axis.
    """
    rays = _rays(chief_rays, view_from_rig)
    lengths = scale * (1.0 - view_from_rig[2, 2]) / (1.0 - rays[..., 2:])
    return lengths * (rays - [0.0, 0.0, 1.0])


def ellipsoid_centres(
    chief_rays: FloatArray, scale: float, target_depth: float, view_from_rig: FloatArray
) -> FloatArray:
    """Virtual centres (..., 3), in view axes, of facets tangent to an ellipsoid with foci at the pupil and at a target.

    The target is the point of the folded optical axis at `target_depth`; all chief rays meet there. The paraboloid is
    the limit for an infinitely distant target. A point P on the surface has |P| + |P - target| = constant; its virtual
    centre lies at this distance from the target on the line through P.
    """
    rays = _rays(chief_rays, view_from_rig)
    vertex = scale * view_from_rig[:, 2]  # where the optical axis meets its mirror
    target = np.array([vertex[0], vertex[1], target_depth])
    total = scale + target_depth - vertex[2]
    points = rays * ((total**2 - target @ target) / (2.0 * (total - rays @ target)))[..., None]
    from_target = points - target
    return target + total * from_target / np.linalg.norm(from_target, axis=-1, keepdims=True)


def seed_of(spec: DesignSpec, target_depth_mm: float) -> Seed:
    """The faceted ellipsoid whose chief rays meet at a depth, with slightly larger gaps than the spec requests.

    If that would leave little of the sensor, gaps are half a tile.
    """
    tile = tiles(spec, 0.0)[0]
    max_gap = 0.5 * float((tile.max(axis=0) - tile.min(axis=0)).min())
    gap_mm = max(1.3 * spec.spacing_mm, spec.seen_gap_mm)
    corners = tiles(spec, min(gap_mm / spec.scale_mm, max_gap))
    centres = ellipsoid_centres(corners.mean(axis=1), 1.0, target_depth_mm / spec.scale_mm, spec.view_from_rig)
    return Seed(centres, corners, (corners[0].max(axis=0) - corners[0].min(axis=0)) / 2.0)


def mirrors_of(spec: DesignSpec, centres_in_view_mm: FloatArray, corners: FloatArray) -> tuple[Mirror, ...]:
    """Mirrors with apparent virtual centres (n, 3), in view axes, mm, and normalized corners (n, k, 2).

    The numbers are rounded first, so that noise in the last digits does not change a layout's identity. Outlines follow
    from the rounded numbers and lie on their planes to a nanometre. Raises InfeasibleDesign if a second-surface mirror
    does not fit between its reflecting surface and the pupil.
    """
    mirrors = []
    centres = (centres_in_view_mm @ spec.view_from_rig).round(CENTRE_DECIMALS_MM) + 0.0
    for centre, polygon in zip(centres, corners.round(NORMALIZED_DECIMALS), strict=True):
        outline = intersect_plane(polygon, centre).round(OUTLINE_DECIMALS_MM) + 0.0
        glass = {"thickness_mm": spec.thickness_mm, "refractive_index": spec.refractive_index}
        try:
            if spec.is_second_surface:
                mirrors.append(Mirror.second_surface(centre, outline, **glass))
            else:
                mirrors.append(Mirror(virtual_centre_in_rig_mm=centre, outline_in_rig_mm=outline, **glass))
        except InvalidValue as error:
            reason = str(error)
            raise InfeasibleDesign("occlusion" if "past the pupil" in reason else GAVE_UP, reason) from None
    return tuple(mirrors)


def layout_of(spec: DesignSpec, mirrors: tuple[Mirror, ...], made_by: dict[str, str]) -> Layout:
    """The nominal layout of mirrors. Raises InfeasibleDesign if two overlap in the image."""
    try:
        return Layout(
            rows=spec.arrangement.rows,
            cols=spec.arrangement.cols,
            pattern=spec.pattern,
            camera=spec.camera,
            mirrors=mirrors,
            view_from_rig=spec.view_from_rig,
            spec=spec,
            provenance=made_by,
        )
    except InvalidValue as error:
        raise InfeasibleDesign("spacing", str(error)) from None


def _parabola_with_gap(spec: DesignSpec, gap: float) -> tuple[Mirror, ...]:
    corners = tiles(spec.replaced(sides=4), gap)
    centres = parabola_centres(corners.mean(axis=1), spec.scale_mm, spec.view_from_rig)
    return mirrors_of(spec, centres, corners)


def faceted_parabola(spec: DesignSpec) -> Layout:
    """The paper's seed: sub-images tile the sensor; facets are tangent to a paraboloid with its focus at the pupil.

    Mirrors have four corners. The gap in the image is the smallest that leaves `spacing_mm` between all mirrors. Raises
    InfeasibleDesign if there is none.
    """
    low, high = sensor_rectangle(spec.camera)
    max_gap = float(((high - low) / np.maximum(tile_positions(spec.arrangement).max(axis=0), 1)).min())

    @cache
    def excess_mm(gap: float) -> float:
        return smallest_gap_mm(_parabola_with_gap(spec, gap)) - spec.spacing_mm

    gap, high_gap = 1e-7, 0.98 * max_gap
    if excess_mm(gap) < 0:
        missing_mm = -excess_mm(high_gap)
        if missing_mm > 0:
            raise InfeasibleDesign(
                "spacing",
                f"facets {spec.spacing_mm:g} mm apart do not fit the parabola at scale {spec.scale_mm:g} mm: "
                f"they are {missing_mm:.3g} mm too close at any size",
            )
        gap = brentq(excess_mm, gap, high_gap, xtol=1e-7) + 2e-7
    return layout_of(spec, _parabola_with_gap(spec, gap), {"made_by": "optics.design.seeds.faceted_parabola"})
