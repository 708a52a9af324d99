"""The pieces of a tray that a camera's body lies in: its stops with their pads, and the leaves of its screws."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mirrorcam.cad.parts.camera_box import SCENE, body_box
from mirrorcam.cad.parts.nest import Nest, SprungScrew
from mirrorcam.cad.plan.fasteners import NUT_FIT_MM, OUTSIDE_MM, ROOF_IN_SKINS_DEG, Bore, Hexagon
from mirrorcam.cad.plan.hardware import Hardware
from mirrorcam.cad.plan.prisms import along_x, along_z, box
from mirrorcam.cad.plan.seats import Frustum
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.camera_body import CameraBody, Lips

# Pads stand off the tray by this much, and are this wide and, along the lens axis, this long.
PAD_MM, PAD_WIDE_MM, PAD_LONG_MM = 0.8, 4.0, 8.0
# Ends with less flat than this, of bodies whose edges are rounder than that, rest on a V.
FLAT_MM, ROUND_MM = 10.0, 4.0
# Between the body and the leaf at its far end.
APART_MM = 1.0
# Holes go on beyond a screw's tip: at a square corner that lies in the plane of the leaf, or nearly.
BEYOND_MM = 4.0
# Pieces that join reach this far into each other.
ROOT_MM = 0.5


@dataclass(frozen=True)
class Tray:
    """A body in its tray, seen with the stop at low u: u = x, or -x where `side` is -1. Lengths in mm.

    `low` and `high` (3,) are its box in (u, y, z), `radius_mm` that of its edges along z. The tray's wall, end
    and front lie `PAD_MM` off it.
    """

    side: float
    low: FloatArray
    high: FloatArray
    radius_mm: float
    lip_mm: float

    @classmethod
    def of(cls, camera: CameraBody, lips: Lips) -> Tray:
        """The stop is at the end that is farther from the lens, whose corner then reaches over the front."""
        body = body_box(camera)
        side = 1.0 if body.low[0] + body.high[0] <= 1e-9 else -1.0
        ends = np.sort(side * np.array([body.low[0], body.high[0]]))
        low, high = body.low.copy(), body.high.copy()
        low[0], high[0] = ends
        return cls(side, low, high, camera.end_radius_mm, lips.lip_mm)

    @property
    def wall_mm(self) -> float:
        return float(self.low[1]) - PAD_MM

    @property
    def end_mm(self) -> float:
        return float(self.low[0]) - PAD_MM

    @property
    def level_mm(self) -> float:
        """The height of the pads and the screw at the body's sides: half its depth, so that no force tips it."""
        return float(self.low[2] + self.high[2]) / 2.0

    @property
    def is_round(self) -> bool:
        flat = float(self.high[1] - self.low[1]) - 2.0 * self.radius_mm
        return flat < FLAT_MM and self.radius_mm > ROUND_MM

    def rig(self, points: Sequence[float] | FloatArray) -> FloatArray:
        """Points or vectors (..., 3) in (u, y, z), in rig."""
        return np.asarray(points, dtype=np.float64) * [self.side, 1.0, 1.0]

    def box(self, u: tuple[float, float], y: tuple[float, float], z: tuple[float, float]) -> Frustum:
        xs = sorted(self.side * np.array(u))
        return box((xs[0], y[0], z[0]), (xs[1], y[1], z[1]))

    def across(self, points: Sequence[tuple[float, float]], z: tuple[float, float]) -> Frustum:
        """A convex polygon (n, 2) of u and y, from one z to another."""
        return along_z(np.array(points) * [self.side, 1.0], *z)


def stops(tray: Tray, nest: Nest, top: float, wall: float) -> list[Frustum]:
    """The lip beside the wall, the end with the corner over the front, and the pads on all of them."""
    low, high, end = tray.low, tray.high, tray.end_mm
    front, level, root = float(high[2]) + PAD_MM, tray.level_mm, ROOT_MM
    corner, *beside = nest.points[:3] * [tray.side, 1.0, 1.0]
    half = PAD_WIDE_MM / 2.0
    beyond = float(corner[1]) + half
    behind = min(level - PAD_LONG_MM / 2.0, float(high[2]) - 2.0 * wall)
    pieces = [
        tray.box(
            (end - wall, float(high[0]) - tray.radius_mm),
            (tray.wall_mm - root, float(low[1]) + tray.lip_mm),
            (front, top),
        ),
        tray.box((end - wall, end), (tray.wall_mm - root, beyond), (behind, top)),
        tray.box((end - wall, float(corner[0]) + half + 1.0), (tray.wall_mm - root, beyond), (front, top)),
    ]
    for u, y, z in (corner, *beside):
        short = min(half, tray.lip_mm / 2.0)
        profile = [
            (y - short - PAD_MM - root, z + PAD_MM + root),
            (y - short, z),
            (y + short, z),
            (y + short, z + PAD_MM + root),
        ]
        pieces.append(along_x(np.array(profile), *sorted(tray.side * (u + s * half) for s in (-1.0, 1.0))))
    z_mm = (level - PAD_LONG_MM / 2.0, level + PAD_LONG_MM / 2.0)
    for point, normal in zip(
        nest.points[3:] * [tray.side, 1.0, 1.0], nest.normals[3:] * [tray.side, 1.0, 1.0], strict=True
    ):
        u, y = float(point[0]), float(point[1])
        if normal[0] < 1e-9:
            pieces.append(tray.box((u - half, u + half), (tray.wall_mm - root, y), z_mm))
        elif normal[1] < -1e-9:
            pieces.append(tray.across(_upper_wedge(u, y, end - root, half), z_mm))
        elif normal[1] > 1e-9:
            pieces.append(tray.across(_lower_wedge(u, y, end - root, tray.wall_mm - root), z_mm))
        else:
            foot = end - root
            profile = [(foot, y - half - (u - foot)), (u, y - half), (u, y + half), (foot, y + half)]
            pieces.append(tray.across(profile, z_mm))
    return pieces


def _lower_wedge(u: float, y: float, end: float, wall: float) -> list[tuple[float, float]]:
    """The plane at 45 deg through a point, from the end to the wall, and what fills the corner."""
    return [(end, y + u - end), (u + y - wall, wall), (end, wall)]


def _upper_wedge(u: float, y: float, end: float, half: float) -> list[tuple[float, float]]:
    """The plane at 45 deg through a point, from the end on, and the wedge over it."""
    return [(end, y - (u - end)), (u + half, y + half), (end, y + half)]


def back_leaf(tray: Tray, screw: SprungScrew, around: float, hardware: Hardware) -> list[Frustum]:
    """The leaf behind the body, with a boss that grows out of it at 45 deg."""
    u, y = float(tray.side * screw.tip[0]), float(screw.tip[1])
    top = float(screw.tip[2]) - hardware.clip.behind_mm
    low, half = float(screw.tip[2]) - screw.mouth_mm, screw.leaf.width_mm / 2.0
    under = top - screw.leaf.thickness_mm
    boss = [
        (y - around - (under - low), under),
        (y - around, low),
        (y + around, low),
        (y + around, top),
        (y - around, top),
    ]
    xs = sorted(tray.side * np.array([u - around, u + around]))
    return [
        tray.box((u - half, u + half), (tray.wall_mm - ROOT_MM, y + around), (under, top)),
        along_x(np.array(boss), float(xs[0]), float(xs[1])),
    ]


def far_leaf(tray: Tray, screw: SprungScrew, around: float) -> list[Frustum]:
    """The leaf beyond the end, with a boss along the screw on its outer side.

    A leaf thicker than the boss is long is cut off in the plane of the mouth, where tools come from.
    """
    inner = float(tray.high[0]) + APART_MM
    tip = np.array([tray.side * screw.tip[0], screw.tip[1]])
    mouth = tip + screw.mouth_mm / np.sqrt(2.0)
    aside = around / np.sqrt(2.0)
    lower, upper = mouth + np.array([aside, -aside]), mouth + np.array([-aside, aside])
    at_leaf = [float(corner[1] - (corner[0] - inner)) for corner in (lower, upper)]
    level, half = tray.level_mm, screw.leaf.width_mm / 2.0
    thick = screw.leaf.thickness_mm
    foot, outer, top = tray.wall_mm - ROOT_MM, inner + thick, at_leaf[0] + thick
    beyond = outer + top - float(mouth.sum())
    end = [(outer, top)] if beyond <= 0.0 else [(outer, top - beyond), (outer - beyond, top)]
    return [
        tray.across([(inner, foot), (outer, foot), *end, (inner, top)], (level - half, level + half)),
        tray.across(
            [(inner, at_leaf[0]), (lower[0], lower[1]), (upper[0], upper[1]), (inner, at_leaf[1])],
            (level - around, level + around),
        ),
    ]


def thread_cuts(screw: SprungScrew, around: float, hardware: Hardware) -> list[Frustum | Bore | Hexagon]:
    """The hole of a sprung screw, from outside through its boss, and the space for its insert or nut."""
    table, axis = hardware.screw, screw.axis
    up = SCENE - (SCENE @ axis) * axis
    up /= np.linalg.norm(up)
    mouth = screw.tip - (screw.mouth_mm + OUTSIDE_MM) * axis
    radius, roof_deg = table.clearance_hole_mm / 2.0, ROOF_IN_SKINS_DEG
    pockets: list[Bore | Hexagon]
    if table.kind == "insert":
        hole, deep = table.insert_hole_mm / 2.0, table.insert_depth_mm + OUTSIDE_MM
        pockets = [Bore(mouth, axis, hole, deep, up, roof_deg=roof_deg)]
    else:
        seat = mouth + (screw.thread_mm + OUTSIDE_MM) * axis
        deep = screw.mouth_mm - screw.thread_mm + BEYOND_MM
        pocket = Hexagon(seat + deep * axis, -axis, up, table.nut_flats_mm + NUT_FIT_MM, deep)
        # Higher than the pocket: what of an oblique shoulder is left over a hole wants support.
        pockets, roof_deg = [pocket], float(np.degrees(np.arcsin(radius / (pocket.ridge_mm + NUT_FIT_MM))))
    through = screw.mouth_mm + OUTSIDE_MM + BEYOND_MM
    return [Bore(mouth, axis, radius, through, up, roof_deg=roof_deg), *pockets]
