"""The mount: carries the mirror holder over the camera, and the camera's clip on its slide.

A profile in the y-z plane, extruded along x: it prints standing on its end, with nothing that overhangs but holes. Two
skins with a truss of webs between them run from the foot up behind the camera, round the lower end of the holder, and
along its back.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise, product
from typing import TYPE_CHECKING

import numpy as np
from shapely import LineString, MultiPoint, Point, Polygon, get_coordinates
from shapely.geometry.polygon import orient
from shapely.ops import substring

from cad.hardware import Hardware
from cad.holder.plan import HolderPlan
from cad.parts.beam import Section, bends_per_newton
from cad.parts.bed import joint_blocks, lay
from cad.parts.clip import ABOVE, SCENE, UP, ClipPlan
from cad.parts.fasteners import (
    NUT_FIT_MM,
    OUTSIDE_MM,
    ROOF_IN_SKINS_DEG,
    ROOF_IN_WEBS_DEG,
    Bore,
    Hexagon,
    Stack,
    stack,
    stack_into,
    thread,
)
from cad.parts.prisms import along_x, overlap_mm, roofed, volume_mm3
from cad.seats import Frustum, keep_outs
from optics.layout import Layout
from optics.transforms import transform
from optics.values import FloatArray, InputError

if TYPE_CHECKING:
    from cad.documents.dimension import Hole, Length

# Webs at this angle to the skins: less plastic than at 45 deg, and stiff enough.
WEB_DEG = 36.0
GRAVITY_N_PER_KG = 9.80665
GLASS_G_PER_CM3 = 2.5
# The adapter's screws in the mount's foot: +-x from the middle, and below the slide's plane.
FOOT_X_MM = 24.0
FOOT_Y_MM = (4.5, 15.5)
FOOT_DEPTH_MM = 20.0
# Marks of the scale beside the clip's upper end, 1 mm apart.
MARK_MM = 0.6
# Steps in which wider, deeper and thicker mounts are tried.
WIDER_MM, DEEPER_MM = 8.0, 2.0
THICKER = (1.0, 1.5, 2.0)


@dataclass(frozen=True)
class MountPlan:
    """A mount in rig, mm: convex pieces, what is cut from them, and where it meets the other parts.

    `rig_from_head` (4, 4) is the face on the holder's back (z out of the mount, into the holder), `holes_in_head_mm`
    (4, 2) the screws on it, `head` their stack. `foot` (4, 3) are the adapter's screws in its lower face, `slide`
    (3,) is the middle of the clip's way.
    `tilt_deg` is how far the mirrors turn about any axis, `shift_um` how far they move, when the device is turned so
    that `load_g` at `load_at` (3,) pulls the worst way instead of not at all; `path` (n, 2; y and z) is the middle of
    the truss.
    """

    pieces: tuple[Frustum, ...]
    cuts: tuple[Frustum | Bore | Hexagon, ...]
    light: tuple[Frustum, ...]
    rig_from_head: FloatArray
    holes_in_head_mm: FloatArray
    head: Stack
    foot: FloatArray
    slide: FloatArray
    path: FloatArray
    section: Section
    load_g: float
    load_at: FloatArray
    tilt_deg: float
    shift_um: float
    half_width_mm: float
    bed_turn_deg: float
    bed_cuts_mm: tuple[float, ...]

    @property
    def dimensions(self) -> tuple[Length | Hole, ...]:
        """Holes, and the pattern of the screws in the head, which lies askew."""
        from cad.parts.dimensions import holes, length

        flat = np.column_stack([self.holes_in_head_mm, np.zeros(4)])
        head = transform(self.rig_from_head, flat)
        return (
            *holes(self.cuts),
            length(head[0], head[1], "head"),
            length(head[1], head[2], "head"),
        )


def foot_z_mm(clip: ClipPlan, hardware: Hardware) -> float:
    """The foot's lower face: below the clip's lowest position there is the cable's window, then the foot's plate."""
    return clip.bottom_mm - clip.travel_mm - 1.0 - hardware.mount.cable_window_mm[1] - foot_plate_mm(hardware)


def foot_plate_mm(hardware: Hardware) -> float:
    """Thickness of the foot's plate, which holds the adapter's screws and a tripod nut."""
    return max(
        stack(hardware.mount.skin_mm, hardware).wall_mm, hardware.mount.tripod_height_mm + hardware.mount.web_mm + 0.2
    )


def inner_path(
    holder: HolderPlan, clip: ClipPlan, half_width_mm: float, around_mm: float, hardware: Hardware
) -> FloatArray:
    """The inner line (n, 2) in y and z: from the foot up along the slide, taut round the holder, along its back.

    It goes round the convex hull of holder and pupil, which holds all camera cones.
    """
    away, origin = holder.rig_from_mount[:3, 2], holder.rig_from_mount[:3, 3]
    if abs(away[0]) > np.sin(np.deg2rad(5.0)):
        raise InputError(
            f"mirror holder's back is turned {np.degrees(np.arcsin(abs(away[0]))):.1f} deg to the side, "
            "expected at most 5 deg for the mount"
        )
    across = float(np.linalg.norm(away[1:]))
    out = away[1:] / across
    # The back's plane where it lies nearest to the camera over the mount's width; the rest is cut flush.
    level = float(away @ origin) / across - abs(away[0]) / across * half_width_mm
    up = np.array([out[1], -out[0]])
    corners = holder.corners_in_rig[:, 1:]
    far = 10.0 * np.abs(corners).max()
    behind = Polygon(
        [
            level * out + far * up,
            level * out - far * up,
            level * out - far * up - far * out,
            level * out + far * up - far * out,
        ]
    )
    shadow = (
        MultiPoint(corners).convex_hull.buffer(hardware.mount.clearance_mm, join_style="mitre").intersection(behind)
    )
    holes = transform(holder.rig_from_mount, np.column_stack([holder.holes_in_mount_mm, np.zeros(4)]))[:, 1:]
    top = level * out + (float((holes @ up).max()) + around_mm) * up
    y, foot, slide_top = clip.slide_y_mm, foot_z_mm(clip, hardware), clip.top_mm + clip.travel_mm + 2.0
    hull = MultiPoint([*get_coordinates(shadow), (y, slide_top), (0.0, 0.0), top]).convex_hull
    # Clockwise from the slide (seen with y right, z up) the boundary runs up behind the camera.
    loop = get_coordinates(orient(hull))[-2::-1]
    first = np.abs(loop - [y, slide_top]).sum(axis=1)
    loop = np.roll(loop, -int(first.argmin()), axis=0)
    on_back = np.flatnonzero(np.abs(loop @ out - level) < 1e-6)
    if first.min() > 1e-9 or len(on_back) < 2:
        raise InputError("mirror holder's back does not face away from the camera's clip, expected it to for the mount")
    chain = LineString(np.vstack([loop[: on_back[0] + 1], top])).simplify(0.2)
    return np.vstack([(y, foot), get_coordinates(chain)])


def plan_mount(layout: Layout, holder: HolderPlan, clip: ClipPlan, hardware: Hardware) -> MountPlan:
    """The lightest mount that is stiff enough; raises InputError with the measure that breaks where there is none."""
    mount, screw = hardware.mount, hardware.screw
    around = screw.head_mm / 2.0 + hardware.fit.free_mm + screw.insert_wall_mm
    # The holder's middle need not be the camera's.
    screws = transform(holder.rig_from_mount, np.column_stack([holder.holes_in_mount_mm, np.zeros(4)]))
    least_half = max(
        float(np.abs(screws[:, 0]).max()) + around,
        clip.slide_x_mm + around,
        FOOT_X_MM + around,
    )
    # Plastic goes with the width more than with the depth: the narrowest first.
    widest_half = min(max(least_half, holder.size_mm[0] / 2.0), hardware.printer.bed_mm[2] / 2.0)
    load_g, load_at = _load(layout, holder, hardware)
    best, chosen = np.inf, None
    halves = np.arange(least_half, widest_half + 0.1, WIDER_MM).tolist()
    inners = {half: inner_path(holder, clip, half, around, hardware) for half in halves}
    # Plastic goes with width and thickness: the lightest first. What lies on no bed is taken if nothing else is stiff.
    for thicker, half_width in sorted(product(THICKER, halves), key=lambda pair: (pair[0] * pair[1], pair)):
        skin_mm, web_mm, inner = thicker * mount.skin_mm, thicker * mount.web_mm, inners[half_width]
        for depth in np.arange(FOOT_DEPTH_MM, mount.deepest_mm + 0.1, DEEPER_MM).tolist():
            section = Section(depth, 2.0 * half_width, skin_mm, web_mm, WEB_DEG, hardware.printer.plastic_mpa)
            outer = _offset(inner, depth)
            path = _to_head((inner + outer) / 2.0, holder)
            bends = bends_per_newton(path, load_at, section)
            turn, shift = (bend * load_g / 1000.0 * GRAVITY_N_PER_KG for bend in bends)
            tilt = float(np.degrees(np.linalg.norm(turn, ord=2)))
            best = min(best, tilt)
            if tilt <= mount.tilt_deg:
                laid = lay(inner, outer, hardware)
                if chosen is None or laid.fits:
                    chosen = (section, inner, outer, path, tilt, shift, laid)
                break
        if chosen is not None and chosen[-1].fits:
            break
    if chosen is None:
        raise InputError(
            f"mirrors tilt by {best:.3f} deg under their holder's {load_g:.0f} g on the stiffest mount, "
            f"{2.0 * widest_half:.0f} mm wide and {mount.deepest_mm:g} mm deep, expected at most {mount.tilt_deg:g} deg"
        )
    section, inner, outer, path, tilt, shift, laid = chosen
    half_width, depth = section.width_mm / 2.0, section.depth_mm
    pieces, webs = _truss(inner, outer, section, hardware)
    head = stack_into(mount.skin_mm, holder.thread_mm, holder.hole_depth_mm, holder.hole_depth_mm, screw)
    rig_from_head = holder.rig_from_mount @ np.diag([1.0, -1.0, -1.0, 1.0])
    holes_in_head = holder.holes_in_mount_mm * [1.0, -1.0]
    foot_z, plate = foot_z_mm(clip, hardware), foot_plate_mm(hardware)
    foot = np.array([(x, clip.slide_y_mm - y, foot_z) for x in (-FOOT_X_MM, FOOT_X_MM) for y in FOOT_Y_MM])
    pieces.append(_rib(clip))
    webs += joint_blocks(laid, section.skin_mm, half_width, hardware)
    cuts = _holes(holder, clip, foot, foot_z, plate, inner, depth, half_width, hardware)
    light = tuple(
        volume
        for volumes in keep_outs(layout, hardware)
        for volume in volumes
        if any(overlap_mm(piece, volume) > 0.0 for piece in pieces)
    )
    return MountPlan(
        pieces=(*pieces, *webs),
        cuts=cuts,
        light=light,
        rig_from_head=rig_from_head,
        holes_in_head_mm=holes_in_head,
        head=head,
        foot=foot,
        slide=np.array([0.0, inner[0, 0], clip.slide_z_mm]),
        path=path,
        section=section,
        load_g=load_g,
        load_at=load_at,
        tilt_deg=tilt,
        shift_um=1000.0 * float(np.linalg.norm(shift, ord=2)),
        half_width_mm=half_width,
        bed_turn_deg=laid.turn_deg,
        bed_cuts_mm=() if laid.cut_mm is None else (laid.cut_mm,),
    )


def _load(layout: Layout, holder: HolderPlan, hardware: Hardware) -> tuple[float, FloatArray]:
    """Mass in g of the holder, as if it were solid, and its mirrors, and the middle of it (3,): bounds from above."""
    volume = volume_mm3(holder.slab) + sum(volume_mm3(core) for core in holder.cores)
    sheets = sum(Polygon(m.outline_in_plane_mm).area * m.thickness_mm for m in layout.mirrors)
    mass = (hardware.printer.plastic_g_per_cm3 * volume + GLASS_G_PER_CM3 * sheets) / 1000.0
    return mass, np.asarray(holder.corners_in_rig.mean(axis=0))


def _to_head(path: FloatArray, holder: HolderPlan) -> FloatArray:
    """The path up to the middle of the head: its two rows of screws share the load."""
    line = LineString(path)
    middle = line.project(Point(holder.rig_from_mount[1:3, 3]))
    return get_coordinates(substring(line, 0.0, middle))


def _offset(inner: FloatArray, depth: float) -> FloatArray:
    """A polyline (n, 2) moved to its left by a depth, its corners mitred."""
    directions = np.diff(inner, axis=0) / np.linalg.norm(np.diff(inner, axis=0), axis=1)[:, None]
    lefts = np.column_stack([-directions[:, 1], directions[:, 0]])
    moved = [inner[0] + depth * lefts[0]]
    for point, before, after in zip(inner[1:-1], lefts[:-1], lefts[1:], strict=True):
        moved.append(point + depth * (before + after) / (1.0 + before @ after))
    return np.array([*moved, inner[-1] + depth * lefts[-1]])


def _truss(
    inner: FloatArray, outer: FloatArray, section: Section, hardware: Hardware
) -> tuple[list[Frustum], list[Frustum]]:
    """The skins, and the webs between them with the foot's plate."""
    depth, half_width, web_mm = section.depth_mm, section.width_mm / 2.0, section.web_mm
    part = section.skin_mm / depth
    inside, outside = inner + part / 2.0 * (outer - inner), outer + part / 2.0 * (inner - outer)
    skins, webs = [], []
    for (a, b), (c, d) in zip(pairwise(inner), pairwise(outer), strict=True):
        near = np.array([a, b, b + part * (d - b), a + part * (c - a)])
        far = np.array([c, d, d + part * (b - d), c + part * (a - c)])
        skins += [along_x(near, -half_width, half_width), along_x(far, -half_width, half_width)]
    # Over the foot's plate there is the cable's window, which no web crosses.
    plate, window = foot_plate_mm(hardware), hardware.mount.cable_window_mm[1]
    over = plate + window + web_mm / 2.0
    inside[0], outside[0] = inside[0] + [0.0, over], outside[0] + [0.0, over]
    webs.append(_web(inside[0], outside[0], web_mm, half_width))
    # The last web ends flush with the skins.
    end = (inner[-1] - inner[-2]) / np.linalg.norm(inner[-1] - inner[-2]) * web_mm / 2.0
    inside[-1], outside[-1] = inside[-1] - end, outside[-1] - end
    for (a, b), (c, d) in zip(pairwise(inside), pairwise(outside), strict=True):
        panel = depth / np.tan(np.deg2rad(WEB_DEG))
        count = max(1, round(float(np.linalg.norm((b + d) - (a + c)) / 2.0 / panel)))
        for i in range(count):
            low, high = i / count, (i + 1) / count
            near_to_far = ((a + low * (b - a), c + high * (d - c)), (c + low * (d - c), a + high * (b - a)))
            webs.append(_web(*near_to_far[i % 2], web_mm, half_width))
        webs.append(_web(b, d, web_mm, half_width))
    y, z = inner[0]
    foot = np.array([(y, z), (y - depth, z), (y - depth, z + plate), (y, z + plate)])
    skins.append(along_x(foot, -half_width, half_width))
    return skins, webs


def _rib(clip: ClipPlan) -> Frustum:
    """The V that guides the clip, over all of its way."""
    deep, root = clip.rib_mm, 1.0
    y, low = clip.slide_y_mm, clip.bottom_mm - clip.travel_mm
    corners = np.array([(-deep - root, y - root, low), (deep + root, y - root, low), (0.0, y + deep, low)])
    return Frustum(corners, corners + (clip.top_mm + clip.travel_mm - low) * ABOVE)


def _web(start: FloatArray, end: FloatArray, thickness: float, half_width: float) -> Frustum:
    """A web whose ends lie in the middle of the skins."""
    corners = get_coordinates(LineString([start, end]).buffer(thickness / 2.0, cap_style="flat"))[:-1]
    return along_x(corners, -half_width, half_width)


def _holes(
    holder: HolderPlan,
    clip: ClipPlan,
    foot: FloatArray,
    foot_z: float,
    plate: float,
    inner: FloatArray,
    depth: float,
    half_width: float,
    hardware: Hardware,
) -> tuple[Frustum | Bore | Hexagon, ...]:
    mount, screw = hardware.mount, hardware.screw
    driver = screw.head_mm / 2.0 + hardware.fit.free_mm
    cuts: list[Frustum | Bore | Hexagon] = []
    away = holder.rig_from_mount[:3, 2]
    up = UP - (UP @ away) * away
    up /= np.linalg.norm(up)
    for hole in transform(holder.rig_from_mount, np.column_stack([holder.holes_in_mount_mm, np.zeros(4)])):
        clearance, through = screw.clearance_hole_mm / 2.0, mount.skin_mm + 2.0
        cuts.append(Bore(hole - away, away, clearance, through, up, roof_deg=ROOF_IN_SKINS_DEG))
        cuts.append(Bore(hole + mount.skin_mm * away, away, driver, 2.0 * depth, up, roof_deg=ROOF_IN_WEBS_DEG))
    y = clip.slide_y_mm
    for x in (-clip.slide_x_mm, clip.slide_x_mm):
        mouth, reach = np.array([x, y + 1.0, clip.slide_z_mm]), mount.skin_mm + 2.0
        cuts.append(Bore(mouth, -SCENE, screw.clearance_hole_mm / 2.0, reach, UP, 2.0 * clip.travel_mm, flat=True))
        mouth = np.array([x, y - mount.skin_mm, clip.slide_z_mm])
        cuts.append(Bore(mouth, -SCENE, driver, 2.0 * depth, UP, 2.0 * clip.travel_mm, ROOF_IN_WEBS_DEG))
    for spot in foot:
        cuts += thread(spot, ABOVE, UP, stack(mount.skin_mm, hardware), plate, screw)
    cuts += _cable_and_tripod(y, foot_z + plate, depth, plate, hardware)
    cuts += _scale(clip, half_width)
    if abs(away[0]) > 1e-6:
        cuts.append(_flush(holder, inner[-2:], half_width))
    return tuple(cuts)


def _cable_and_tripod(
    y: float, floor_z: float, depth: float, plate: float, hardware: Hardware
) -> list[Frustum | Bore | Hexagon]:
    """Over the foot's plate a window for the cable, slots for a tie beside it, and a pocket for a tripod's nut."""
    mount = hardware.mount
    width, height = mount.cable_window_mm
    half, middle_z = width / 2.0, floor_z + height / 2.0
    tie_width, tie_height = mount.tie_mm
    window = roofed((-half, half), (floor_z, floor_z + height), (y - depth - 1.0, y + 1.0))
    ties = [
        roofed(
            (x, x + tie_width),
            (middle_z - tie_height / 2.0, middle_z + tie_height / 2.0),
            (y - depth - 1.0, y - depth + max(THICKER) * mount.skin_mm + 1.0),
        )
        for x in (-half - 3.0 - tie_width, half + height / 2.0 + 3.0)
    ]
    middle = np.array([0.0, y - depth / 2.0, floor_z + OUTSIDE_MM])
    nut_depth = mount.tripod_height_mm + NUT_FIT_MM + OUTSIDE_MM
    return [
        window,
        *ties,
        Bore(middle, -ABOVE, mount.tripod_hole_mm / 2.0, plate + 2.0 * OUTSIDE_MM, UP),
        Hexagon(middle, -ABOVE, UP, mount.tripod_flats_mm + NUT_FIT_MM, nut_depth),
    ]


def _scale(clip: ClipPlan, half_width: float) -> list[Frustum]:
    """Marks 1 mm apart, the clip's upper end at the longest when it is at the nominal depth of the pupil.

    They run out at the end that prints last, so that nothing of them overhangs.
    """
    marks = []
    steps = int(clip.travel_mm)
    for step in range(-steps, steps + 1):
        length = 14.0 if step == 0 else 10.0 if abs(step) == steps else 6.0
        z, y = clip.top_mm + step, clip.slide_y_mm
        notch = np.array(
            [(y + OUTSIDE_MM, z - MARK_MM / 2.0), (y + OUTSIDE_MM, z + MARK_MM / 2.0), (y - MARK_MM / 2.0, z)]
        )
        marks.append(along_x(notch, half_width - length, half_width + 1.0))
    return marks


def _flush(holder: HolderPlan, head: FloatArray, half_width: float) -> Frustum:
    """What of the head reaches into the holder, whose back is turned a little to the side."""
    ends: FloatArray = np.column_stack([np.zeros(2), head])
    mount_from_rig = np.asarray(np.linalg.inv(holder.rig_from_mount), dtype=np.float64)
    on_back = transform(mount_from_rig, ends)[:, 1]
    low, high, wide = on_back.min(), on_back.max() + 1.0, half_width + 5.0
    corners = np.array([(-wide, low, 0.0), (wide, low, 0.0), (wide, high, 0.0), (-wide, high, 0.0)])
    base: FloatArray = transform(holder.rig_from_mount, corners)
    away = holder.rig_from_mount[:3, 2]
    return Frustum(base, base - (2.0 * abs(away[0]) * half_width + 1.0) * away)
