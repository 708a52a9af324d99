"""The clip's holding of a camera by its body: a tray open to the scene, with a nest of six points.

Three pads fix the body's front, beside the slide and at the corner of the stop's end. The body's side towards the mount
and its end rest on two pads and one; round ends rest on a V instead, and on one pad. Two screws in leaves press: one on
the back, one obliquely on the far corner. The part prints lying on its slide, the leaves and all that stands off them
at 45 deg or steeper.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from mirrorcam.cad.parts.camera_box import (
    ABOVE,
    GRAVITY_N_PER_KG,
    SCENE,
    UP,
    Held,
    Leaf,
    Nest,
    SprungScrew,
    body_box,
    leaf_thickness_mm,
    least_forces_n,
    tie_height_mm,
)
from mirrorcam.cad.plan.fasteners import NUT_FIT_MM, OUTSIDE_MM, ROOF_IN_SKINS_DEG, Bore, Hexagon
from mirrorcam.cad.plan.hardware import Fastening, Hardware
from mirrorcam.cad.plan.prisms import along_x, along_z, box
from mirrorcam.cad.plan.seats import Frustum
from mirrorcam.core.errors import InputError
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
        # Higher than the pocket: the rest of an oblique shoulder over a hole needs support.
        pockets, roof_deg = [pocket], float(np.degrees(np.arcsin(radius / (pocket.ridge_mm + NUT_FIT_MM))))
    through = screw.mouth_mm + OUTSIDE_MM + BEYOND_MM
    return [Bore(mouth, axis, radius, through, up, roof_deg=roof_deg), *pockets]


# Pads keep off the rounding of the edges.
OFF_ROUND_MM = 3.0
# How much further a screw can be turned in than the drawn body needs.
RESERVE_MM = 3.0
# What the screws press with at least, and the leaf behind the back's widest and least width.
LEAST_FORCE_N = 3.0
# The weight, beyond the camera's own, with which no point lets go: a point just about to would not hold.
WEIGHT_RESERVE = 1.1
LEAF_WIDE_MM, LEAF_NARROW_MM = 20.0, 11.0
# Share of the back's screw that the front pad away from the slide takes.
FAR_SHARE = 0.6


def hold_body(camera: CameraBody, lips: Lips, around_mm: float, hardware: Hardware) -> Held:
    """Lay out the tray of a body; raises InputError with the measure at fault.

    `around_mm` is the radius of a boss for a screw.
    """
    tray = Tray.of(camera, lips)
    nest = _with_forces(tray, _nest(tray, camera, around_mm, hardware), camera, hardware)
    back, far = nest.screws
    top = float(tray.high[2]) + hardware.clip.wall_mm
    pieces = [*stops(tray, nest, top, hardware.clip.wall_mm), *back_leaf(tray, back, around_mm, hardware)]
    pieces += far_leaf(tray, far, around_mm)
    bottom = min(
        float(back.tip[2]) - back.mouth_mm, float(tray.low[2]) - hardware.clip.behind_mm - tie_height_mm(hardware)
    )
    far_u = float(tray.high[0]) + APART_MM + far.leaf.thickness_mm
    ends = sorted(tray.side * np.array([tray.end_mm - hardware.clip.wall_mm, far_u]))
    return Held(
        pieces=tuple(pieces),
        cuts=tuple(cut for screw in nest.screws for cut in thread_cuts(screw, around_mm, hardware)),
        inner_y_mm=tray.wall_mm,
        x_mm=(float(ends[0]), float(ends[1])),
        z_mm=(bottom, top),
        board_screws=np.zeros((0, 3)),
        nest=nest,
    )


def _nest(tray: Tray, camera: CameraBody, around_mm: float, hardware: Hardware) -> Nest:
    """The six points and the two screws, their leaves of a first thickness."""
    front = _front_points(tray, camera)
    sides, inwards = _side_points(tray)
    points = tray.rig(np.vstack([front, sides]))
    normals = tray.rig(np.vstack([np.tile(-ABOVE, (3, 1)), inwards]))
    screws = (
        _back_screw(tray, front, camera, around_mm, hardware),
        _far_screw(tray, around_mm, hardware),
    )
    return Nest(points, normals, screws)


def _front_points(tray: Tray, camera: CameraBody) -> FloatArray:
    """Points (3, 3) in (u, y, z) of the front: at the stop's corner away from the wall, and two beside the wall."""
    low, high, r = tray.low, tray.high, tray.radius_mm
    reach, half = tray.lip_mm / 2.0, OFF_ROUND_MM + PAD_WIDE_MM / 2.0
    near, far = float(low[1]) + reach, float(high[1]) - reach
    corner = float(low[0]) + max(r + 1.0, half)
    ring = camera.lens_ring_mm / 2.0
    if (clear := -(corner + PAD_WIDE_MM / 2.0 + 1.0) - ring) < 0.0:
        raise InputError(
            f"camera clip's corner reaches {-clear:.1f} mm over the lens ring, expected it beside the ring"
        )
    if (clear := -float(low[1]) - tray.lip_mm - ring) < 0.0:
        raise InputError(
            f"camera clip's lip reaches {-clear:.1f} mm over the lens ring ({camera.lens_ring_mm:g} mm across), "
            f"expected it beside it: lip_mm at most {tray.lip_mm + clear:.1f}"
        )
    z = float(high[2])
    return np.array([(corner, far, z), (float(low[0]) + r + half, near, z), (float(high[0]) - r - half, near, z)])


def _side_points(tray: Tray) -> tuple[FloatArray, FloatArray]:
    """Points (3, 3) in (u, y, z) of the sides and the end, and unit vectors (3, 3) into the body there."""
    low, high, r, z = tray.low, tray.high, tray.radius_mm, tray.level_mm
    off = r + OFF_ROUND_MM
    far = (float(high[0]) - off, float(low[1]), z)
    if tray.is_round:
        both = np.array([(1.0, 1.0, 0.0), (1.0, -1.0, 0.0)]) / np.sqrt(2.0)
        centres = np.array([(low[0] + r, low[1] + r, z), (low[0] + r, high[1] - r, z)])
        return np.vstack([centres - r * both, far]), np.vstack([both, SCENE])
    end = (float(low[0]), float(low[1]) + off + PAD_WIDE_MM / 2.0, z)
    return np.array([(float(low[0]) + off, float(low[1]), z), far, end]), np.array([SCENE, SCENE, UP])


def _back_screw(tray: Tray, front: FloatArray, camera: CameraBody, around_mm: float, hardware: Hardware) -> SprungScrew:
    """The screw on the back, within the triangle of the front's points, its leaf beside the cable."""
    shares = np.array([FAR_SHARE, *((1.0 - FAR_SHARE) / 2.0,) * 2])
    u, y, _ = (float(value) for value in shares @ front)
    cable = tray.side * camera.cable_x_mm
    beside = abs(cable - u) - camera.cable_mm / 2.0 - hardware.fit.free_mm
    width = min(LEAF_WIDE_MM, 2.0 * beside, 2.0 * (u - tray.end_mm))
    if width < LEAF_NARROW_MM:
        raise InputError(
            f"camera clip's leaf behind the body would be {width:.1f} mm wide beside the cable, "
            f"expected at least {LEAF_NARROW_MM:g} mm"
        )
    screw = hardware.screw
    space = hardware.clip.behind_mm
    thread, thick = _boss_mm(screw, hardware.printer.wall_mm)
    mouth = space + thick
    way = np.array([space + float(tray.level_mm - tray.low[2]), 0.0])
    out = float(tray.high[1]) - y + 2.0 * around_mm
    leaf = Leaf(
        y - tray.wall_mm, min(around_mm + thick - hardware.printer.wall_mm, 0.8 * (y - tray.wall_mm)), width, 2.0, 1.0
    )
    return SprungScrew(
        tip=tray.rig((u, y, float(tray.low[2]))),
        axis=ABOVE,
        mouth_mm=mouth,
        thread_mm=thread,
        length_mm=_long_enough(mouth, screw),
        leaf=leaf,
        nut_way_mm=np.array([way[0] * ABOVE, out * SCENE]),
        leaf_at=tray.rig((u, (y + tray.wall_mm) / 2.0, float(tray.low[2]) - space)),
        leaf_way=-ABOVE,
    )


def _far_screw(tray: Tray, around_mm: float, hardware: Hardware) -> SprungScrew:
    """The screw on the far corner, at 45 deg; its boss stands on a leaf beyond the body's end."""
    r, screw = tray.radius_mm, hardware.screw
    out = np.array([1.0, 1.0, 0.0]) / np.sqrt(2.0)
    corner = np.array([tray.high[0] - r, tray.high[1] - r, tray.level_mm]) + r * out
    inner = float(tray.high[0]) + APART_MM
    thread, thick = _boss_mm(screw, hardware.printer.wall_mm)
    # From where the axis enters the leaf, the boss is cut obliquely: the thread keeps off that.
    enters = (inner - float(corner[0])) * np.sqrt(2.0)
    mouth = enters + around_mm / 2.0 + thick
    along = float(corner[1] + enters / np.sqrt(2.0)) - tray.wall_mm
    low_side = float(corner[1]) - around_mm / np.sqrt(2.0) + (inner - float(corner[0]) - around_mm / np.sqrt(2.0))
    width = min(LEAF_WIDE_MM, float(tray.high[2] - tray.low[2]) - PAD_MM)
    leaf = Leaf(along, along + tray.wall_mm - low_side, max(width, 2.0 * around_mm), 3.0, 1.0 / np.sqrt(2.0))
    return SprungScrew(
        tip=tray.rig(corner),
        axis=tray.rig(-out),
        mouth_mm=mouth,
        thread_mm=thread,
        length_mm=_long_enough(mouth, screw),
        leaf=leaf,
        nut_way_mm=np.array(
            [tray.rig(-out) * (mouth + around_mm), (float(np.ptp([tray.low[1], tray.high[1]])) + mouth) * SCENE]
        ),
        leaf_at=tray.rig((inner, float(corner[1] + tray.wall_mm) / 2.0, tray.level_mm)),
        leaf_way=tray.rig((1.0, 0.0, 0.0)),
    )


def _boss_mm(screw: Fastening, wall_mm: float) -> tuple[float, float]:
    """How deep the thread of a sprung screw begins below the mouth, and the thickness of the boss."""
    if screw.kind == "insert":
        return 0.0, screw.insert_depth_mm + wall_mm
    # The nut is pressed against the shoulder by the screw, and enters from the body's side.
    return screw.insert_wall_mm, screw.insert_wall_mm + screw.nut_height_mm + NUT_FIT_MM


def _long_enough(mouth_mm: float, screw: Fastening) -> float:
    fits = [length for length in screw.lengths_mm if length >= mouth_mm + RESERVE_MM]
    if not fits:
        raise InputError(
            f"camera clip needs an M3 screw of {mouth_mm + RESERVE_MM:.1f} mm, longer than any on the list"
        )
    return min(fits)


def _with_forces(tray: Tray, nest: Nest, camera: CameraBody, hardware: Hardware) -> Nest:
    """The nest with leaves as thick as the camera's weight needs, when the robot moves."""
    middle = tray.rig((tray.low + tray.high) / 2.0)
    weight = camera.mass_g / 1000.0 * GRAVITY_N_PER_KG * hardware.clip.shaken_g * WEIGHT_RESERVE
    forces = np.maximum(least_forces_n(nest, middle, weight), LEAST_FORCE_N)
    modulus, least = hardware.printer.plastic_mpa, hardware.printer.wall_mm
    screws = []
    for screw, force in zip(nest.screws, forces, strict=True):
        thick = max(least, float(np.ceil(10.0 * leaf_thickness_mm(float(force), screw.leaf, modulus)) / 10.0))
        screws.append(replace(screw, leaf=replace(screw.leaf, thickness_mm=thick)))
    return replace(nest, screws=tuple(screws))
