"""The camera clip, which holds a camera with its entrance pupil at the origin and slides along the mount.

A body is in a tray (`body_clip`), or in a corner, held by ties or by its own threads (`corner_clip`). A bare board is
fastened to posts behind it by thread-forming screws.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from mirrorcam.cad.parts.body_clip import FILLET_MM, hold_body, leaf_lengths
from mirrorcam.cad.parts.camera_box import ABOVE, SCENE, UP, CameraScrew, Cradle, Nest, body_box, tie_height_mm
from mirrorcam.cad.parts.corner_clip import hold_by_straps, hold_by_threads
from mirrorcam.cad.parts.ties import tie_slot_mm, tie_slots
from mirrorcam.cad.plan.dimension import Hole, Length, holes, length
from mirrorcam.cad.plan.fasteners import (
    NUT_FIT_MM,
    OUTSIDE_MM,
    Bore,
    Countersink,
    Hexagon,
    Stack,
    head_space_mm,
    stack,
    thread,
)
from mirrorcam.cad.plan.hardware import Hardware
from mirrorcam.cad.plan.part_plan import FORMING
from mirrorcam.cad.plan.prisms import box, corners_of, prism_along_x, prism_along_z
from mirrorcam.cad.plan.seats import Frustum
from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.camera_body import BoardHoles, CameraBody, Lips, Threads

# Minimum radius of the hole for the cable: a four-pin plug passes through.
PLUG_RADIUS_MM = 4.0
# The barrel of a heavy lens rests on two faces at this angle to the clip's wall, and between these distances from the
# centre: within them is a gap for protrusions of the barrel, and outside them are the screws of the board.
REST_DEG = 35.0
REST_FROM_MM, REST_TO_MM = 6.0, 12.4
# Step of the search for the height of the slide's screws.
ROW_STEP_MM = 0.25
# Clearance of a ribbon, which bends, on both sides in its slot.
RIBBON_FREE_MM = 1.0


def hold_board(camera: CameraBody, holes: BoardHoles, hardware: Hardware) -> Cradle:
    """Lay out posts on a floor behind the board, each on a slope of 45 deg, since the clip is printed on its slide."""
    clip, body = hardware.clip, body_box(camera)
    back = float(body.low[2])
    floor_top = back - holes.post_mm
    bottom = floor_top - clip.wall_mm
    radius = _post_radius_mm(holes)
    centres = np.array(holes.holes_mm)
    low_y = float(body.low[1]) - hardware.fit.slide_mm
    high_y = max(float(body.high[1]), float(centres[:, 1].max()) + radius)
    low_x = min(float(body.low[0]), float(centres[:, 0].min()) - radius)
    high_x = max(float(body.high[0]), float(centres[:, 0].max()) + radius)
    pieces = [box((low_x, low_y - 0.5, bottom), (high_x, high_y, floor_top))]
    cuts: list[Frustum | Bore | Hexagon] = []
    # A thread-forming screw cuts its thread into a hole of about 0.8 of its diameter.
    pilot_radius = 0.4 * holes.screw_mm
    for x, y in centres:
        # The slope ends in the wall.
        slope = min(holes.post_mm, y - radius - (low_y - 0.5))
        foot = [(y - radius, floor_top)]
        if slope > 0.0:
            foot = [(y - radius - slope, back - slope), (y - radius - slope, floor_top)][: 1 + (slope < holes.post_mm)]
        profile = [(y + radius, floor_top), (y + radius, back), (y - radius, back), *foot]
        pieces.append(prism_along_x(np.array(profile), x - radius, x + radius))
        mouth = np.array([x, y, back])
        cuts.append(Bore(mouth + OUTSIDE_MM * ABOVE, -ABOVE, pilot_radius, holes.post_mm + OUTSIDE_MM, SCENE))
    if camera.rest_mm is not None:
        pieces += _rest(camera, holes.play_mm / 2.0, low_y - 0.5)
    floor = (float(low_y), high_y)
    cuts.append(
        _cable_hole(camera, (camera.cable_x_mm, float(body.centre[1]) + camera.cable_y_mm), floor_top, floor, hardware)
    )
    return Cradle(
        pieces=tuple(pieces),
        cuts=tuple(cuts),
        inner_y_mm=low_y,
        x_mm=(low_x, high_x),
        z_mm=(
            bottom - tie_height_mm(hardware),
            float(body.high[2]) + (camera.rest_mm[1] if camera.rest_mm is not None else 0.0),
        ),
        screws=tuple(
            CameraScrew(
                np.array([x, y, back + camera.depth_mm]), ABOVE, f"M{holes.screw_mm:g}{FORMING}", holes.screw_length_mm
            )
            for x, y in centres
        ),
    )


def _rest(camera: CameraBody, gap_mm: float, wall_y: float) -> list[Frustum]:
    """Two wedges on the wall, with faces at a distance `gap_mm` from the nominal barrel.

    The gap is less than the play of the board's holes, so a tie draws the barrel onto both faces.
    """
    if camera.rest_mm is None:
        return []
    z = [camera.pupil_behind_front_mm + height for height in camera.rest_mm]
    angle, offset = np.deg2rad(REST_DEG), camera.lens_ring_mm / 2.0 + gap_mm

    def face_y(x: float) -> float:
        return float((x * np.sin(angle) - offset) / np.cos(angle))

    if (inner_y := face_y(REST_FROM_MM)) <= wall_y:
        raise InputError(
            f"camera clip's rest for the lens would start {wall_y - inner_y:.1f} mm inside the clip's wall, "
            f"expected a barrel narrower than {camera.lens_ring_mm:g} mm, or no rest_mm"
        )
    profile = np.array(
        [(REST_FROM_MM, wall_y), (REST_TO_MM, wall_y), (REST_TO_MM, face_y(REST_TO_MM)), (REST_FROM_MM, inner_y)]
    )
    return [prism_along_z(profile * (side, 1.0), z[0], z[1]) for side in (-1.0, 1.0)]


def _post_radius_mm(holes: BoardHoles) -> float:
    """Half the width of a square post."""
    return holes.hole_mm / 2.0 + 2.0


def _cable_hole(
    camera: CameraBody, centre: tuple[float, float], top: float, floor_y: tuple[float, float], hardware: Hardware
) -> Frustum | Bore:
    """The hole in the floor for a cable at (x, y): round for a plug; for a ribbon, a slot, open if near the edge."""
    free, wall = hardware.fit.free_mm, hardware.clip.wall_mm
    if not camera.cable_thick_mm:
        radius = max(camera.cable_mm / 2.0 + free, PLUG_RADIUS_MM)
        return Bore(np.array([*centre, top + 1.0]), -ABOVE, radius, wall + 2.0, SCENE)
    half_x, half_y = camera.cable_mm / 2.0 + free, camera.cable_thick_mm / 2.0 + RIBBON_FREE_MM
    max_y = centre[1] + half_y
    if max_y > floor_y[1] - wall:
        max_y = floor_y[1] + 1.0
    return box((centre[0] - half_x, centre[1] - half_y, top - wall - 1.0), (centre[0] + half_x, max_y, top + 1.0))


@dataclass(frozen=True)
class ClipPlan:
    """A camera clip in the rig frame, mm, at the nominal depth of the pupil: convex pieces, cuts, and its slide.

    Its wall, `pieces[0]`, faces -y and lies against the mount at y = `slide_y_mm`. The slide's screws are at x =
    +-`slide_x_mm` and each z of `slide_z_mm`, in ascending order; the clip moves by up to `travel_mm` in either
    direction along z, guided in its groove by a V rib of the mount, `rib_mm` high. The clip extends from `bottom_mm` to
    `top_mm`. A body rests in a `nest`, held by its sprung screws, by `screws` in its threads, or by ties through
    `straps_mm` (n, 3; x of both slots, and z); a board is held by `screws`. `tie_mm` are the x coordinates of the two
    slots for the cable's tie, and the z coordinate of their centres.
    """

    pieces: tuple[Frustum, ...]
    cuts: tuple[Frustum | Bore | Countersink | Hexagon, ...]
    slide: Stack
    slide_x_mm: float
    slide_y_mm: float
    slide_z_mm: tuple[float, ...]
    travel_mm: float
    rib_mm: float
    bottom_mm: float
    top_mm: float
    nest: Nest | None
    screws: tuple[CameraScrew, ...]
    straps_mm: FloatArray
    tie_mm: tuple[float, float, float]

    @property
    def tray(self) -> Nest | None:
        """The nest with sprung screws of a body in a tray; None for a corner or a board."""
        return self.nest if self.nest is not None and self.nest.screws else None

    @property
    def slide_points(self) -> FloatArray:
        """Points (n, 3) in the rig frame where the slide's screws cross from the mount into the clip."""
        sides = (-self.slide_x_mm, self.slide_x_mm)
        return np.array([(x, self.slide_y_mm, z) for z in self.slide_z_mm for x in sides])

    @property
    def slide_centre(self) -> FloatArray:
        """The centre (3,) of `slide_points`."""
        return np.asarray(self.slide_points.mean(axis=0))

    @property
    def dimensions(self) -> tuple[Length | Hole, ...]:
        """The holes, the thickness of the wall, the leaves, and the positions of the nest's six points.

        The points are dimensioned from the lower end, the side, and the face on the mount.
        """
        low, high = (corners_of(self.pieces[:1]).min(axis=0), corners_of(self.pieces[:1]).max(axis=0))
        wall = length(low, low + (high - low) * SCENE, "wall")
        screws = self.nest.screws if self.nest is not None else ()
        leaves = (each for screw in screws for each in leaf_lengths(screw, float(high[1])))
        return (*holes(self.cuts), wall, *leaves, *self._corner_walls(), *self._nest_lengths())

    def _corner_walls(self) -> tuple[Length, ...]:
        """Thicknesses of the fence and the stop of a corner."""
        if self.nest is None or self.nest.screws:
            return ()
        walls = []
        for point, normal in zip(self.nest.points[[3, 5]], self.nest.normals[[3, 5]], strict=True):
            wall = next(piece for piece in self.pieces if piece.contains(point - 0.1 * normal))
            thickness = float(((point - corners_of([wall])) @ normal).max())
            walls.append(length(point - thickness * normal, point, "wall"))
        return tuple(walls)

    def _nest_lengths(self) -> tuple[Length, ...]:
        """The coordinates of the nest's points along each axis, as lengths; equal coordinates share one."""
        if self.nest is None:
            return ()
        corners = corners_of(self.pieces)
        low = np.array([corners[:, 0].min(), self.slide_y_mm, self.bottom_mm])
        lengths: dict[tuple[int, float], Length] = {}
        for kind, points in (("pad", self.nest.points[:3]), ("stop", self.nest.points[3:])):
            for point in points:
                for axis in range(3):
                    key = (axis, round(float(point[axis]), 3))
                    if key not in lengths:
                        lengths[key] = length(np.where(np.arange(3) == axis, low, point), point, kind)
        return tuple(lengths.values())


def plan_clip(hardware: Hardware) -> ClipPlan:
    """Lay out the clip of a camera; raises InputError with the dimension if it cannot be made."""
    camera, clip, screw = hardware.camera, hardware.clip, hardware.screw
    slide = stack(hardware.mount.slide_skin_mm, hardware)
    boss = _boss_radius_mm(hardware)
    held_by = camera.held_by
    if isinstance(held_by, BoardHoles):
        cradle = hold_board(camera, held_by, hardware)
    elif isinstance(held_by, Threads):
        cradle = hold_by_threads(camera, held_by, slide.wall_mm, hardware)
    else:
        cradle = _hold_by_lips(camera, held_by, boss, hardware)
    slide_x = _slide_x_mm(cradle, hardware)
    half_width = slide_x + boss
    bottom, top = cradle.z_mm
    top = max(top, bottom + 2.0 * (screw.insert_hole_mm + screw.insert_wall_mm))
    if cradle.nest is not None:
        # A body is heavy, so the wall extends below it as far as two rows of screws need.
        bottom = min(bottom, top - 2.0 * boss - _min_row_spacing_mm(hardware))
    outer_y = cradle.inner_y_mm - slide.wall_mm
    low_x, high_x = min(cradle.x_mm[0], -half_width), max(cradle.x_mm[1], half_width)
    wall = box((low_x, outer_y, bottom), (high_x, cradle.inner_y_mm, top))
    slide_z = _slide_z_mm(cradle, (bottom + boss, top - boss), slide_x, hardware)
    cuts = list(cradle.cuts)
    for mouth in np.array([(x, outer_y, z) for z in slide_z for x in (-slide_x, slide_x)]):
        # The clip is printed on this face, so round holes need no roof.
        threaded = thread(mouth, SCENE, UP, slide, slide.wall_mm, screw)
        cuts += [replace(cut, up=None) if isinstance(cut, Bore) else cut for cut in threaded]
        if screw.kind == "nut":
            # The nut enters from the scene, past the fillet of a leaf beside its pocket.
            half_z = (screw.nut_flats_mm + NUT_FIT_MM) / 2.0
            half_x, inner = half_z * 2.0 / np.sqrt(3.0), cradle.inner_y_mm
            x, _, z = mouth
            cuts.append(box((x - half_x, inner, z - half_z), (x + half_x, inner + FILLET_MM, z + half_z)))
    depth = clip.rib_mm + hardware.fit.slide_mm
    groove = np.array(
        [
            [-depth - OUTSIDE_MM, outer_y - OUTSIDE_MM],
            [depth + OUTSIDE_MM, outer_y - OUTSIDE_MM],
            [0.0, outer_y + depth],
        ]
    )
    base = np.column_stack([groove, np.full(3, bottom - 1.0)])
    cuts.append(Frustum(base, base + (top - bottom + 2.0) * ABOVE))
    for left, right, z in cradle.straps_mm:
        cuts += tie_slots(left, right, z, (outer_y, cradle.inner_y_mm), hardware)
    tie_cuts, tie = _tie(cradle, outer_y, bottom, slide_x - boss, hardware)
    return ClipPlan(
        pieces=(wall, *cradle.pieces),
        cuts=(*cuts, *tie_cuts, *_lens_tie(cradle, outer_y, hardware)),
        slide=slide,
        slide_x_mm=slide_x,
        slide_y_mm=outer_y,
        slide_z_mm=slide_z,
        travel_mm=clip.travel_mm,
        rib_mm=clip.rib_mm,
        bottom_mm=bottom,
        top_mm=top,
        nest=cradle.nest,
        screws=cradle.screws,
        straps_mm=cradle.straps_mm,
        tie_mm=tie,
    )


def _hold_by_lips(camera: CameraBody, lips: Lips, boss_radius_mm: float, hardware: Hardware) -> Cradle:
    """A tray with sprung screws, else ties round the body; raises InputError if neither holds it."""
    try:
        return hold_body(camera, lips, boss_radius_mm, hardware)
    except InputError as tray:
        try:
            return hold_by_straps(camera, hardware)
        except InputError as straps:
            raise InputError(f"{tray}; {straps}") from None


def _boss_radius_mm(hardware: Hardware) -> float:
    """Outer radius of the material round an insert or a nut."""
    screw = hardware.screw
    radius = screw.insert_hole_mm / 2.0 if screw.kind == "insert" else screw.nut_flats_mm / np.sqrt(3.0)
    return float(radius) + screw.insert_wall_mm


def _slide_x_mm(cradle: Cradle, hardware: Hardware) -> float:
    """Distance of the slide's screws from x = 0; nuts enter outside a board's floor, at a whole number of mm."""
    nominal, screw = hardware.clip.screws_apart_mm / 2.0, hardware.screw
    # The screws are outside the slots of ties round the body that would meet their bosses.
    room = _boss_radius_mm(hardware) + hardware.printer.wall_mm + tie_slot_mm(hardware)[1]
    for slot_x in np.sort(np.abs(cradle.straps_mm[:, :2]).ravel()):
        if abs(slot_x - nominal) < room:
            nominal = float(slot_x) + room
    if screw.kind == "insert" or cradle.nest is not None:
        return nominal
    nut_clearance = screw.nut_flats_mm / np.sqrt(3.0) + hardware.fit.free_mm
    return max(nominal, float(np.ceil(max(np.abs(cradle.x_mm)) + nut_clearance)))


def _slide_z_mm(
    cradle: Cradle, ends_mm: tuple[float, float], slide_x_mm: float, hardware: Hardware
) -> tuple[float, ...]:
    """z of the slide's screws, between `ends_mm`: two rows, so that the camera's weight does not bend the skin.

    They are symmetric about the pads at a body's sides, as far as the wall and the hollows of ties round the body
    allow. A wall too low for the screwdriver holes of two rows has one row, halfway between its ends or at these pads.
    """
    low, high = ends_mm
    centre = (low + high) / 2.0 if cradle.nest is None else float(cradle.nest.points[5, 2])
    closest = _min_row_spacing_mm(hardware)
    half_spacing = min(max(hardware.clip.screws_above_mm, closest), high - low) / 2.0
    if 2.0 * half_spacing < closest - 1e-9:
        return (centre,)
    centres = np.arange(low + half_spacing, high - half_spacing + 1e-9, ROW_STEP_MM)
    centres = np.array([min(max(centre, low + half_spacing), high - half_spacing), *centres])
    rows = centres[:, None] + [-half_spacing, half_spacing]
    # A screw through the hollow of a tie would cut it.
    crossing = [z for left, right, z in cradle.straps_mm if left < slide_x_mm < right or left < -slide_x_mm < right]
    room = tie_slot_mm(hardware)[0] + hardware.screw.insert_hole_mm / 2.0 + hardware.printer.wall_mm
    clear = (np.abs(rows[:, :, None] - crossing) >= room - 1e-9).all(axis=(1, 2))
    if not clear.any():
        raise InputError(
            "camera clip's ties round the body cross the screws of its slide, which are "
            f'{2.0 * slide_x_mm:g} mm apart: give the body\'s threads (held_by.kind = "threads"), or screws_apart_mm '
            "under [clip] of at least "
            f"{2.0 * (float(np.abs(cradle.straps_mm[:, :2]).max()) + room):.0f}"
        )
    below, above = rows[clear][np.abs(centres[clear] - centre).argmin()]
    return (float(below), float(above))


def _min_row_spacing_mm(hardware: Hardware) -> float:
    """Minimum distance between the rows of the slide's screws: a wall separates their screwdriver holes."""
    return 2.0 * (hardware.clip.travel_mm + head_space_mm(hardware)) + hardware.printer.wall_mm


def _tie(
    cradle: Cradle, outer_y: float, bottom: float, max_x_mm: float, hardware: Hardware
) -> tuple[list[Frustum], tuple[float, float, float]]:
    """Two slots through the wall below the camera, for a tie as strain relief of its cable.

    Between them the tie lies in a hollow of the wall's outer face, clear of the mount's rib. Raises InputError if the
    cable is too far from x = 0.
    """
    camera, fit = hardware.camera, hardware.fit
    half_z, half_x = tie_slot_mm(hardware)
    z = bottom + hardware.printer.wall_mm + half_z
    offset = max(camera.cable_mm / 2.0, hardware.clip.rib_mm + 2.0 * fit.slide_mm) + half_x
    left, right = camera.cable_x_mm - offset, camera.cable_x_mm + offset
    if (excess := max(-left, right) + half_x - max_x_mm) > 0.0:
        raise InputError(
            f"camera clip's slot for the cable's tie is {excess:.1f} mm beyond the screws of its slide, "
            f"expected the cable nearer to the centre"
        )
    return tie_slots(left, right, z, (outer_y, cradle.inner_y_mm), hardware), (left, right, z)


def _lens_tie(cradle: Cradle, outer_y: float, hardware: Hardware) -> list[Frustum]:
    """The slots for a tie round a lens that rests on the clip, outside the faces of its rest; [] without a rest."""
    camera = hardware.camera
    if camera.rest_mm is None:
        return []
    z = camera.pupil_behind_front_mm + sum(camera.rest_mm) / 2.0
    offset = REST_TO_MM + hardware.printer.wall_mm / 2.0 + tie_slot_mm(hardware)[1]
    return tie_slots(-offset, offset, z, (outer_y, cradle.inner_y_mm), hardware)
