"""Rims that locate a mirror while the glue sets: along its edges, where there is space outside the light."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from shapely import Polygon
from shapely.geometry.polygon import orient

from mirrorcam.cad.holder.glue import Groove, groove_solid
from mirrorcam.cad.plan.cuts import Cuts
from mirrorcam.cad.plan.hardware import Hardware
from mirrorcam.cad.plan.seats import Frustum, outline_at, seat_height_mm
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror import Mirror
from mirrorcam.optics.geometry.transforms import transform

# Spacing of the points where space is tested; free runs are shortened by as much at both ends.
STEP_MM = 0.25
# Depth below a seat of the material next to it.
RELIEF_MM = 0.3
# Additional width of a rim's ground on each side.
GROUND_MM = 0.1
FAR_MM = 1e4


@dataclass(frozen=True)
class Edge:
    """An edge of a mirror's outline in its own frame: start (2,), unit direction (2,), unit outward normal (2,)."""

    mirror: Mirror
    start: FloatArray
    direction: FloatArray
    outward: FloatArray
    length_mm: float

    def crosses(self, shape: FloatArray) -> bool:
        """Return whether a flat shape (n, 2) crosses the edge."""
        return bool(((shape - self.start) @ self.outward).max() > 0.0)

    def in_rig(self, position: FloatArray, offset: FloatArray, height: FloatArray) -> FloatArray:
        """Points (..., 3) in the rig frame by position along the edge, outward offset and height over the plane, mm."""
        flat = self.start + position[..., None] * self.direction + offset[..., None] * self.outward
        local = np.concatenate([flat, height[..., None]], axis=-1)
        return transform(self.mirror.rig_from_plane, local)


def edges_of(mirror: Mirror) -> list[Edge]:
    """The edges of a mirror's outline, counter-clockwise seen from the pupil."""
    corners = np.array(orient(Polygon(mirror.outline_in_plane_mm)).exterior.coords)[:-1]
    edges = []
    for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        length = float(np.linalg.norm(end - start))
        direction = (end - start) / length
        edges.append(Edge(mirror, start, direction, np.array([direction[1], -direction[0]]), length))
    return edges


def plan_rims(
    layout: Layout,
    keep_outs: list[list[Frustum]],
    grooves: list[tuple[Groove, ...]],
    cut_zones: list[Frustum],
    extent_mm: float,
    hardware: Hardware,
) -> list[tuple[Frustum, FloatArray]]:
    """The rims of all mirrors, each with its ground (4, 3): the rim's foot, widened to the mirror's edge.

    The ground is below the seat, so that only the seat touches the mirror's back. A rim enters no light. It is neither
    in front of nor behind another mirror or that mirror's rim, up to `extent_mm` along their normals, where it would
    become a ridge. Where a mirror's own light spreads over its edge, the rim is set back. No rim is in `cut_zones`,
    where a cut would leave less of it than the thickness of a wall.
    """
    gap = hardware.fit.free_mm
    occupied = [
        [
            Frustum(outline_at(mirror, -extent_mm, gap), outline_at(mirror, extent_mm, gap)),
            *group[1:],
            # Includes the grooves: the rim's foot is lower than the points where space is tested.
            *(
                groove_solid(mirror, groove, hardware).stretched(np.zeros(3), extent_mm * mirror.normal_in_rig)
                for groove in mirror_grooves
            ),
        ]
        for mirror, group, mirror_grooves in zip(layout.mirrors, keep_outs, grooves, strict=True)
    ]
    rims = []
    for index, mirror in enumerate(layout.mirrors):
        others = [
            *cut_zones,
            *(volume for other, group in enumerate(occupied) if other != index for volume in group),
        ]
        mirror_rims = _rims_of(mirror, keep_outs[index][1:], others, grooves[index], hardware)
        offset = extent_mm * mirror.normal_in_rig
        occupied[index] += [Frustum(ground - offset, ground + offset) for _, ground in mirror_rims]
        rims += mirror_rims
    return rims


def cut_zones(axes: FloatArray, cuts_mm: Cuts, hardware: Hardware) -> list[Frustum]:
    """Zones along cuts normal to the first two axes (rows), where a rim would be thinner than a wall."""
    margin = hardware.printer.wall_mm + GROUND_MM + STEP_MM
    zones = []
    for axis, cuts in enumerate(cuts_mm):
        normal, u, v = axes[axis], FAR_MM * axes[1 - axis], FAR_MM * axes[2]
        square = np.array([-u - v, u - v, u + v, v - u])
        zones += [Frustum(square + (cut - margin) * normal, square + (cut + margin) * normal) for cut in cuts]
    return zones


def _rims_of(
    mirror: Mirror,
    own_light: list[Frustum],
    others: list[Frustum],
    grooves: tuple[Groove, ...],
    hardware: Hardware,
) -> list[tuple[Frustum, FloatArray]]:
    fit, margin = hardware.fit.free_mm, hardware.fit.free_mm + hardware.holder.rim_mm
    bottom = seat_height_mm(mirror, hardware)
    top = mirror.back_mm + hardware.holder.rim_height_of_sheet * mirror.thickness_mm
    levels = np.linspace(bottom + 1e-3, top, 4)
    offsets = np.linspace(fit, margin, 10)
    centre = mirror.rig_from_plane[:3, 3]
    radius = float(np.linalg.norm(mirror.outline_in_plane_mm, axis=1).max()) + 2.0 * margin + mirror.thickness_mm
    others = [volume for volume in others if volume.may_touch_ball(centre, radius)]
    rims = []
    for edge in edges_of(mirror):
        if edge.length_mm < hardware.holder.rim_length_mm:
            continue
        steps = np.linspace(0.0, edge.length_mm, int(np.ceil(edge.length_mm / STEP_MM)) + 1)
        points = edge.in_rig(*np.meshgrid(steps, offsets, levels, indexing="ij"))
        lit = np.any([volume.contains(points).any(axis=2) for volume in own_light], axis=0)
        # For each step along the edge, the first offset beyond which there is no light.
        first_free = np.where(lit.any(axis=1), lit.shape[1] - np.argmax(lit[:, ::-1], axis=1), 0)
        # Half a step of margin: light may extend further between two tested points.
        free = np.append(offsets, np.inf)[first_free] <= margin - hardware.printer.wall_mm - 0.5 * (offsets[1] - fit)
        for volume in others:
            free &= ~volume.contains(points).any(axis=(1, 2))
        # A groove crosses the full width of the rim, possibly at an oblique angle.
        band = np.concatenate([[0.0], offsets])
        x = edge.start[0] + steps[:, None] * edge.direction[0] + band * edge.outward[0]
        for groove in grooves:
            notch = np.abs(x - groove.x_mm) <= hardware.holder.groove_mm / 2.0 + STEP_MM
            free &= ~(notch.any(axis=1) & edge.crosses(groove.shape))
        for first, last in _runs(free):
            from_mm, to_mm = steps[first] + STEP_MM, steps[last] - STEP_MM
            if to_mm - from_mm >= hardware.holder.rim_length_mm:
                inner_mm = float(offsets[first_free[first : last + 1].max()])
                corners = np.array([from_mm, to_mm, to_mm, from_mm])
                foot, crest = (
                    edge.in_rig(corners, np.array([inner_mm, inner_mm, margin, margin]), np.full(4, level))
                    for level in (bottom - 2.0 * RELIEF_MM, top)
                )
                # Slightly wider than the rim, so that the two share no face.
                widened = corners + np.array([-GROUND_MM, GROUND_MM, GROUND_MM, -GROUND_MM])
                outer_mm = margin + GROUND_MM
                ground = edge.in_rig(widened, np.array([0.0, 0.0, outer_mm, outer_mm]), np.full(4, bottom - RELIEF_MM))
                rims.append((Frustum(foot, crest), ground))
    return rims


def _runs(free: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """First and last index of each run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], free, [False]]).astype(int)))
    return [(int(first), int(last) - 1) for first, last in zip(edges[::2], edges[1::2], strict=True)]
