"""The cradle of a camera with a body: a tray open to the scene, with a nest of six points.

Three pads locate the body's front: two near the slide, one at the corner of the stop's end. Two pads locate the body's
side towards the mount, and one locates its end; a round end rests on a V instead, with one pad on the side. Two screws
in leaves press on the body: one on its back, one obliquely on its far corner. The part prints lying on its slide, with
all overhangs at 45 deg or steeper.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from mirrorcam.cad.parts.camera_box import (
    ABOVE,
    GRAVITY_N_PER_KG,
    LEAF_TOLERANCE_MM,
    SCENE,
    UP,
    Cradle,
    Leaf,
    Nest,
    SprungScrew,
    body_box,
    required_forces_n,
    tie_height_mm,
)
from mirrorcam.cad.plan.dimension import Length, length
from mirrorcam.cad.plan.fasteners import NUT_FIT_MM, OUTSIDE_MM, ROOF_IN_SKINS_DEG, Bore, Hexagon
from mirrorcam.cad.plan.hardware import Fastening, Hardware
from mirrorcam.cad.plan.prisms import box, corners_of, prism_along_x, prism_along_z
from mirrorcam.cad.plan.seats import Frustum
from mirrorcam.cad.plan.threads import THREADS
from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.camera_body import CameraBody, Lips

# Height of pads above the tray, their width, and their length along the lens axis.
PAD_MM, PAD_WIDTH_MM, PAD_LENGTH_MM = 0.8, 4.0, 8.0
# An end rests on a V if its flat is shorter than FLAT_MM and its edges' radius is larger than ROUND_MM.
FLAT_MM, ROUND_MM = 10.0, 4.0
# Gap between the body and the leaf at its far end.
LEAF_GAP_MM = 1.5
# Radius of the fillets at the roots of leaves.
FILLET_MM = 2.0
# How far the fillets shorten a leaf, as if its root were there (benchmarks/clip_leaves.py).
ROOT_MM = 0.3 * FILLET_MM
# How much more the root at the wall's end yields than one in its middle: benchmarks/clip_leaves.py, finite elements.
WALL_END_ROOT = 2.1
# A cantilever thicker than a quarter of its length is no leaf spring.
THICKEST_LEAF = 0.25
# Length of holes past a screw's tip, which is near the plane of the leaf at a square corner.
PAST_TIP_MM = 4.0
# Overlap of joined pieces.
OVERLAP_MM = 0.5


@dataclass(frozen=True)
class Tray:
    """A body in its tray, in coordinates (u, y, z), mm, with the stop at low u: u = x, or -x if `side` is -1.

    `low` and `high` (3,) are the body's box in (u, y, z), and `radius_mm` is the radius of its edges along z. The
    tray's wall, end and front keep `PAD_MM` from it.
    """

    side: float
    low: FloatArray
    high: FloatArray
    radius_mm: float
    lip_mm: float

    @classmethod
    def of(cls, camera: CameraBody, lips: Lips) -> Tray:
        """The tray of a body, with the stop at the end farther from the lens, where its corner clears the lens."""
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
        """z of the pads and the screw at the body's sides: half its depth, so that they do not tip it."""
        return float(self.low[2] + self.high[2]) / 2.0

    @property
    def is_round(self) -> bool:
        flat = float(self.high[1] - self.low[1]) - 2.0 * self.radius_mm
        return flat < FLAT_MM and self.radius_mm > ROUND_MM

    def in_rig(self, points: Sequence[float] | FloatArray) -> FloatArray:
        """Transform points or vectors (..., 3) from (u, y, z) to the rig frame."""
        return np.asarray(points, dtype=np.float64) * [self.side, 1.0, 1.0]

    def box(self, u: tuple[float, float], y: tuple[float, float], z: tuple[float, float]) -> Frustum:
        x = sorted(self.side * np.array(u))
        return box((x[0], y[0], z[0]), (x[1], y[1], z[1]))

    def prism(self, points: Sequence[tuple[float, float]], z: tuple[float, float]) -> Frustum:
        """The prism on a convex polygon (n, 2) in u and y, between two z coordinates."""
        return prism_along_z(np.array(points) * [self.side, 1.0], *z)


def stops(tray: Tray, nest: Nest, top: float, wall: float) -> list[Frustum]:
    """The lip along the wall, the end with the corner over the front, and the pads on all of them."""
    low, high, end = tray.low, tray.high, tray.end_mm
    front, level, overlap = float(high[2]) + PAD_MM, tray.level_mm, OVERLAP_MM
    corner, *wall_points = nest.points[:3] * [tray.side, 1.0, 1.0]
    half = PAD_WIDTH_MM / 2.0
    max_y = float(corner[1]) + half
    min_z = min(level - PAD_LENGTH_MM / 2.0, float(high[2]) - 2.0 * wall)
    pieces = [
        tray.box(
            (end - wall, float(high[0]) - tray.radius_mm),
            (tray.wall_mm - overlap, float(low[1]) + tray.lip_mm),
            (front, top),
        ),
        tray.box((end - wall, end), (tray.wall_mm - overlap, max_y), (min_z, top)),
        tray.box((end - wall, float(corner[0]) + half + 1.0), (tray.wall_mm - overlap, max_y), (front, top)),
    ]
    for u, y, z in (corner, *wall_points):
        half_length = min(half, tray.lip_mm / 2.0)
        profile = [
            (y - half_length - PAD_MM - overlap, z + PAD_MM + overlap),
            (y - half_length, z),
            (y + half_length, z),
            (y + half_length, z + PAD_MM + overlap),
        ]
        pieces.append(prism_along_x(np.array(profile), *sorted(tray.side * (u + s * half) for s in (-1.0, 1.0))))
    z_mm = (level - PAD_LENGTH_MM / 2.0, level + PAD_LENGTH_MM / 2.0)
    for point, normal in zip(
        nest.points[3:] * [tray.side, 1.0, 1.0], nest.normals[3:] * [tray.side, 1.0, 1.0], strict=True
    ):
        u, y = float(point[0]), float(point[1])
        if normal[0] < 1e-9:
            pieces.append(tray.box((u - half, u + half), (tray.wall_mm - overlap, y), z_mm))
        elif normal[1] < -1e-9:
            pieces.append(tray.prism(_upper_wedge(u, y, end - overlap, half), z_mm))
        elif normal[1] > 1e-9:
            pieces.append(tray.prism(_lower_wedge(u, y, end - overlap, tray.wall_mm - overlap), z_mm))
        else:
            root_u = end - overlap
            profile = [(root_u, y - half - (u - root_u)), (u, y - half), (u, y + half), (root_u, y + half)]
            pieces.append(tray.prism(profile, z_mm))
    return pieces


def _lower_wedge(u: float, y: float, end: float, wall: float) -> list[tuple[float, float]]:
    """The wedge under the plane at 45 deg through a point; it fills the corner between end and wall."""
    return [(end, y + u - end), (u + y - wall, wall), (end, wall)]


def _upper_wedge(u: float, y: float, end: float, half: float) -> list[tuple[float, float]]:
    """The wedge over the plane at 45 deg through a point; it starts at the end."""
    return [(end, y - (u - end)), (u + half, y + half), (end, y + half)]


def back_leaf(tray: Tray, screw: SprungScrew, boss_radius: float, hardware: Hardware) -> list[Frustum]:
    """The leaf behind the body, with a boss that widens towards it at 45 deg."""
    u, y = float(tray.side * screw.tip[0]), float(screw.tip[1])
    top = float(screw.tip[2]) - hardware.clip.behind_mm
    low, half = float(screw.tip[2]) - screw.mouth_mm, screw.leaf.width_mm / 2.0
    leaf_z = top - screw.leaf.thickness_mm
    # A leaf as thick as the boss is long leaves no slope.
    slope = [(y - boss_radius - (leaf_z - low), leaf_z)] if leaf_z > low + 1e-9 else []
    boss = [
        *slope,
        (y - boss_radius, low),
        (y + boss_radius, low),
        (y + boss_radius, top),
        (y - boss_radius, top),
    ]
    x_range = sorted(tray.side * np.array([u - boss_radius, u + boss_radius]))
    ends = sorted(tray.side * np.array([u - half, u + half]))
    fillets = [
        prism_along_x(fillet[:, ::-1], float(ends[0]), float(ends[1]))
        for fillet in _fillets((leaf_z, top), tray.wall_mm)
    ]
    return [
        tray.box((u - half, u + half), (tray.wall_mm - OVERLAP_MM, y + boss_radius), (leaf_z, top)),
        prism_along_x(np.array(boss), float(x_range[0]), float(x_range[1])),
        *fillets,
    ]


def _fillets(faces: tuple[float, float], wall: float) -> list[FloatArray]:
    """Fillets at the root of a leaf between two faces, in coordinates across the leaf and along y (3, 2), y = `wall`.

    Each is a pair of triangles inside the tangent arc.
    """
    foot, middle = wall - OVERLAP_MM, (1.0 - np.sqrt(0.5)) * FILLET_MM
    fillets = []
    for face, out in zip(faces, (-1.0, 1.0), strict=True):
        inner, corner = face - out * OVERLAP_MM, face + out * FILLET_MM
        bend = (face + out * middle, wall + middle)
        fillets.append(np.array([(inner, foot), (corner, foot), (corner, wall), bend, (inner, wall + middle)]))
        fillets.append(np.array([(inner, wall), bend, (face, wall + FILLET_MM), (inner, wall + FILLET_MM)]))
    return fillets


def far_leaf(tray: Tray, screw: SprungScrew, boss_radius: float) -> list[Frustum]:
    """The leaf beyond the body's end, with a boss along the screw on its outer side.

    A leaf that is thicker than the boss is long is cut off in the plane of the hole's mouth, for access by tools.
    """
    inner = float(tray.high[0]) + LEAF_GAP_MM
    tip = np.array([tray.side * screw.tip[0], screw.tip[1]])
    mouth = tip + screw.mouth_mm / np.sqrt(2.0)
    offset = boss_radius / np.sqrt(2.0)
    low, high = mouth + np.array([offset, -offset]), mouth + np.array([-offset, offset])
    boss_y = [float(corner[1] - (corner[0] - inner)) for corner in (low, high)]
    level, half = tray.level_mm, screw.leaf.width_mm / 2.0
    thickness = screw.leaf.thickness_mm
    foot, outer, top = tray.wall_mm - OVERLAP_MM, inner + thickness, boss_y[0] + thickness
    excess = outer + top - float(mouth.sum())
    if excess > thickness:
        raise InputError(
            f"camera clip's leaf at the body's end would be {thickness:.1f} mm thick, but hides its screw's boss above "
            f"{thickness - (excess - thickness):.1f} mm"
        )
    end = [(outer, top)] if excess <= 0.0 else [(outer, top - excess), (outer - excess, top)]
    fillets = [
        tray.prism([(u, y) for u, y in fillet], (level - half, level + half))
        for fillet in _fillets((inner, outer), tray.wall_mm)
    ]
    return [
        *fillets,
        tray.prism([(inner, foot), (outer, foot), *end, (inner, top)], (level - half, level + half)),
        tray.prism(
            [(inner, boss_y[0]), (low[0], low[1]), (high[0], high[1]), (inner, boss_y[1])],
            (level - boss_radius, level + boss_radius),
        ),
    ]


def leaf_lengths(screw: SprungScrew, wall_y: float) -> tuple[Length, ...]:
    """What a leaf's force follows from: its thickness, length from the wall to the thread, width, and fillets."""
    leaf, way = screw.leaf, screw.leaf_way
    root = screw.leaf_at + (wall_y - screw.leaf_at[1]) * SCENE
    end, half = root + (leaf.length_mm + ROOT_MM) * SCENE, leaf.width_mm / 2.0 * np.cross(SCENE, way)
    centre = root + leaf.thickness_mm * way + FILLET_MM * (way + SCENE)
    return (
        replace(
            length(screw.leaf_at, screw.leaf_at + leaf.thickness_mm * way, "leaf"),
            minus_mm=LEAF_TOLERANCE_MM,
            plus_mm=LEAF_TOLERANCE_MM,
        ),
        length(root, end),
        length(root - half, root + half),
        length(centre, centre - FILLET_MM * (way + SCENE) / np.sqrt(2.0), before="2x R"),
    )


def thread_cuts(screw: SprungScrew, boss_radius: float, hardware: Hardware) -> list[Frustum | Bore | Hexagon]:
    """The hole of a sprung screw through its boss, and the pocket for its insert or nut."""
    table, axis = hardware.screw, screw.axis
    up = SCENE - (SCENE @ axis) * axis
    up /= np.linalg.norm(up)
    mouth = screw.tip - (screw.mouth_mm + OUTSIDE_MM) * axis
    radius, roof_deg = table.clearance_hole_mm / 2.0, ROOF_IN_SKINS_DEG
    pockets: list[Bore | Hexagon]
    if table.kind == "insert":
        hole, depth = table.insert_hole_mm / 2.0, table.insert_depth_mm + OUTSIDE_MM
        pockets = [Bore(mouth, axis, hole, depth, up, roof_deg=roof_deg)]
    else:
        seat = mouth + (screw.thread_mm + OUTSIDE_MM) * axis
        depth = screw.mouth_mm - screw.thread_mm + PAST_TIP_MM
        pocket = Hexagon(seat + depth * axis, -axis, up, table.nut_flats_mm + NUT_FIT_MM, depth)
        # The hole's roof is higher than the pocket's: an oblique shoulder over the hole would need support.
        pockets, roof_deg = [pocket], float(np.degrees(np.arcsin(radius / (pocket.ridge_mm + NUT_FIT_MM))))
    length = screw.mouth_mm + OUTSIDE_MM + PAST_TIP_MM
    return [Bore(mouth, axis, radius, length, up, roof_deg=roof_deg), *pockets]


# Distance of pads from rounded edges.
PAD_INSET_MM = 3.0
# Length of a screw past the nominal face of the body.
SCREW_RESERVE_MM = 3.0
# Minimum force of a screw.
MIN_FORCE_N = 3.0
# Safety factor on the camera's weight, so that all points stay in contact.
WEIGHT_RESERVE = 1.1
# Maximum and minimum width of the leaf behind the back.
MAX_LEAF_MM, MIN_LEAF_MM = 20.0, 11.0
# Minimum width of the leaf at the end of a thin body: it protrudes past its front and back.
MIN_FAR_LEAF_MM = 10.0
# Fraction of the back screw's force on the front pad far from the slide.
FAR_PAD_FRACTION = 0.6


def hold_body(camera: CameraBody, lips: Lips, boss_radius_mm: float, hardware: Hardware) -> Cradle:
    """Lay out the tray of a body; raises InputError with the dimension if it cannot be made.

    `boss_radius_mm` is the radius of a boss for a screw.
    """
    tray = Tray.of(camera, lips)
    nest = _with_forces(tray, _nest(tray, camera, boss_radius_mm, hardware), camera, hardware)
    back, far = nest.screws
    top = float(tray.high[2]) + hardware.clip.wall_mm
    pieces = [*stops(tray, nest, top, hardware.clip.wall_mm), *back_leaf(tray, back, boss_radius_mm, hardware)]
    pieces += far_leaf(tray, far, boss_radius_mm)
    below_body = float(tray.low[2]) - hardware.clip.behind_mm - tie_height_mm(hardware)
    bottom = min(float(corners_of(pieces)[:, 2].min()), below_body)
    far_u = float(tray.high[0]) + LEAF_GAP_MM + far.leaf.thickness_mm + FILLET_MM
    ends = sorted(tray.side * np.array([tray.end_mm - hardware.clip.wall_mm, far_u]))
    return Cradle(
        pieces=tuple(pieces),
        cuts=tuple(cut for screw in nest.screws for cut in thread_cuts(screw, boss_radius_mm, hardware)),
        inner_y_mm=tray.wall_mm,
        x_mm=(float(ends[0]), float(ends[1])),
        z_mm=(bottom, top),
        nest=nest,
    )


def _nest(tray: Tray, camera: CameraBody, boss_radius_mm: float, hardware: Hardware) -> Nest:
    """The six points and the two screws, with leaves of an initial thickness."""
    front = _front_points(tray, camera)
    sides, inwards = _side_points(tray)
    points = tray.in_rig(np.vstack([front, sides]))
    normals = tray.in_rig(np.vstack([np.tile(-ABOVE, (3, 1)), inwards]))
    screws = (
        _back_screw(tray, front, camera, boss_radius_mm, hardware),
        _far_screw(tray, boss_radius_mm, hardware),
    )
    return Nest(points, normals, screws)


def _front_points(tray: Tray, camera: CameraBody) -> FloatArray:
    """Points (3, 3) on the front, in (u, y, z): one at the stop's corner away from the wall, and two near the wall."""
    low, high, r = tray.low, tray.high, tray.radius_mm
    inset, half = tray.lip_mm / 2.0, PAD_INSET_MM + PAD_WIDTH_MM / 2.0
    min_y, max_y = float(low[1]) + inset, float(high[1]) - inset
    corner = float(low[0]) + max(r + 1.0, half)
    ring = camera.lens_ring_mm / 2.0
    if (gap := -(corner + PAD_WIDTH_MM / 2.0 + 1.0) - ring) < 0.0:
        raise InputError(f"camera clip's corner overlaps the lens ring by {-gap:.1f} mm, but must be outside it")
    if (gap := -float(low[1]) - tray.lip_mm - ring) < 0.0:
        raise InputError(
            f"camera clip's lip overlaps the lens ring ({camera.lens_ring_mm:g} mm across) by {-gap:.1f} mm, "
            f"expected lip_mm of at most {tray.lip_mm + gap:.1f}"
        )
    z = float(high[2])
    return np.array([(corner, max_y, z), (float(low[0]) + r + half, min_y, z), (float(high[0]) - r - half, min_y, z)])


def _side_points(tray: Tray) -> tuple[FloatArray, FloatArray]:
    """Points (3, 3) on the sides and the end, in (u, y, z), and their unit normals (3, 3) into the body."""
    low, high, r, z = tray.low, tray.high, tray.radius_mm, tray.level_mm
    inset = r + PAD_INSET_MM
    far = (float(high[0]) - inset, float(low[1]), z)
    if tray.is_round:
        v_normals = np.array([(1.0, 1.0, 0.0), (1.0, -1.0, 0.0)]) / np.sqrt(2.0)
        centres = np.array([(low[0] + r, low[1] + r, z), (low[0] + r, high[1] - r, z)])
        return np.vstack([centres - r * v_normals, far]), np.vstack([v_normals, SCENE])
    end = (float(low[0]), float(low[1]) + inset + PAD_WIDTH_MM / 2.0, z)
    return np.array([(float(low[0]) + inset, float(low[1]), z), far, end]), np.array([SCENE, SCENE, UP])


def _back_screw(
    tray: Tray, front: FloatArray, camera: CameraBody, boss_radius_mm: float, hardware: Hardware
) -> SprungScrew:
    """The screw on the back, within the triangle of the front's pads, with its leaf clear of the cable."""
    weights = np.array([FAR_PAD_FRACTION, *((1.0 - FAR_PAD_FRACTION) / 2.0,) * 2])
    u, y, _ = (float(value) for value in weights @ front)
    cable = tray.side * camera.cable_x_mm
    space_to_cable = abs(cable - u) - camera.cable_mm / 2.0 - hardware.fit.free_mm
    width = min(MAX_LEAF_MM, 2.0 * space_to_cable, 2.0 * (u - tray.end_mm))
    if width < MIN_LEAF_MM:
        raise InputError(
            f"camera clip's leaf behind the body would be {width:.1f} mm wide next to the cable, "
            f"expected at least {MIN_LEAF_MM:g} mm"
        )
    screw = hardware.screw
    gap = hardware.clip.behind_mm
    thread, boss_height = _boss_mm(screw, hardware.printer.wall_mm)
    mouth = gap + boss_height
    exit_z = gap + float(tray.level_mm - tray.low[2])
    exit_y = float(tray.high[1]) - y + 2.0 * boss_radius_mm
    leaf = Leaf(
        y - tray.wall_mm - ROOT_MM,
        min(boss_radius_mm + boss_height - hardware.printer.wall_mm, 0.8 * (y - tray.wall_mm)),
        width,
        2.0,
        1.0,
        THREADS[screw.thread].pitch_mm,
    )
    return SprungScrew(
        tip=tray.in_rig((u, y, float(tray.low[2]))),
        axis=ABOVE,
        mouth_mm=mouth,
        thread_mm=thread,
        length_mm=_screw_length_mm(mouth, screw),
        leaf=leaf,
        nut_way_mm=np.array([exit_z * ABOVE, exit_y * SCENE]),
        leaf_at=tray.in_rig((u, (y + tray.wall_mm) / 2.0, float(tray.low[2]) - gap)),
        leaf_way=-ABOVE,
    )


def _far_screw(tray: Tray, boss_radius_mm: float, hardware: Hardware) -> SprungScrew:
    """The screw on the far corner, at 45 deg, with its boss on a leaf beyond the body's end."""
    r, screw = tray.radius_mm, hardware.screw
    outward = np.array([1.0, 1.0, 0.0]) / np.sqrt(2.0)
    corner = np.array([tray.high[0] - r, tray.high[1] - r, tray.level_mm]) + r * outward
    inner = float(tray.high[0]) + LEAF_GAP_MM
    thread, boss_height = _boss_mm(screw, hardware.printer.wall_mm)
    # The thread starts past the oblique joint of boss and leaf.
    to_leaf = (inner - float(corner[0])) * np.sqrt(2.0)
    mouth = to_leaf + boss_radius_mm / 2.0 + boss_height
    leaf_length = float(corner[1] + to_leaf / np.sqrt(2.0)) - tray.wall_mm
    boss_foot_y = (
        float(corner[1]) - boss_radius_mm / np.sqrt(2.0) + (inner - float(corner[0]) - boss_radius_mm / np.sqrt(2.0))
    )
    width = min(MAX_LEAF_MM, float(tray.high[2] - tray.low[2]) - PAD_MM)
    leaf = Leaf(
        leaf_length - ROOT_MM,
        leaf_length + tray.wall_mm - boss_foot_y,
        max(width, MIN_FAR_LEAF_MM),
        3.0,
        1.0 / np.sqrt(2.0),
        THREADS[screw.thread].pitch_mm,
        WALL_END_ROOT,
    )
    return SprungScrew(
        tip=tray.in_rig(corner),
        axis=tray.in_rig(-outward),
        mouth_mm=mouth,
        thread_mm=thread,
        length_mm=_screw_length_mm(mouth, screw),
        leaf=leaf,
        nut_way_mm=np.array(
            [
                tray.in_rig(-outward) * (mouth + boss_radius_mm),
                (float(np.ptp([tray.low[1], tray.high[1]])) + mouth) * SCENE,
            ]
        ),
        leaf_at=tray.in_rig((inner, float(corner[1] + tray.wall_mm) / 2.0, tray.level_mm)),
        leaf_way=tray.in_rig((1.0, 0.0, 0.0)),
    )


def _boss_mm(screw: Fastening, wall_mm: float) -> tuple[float, float]:
    """Depth of a sprung screw's thread below the mouth, and thickness of the boss."""
    if screw.kind == "insert":
        return 0.0, screw.insert_depth_mm + wall_mm
    # The nut enters from the body's side, and the screw presses it against the shoulder.
    return screw.insert_wall_mm, screw.insert_wall_mm + screw.nut_height_mm + NUT_FIT_MM


def _screw_length_mm(mouth_mm: float, screw: Fastening) -> float:
    lengths = [length for length in screw.lengths_mm if length >= mouth_mm + SCREW_RESERVE_MM]
    if not lengths:
        raise InputError(
            f"camera clip needs an {screw.thread} screw of {mouth_mm + SCREW_RESERVE_MM:.1f} mm, longer than any in "
            "lengths_mm under [screw]"
        )
    return min(lengths)


def _with_forces(tray: Tray, nest: Nest, camera: CameraBody, hardware: Hardware) -> Nest:
    """The nest with leaves thick enough for the camera's weight under the robot's acceleration.

    Raises InputError if a leaf would be too thick to bend, or strained too far.
    """
    printer, centre = hardware.printer, tray.in_rig((tray.low + tray.high) / 2.0)
    weight = camera.mass_g / 1000.0 * GRAVITY_N_PER_KG * hardware.clip.shaken_g * WEIGHT_RESERVE
    forces = np.maximum(required_forces_n(nest, centre, weight), MIN_FORCE_N)
    screws = []
    for name, screw, force in zip(("behind the body", "at its end"), nest.screws, forces, strict=True):
        leaf = screw.leaf.with_least_force(float(force), printer.plastic_mpa, printer.plastic_creep)
        thickness = max(printer.wall_mm, float(np.ceil(10.0 * leaf.thickness_mm) / 10.0))
        leaf = replace(leaf, thickness_mm=thickness)
        strain = leaf.strain(printer.plastic_mpa)
        if thickness > leaf.length_mm * THICKEST_LEAF or strain > printer.plastic_strain:
            raise InputError(
                f"camera clip's leaf {name} would be {thickness:.1f} mm thick on {leaf.length_mm:.1f} mm and strained "
                f"by {100.0 * strain:.2f} % to hold {camera.mass_g:g} g at {hardware.clip.shaken_g:g} g, expected at "
                f"most a quarter of its length and {100.0 * printer.plastic_strain:g} %"
            )
        screws.append(replace(screw, leaf=leaf))
    back, far = screws
    # The back screw enters at the leaf's outer face if the leaf is thicker than its boss.
    mouth = max(back.mouth_mm, hardware.clip.behind_mm + back.leaf.thickness_mm)
    back = replace(back, mouth_mm=mouth, length_mm=_screw_length_mm(mouth, hardware.screw))
    return replace(nest, screws=(back, far))
