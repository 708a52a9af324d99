"""The camera clip: holds a camera's body with its entrance pupil at the origin, and slides along the mount."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from mirrorcam.cad.plan.dimension import Hole, Length
from mirrorcam.cad.plan.fasteners import OUTSIDE_MM, Bore, Hexagon, Stack, stack, thread
from mirrorcam.cad.plan.hardware import Fastening, Hardware
from mirrorcam.cad.plan.hole_dimensions import holes, length
from mirrorcam.cad.plan.prisms import along_y, box
from mirrorcam.cad.plan.seats import Frustum
from mirrorcam.optics.base.values import FloatArray, InputError
from mirrorcam.optics.geometry.camera_body import BoardHoles, CameraBody, Lips

UP = np.array([1.0, 0.0, 0.0])
SCENE = np.array([0.0, 1.0, 0.0])
ABOVE = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True)
class BodyBox:
    """A camera's body in rig, mm: a box from `low` (3,) to `high` (3,), its front at the right depth of the pupil."""

    low: FloatArray
    high: FloatArray

    @property
    def solid(self) -> Frustum:
        return box(tuple(self.low), tuple(self.high))


def body_box(camera: CameraBody) -> BodyBox:
    """The camera's body with its entrance pupil at the origin."""
    low, high = camera.box_mm
    return BodyBox(np.array(low), np.array(high))


@dataclass(frozen=True)
class ClipPlan:
    """A camera clip in rig, mm: convex pieces, what is cut from them, and where it slides.

    It stands at the nominal depth of the pupil, its wall (towards -y) against the mount at y = `slide_y_mm`; the two
    slide screws are at x = +-`slide_x_mm`, z = `slide_z_mm`, and it moves by up to `travel_mm` either way along z. A
    rib of the mount, of 45 deg and `rib_mm` high, runs in its groove. Below `bottom_mm` and above `top_mm` there is
    none of it. `set_screw_tips` (n, 3) are where set screws press on the body's back, `board_screws` (n, 3) where the
    heads of a board's own screws rest.
    """

    pieces: tuple[Frustum, ...]
    cuts: tuple[Frustum | Bore | Hexagon, ...]
    slide: Stack
    slide_x_mm: float
    slide_y_mm: float
    slide_z_mm: float
    travel_mm: float
    rib_mm: float
    from_x_mm: float
    bottom_mm: float
    top_mm: float
    set_screw_tips: FloatArray
    board_screws: FloatArray

    @property
    def dimensions(self) -> tuple[Length | Hole, ...]:
        """The holes, of the slide screws and of what holds the camera, and the channel that the body is slid into."""
        return (*holes(self.cuts), *(self._channel_lengths() if len(self.set_screw_tips) else ()))

    def _channel_lengths(self) -> Iterator[Length]:
        """Of the channel, its lips and the cable's slot; the pieces are in the order of `_channel_walls`."""
        _, end, lip, other_lip, wall, _, floor = self.pieces[:7]
        lows, highs = (
            [extreme(np.vstack([piece.base, piece.top]), axis=0) for piece in (end, lip, wall, floor, other_lip)]
            for extreme in (np.min, np.max)
        )
        low_y, front, top = lows[1][1], lows[1][2], highs[1][2]
        begins, opens, floor_z = highs[0][0], highs[1][0], highs[3][2]
        corner = np.array([opens, low_y, floor_z])
        yield length(corner, np.array([opens, lows[2][1], floor_z]), "channel")
        yield length(corner, np.array([opens, low_y, front]), "channel")
        yield length(np.array([opens, lows[4][1], top]), np.array([opens, lows[2][1], top]), "lip")
        yield length(np.array([opens, low_y, front]), np.array([opens, low_y, top]), "lip")
        yield length(np.array([self.from_x_mm, low_y, front]), np.array([begins, low_y, front]), "end wall")
        yield length(np.array([opens, highs[3][1], floor_z]), np.array([opens, lows[2][1], floor_z]), "slot")


def plan_clip(hardware: Hardware) -> ClipPlan:
    """Lay out the clip of a camera; raises InputError with the measure that breaks where it cannot be made."""
    camera, clip = hardware.camera, hardware.clip
    body = body_box(camera)
    slide = stack(hardware.mount.skin_mm, hardware)
    slide_x = _slide_x_mm(hardware)
    reach = slide_x + hardware.screw.insert_hole_mm / 2.0 + hardware.screw.insert_wall_mm
    held = camera.held_by
    from_x = min(float(body.low[0]) - clip.wall_mm, -reach)
    if isinstance(held, BoardHoles):
        # The part stands on this end: no post's slope begins before it.
        from_x = min(from_x, min(x for x, _ in held.holes_mm) - _post_radius_mm(held) - held.post_mm)
    to_x = max(float(body.high[0]), reach)
    pieces, cuts, bottom, top, set_screws, board_screws = (
        _by_lips(camera, held, body, from_x, to_x, hardware)
        if isinstance(held, Lips)
        else _by_board(camera, held, body, from_x, to_x, hardware)
    )
    # The wall that slides: the body's side is its datum.
    inner_y = float(body.low[1]) - (0.0 if isinstance(held, Lips) else hardware.fit.slide_mm)
    outer_y = inner_y - slide.wall_mm
    top = max(top, bottom + 2.0 * (hardware.screw.insert_hole_mm + hardware.screw.insert_wall_mm))
    pieces = [box((from_x, outer_y, bottom), (to_x, inner_y, top)), *pieces]
    slide_z = (bottom + top) / 2.0
    for side in (-1.0, 1.0):
        mouth = np.array([side * slide_x, outer_y, slide_z])
        cuts += thread(mouth, SCENE, UP, slide, slide.wall_mm, hardware.screw)
    deep = clip.rib_mm + hardware.fit.slide_mm
    groove = np.array(
        [[-deep - OUTSIDE_MM, outer_y - OUTSIDE_MM], [deep + OUTSIDE_MM, outer_y - OUTSIDE_MM], [0.0, outer_y + deep]]
    )
    base = np.column_stack([groove, np.full(3, bottom - 1.0)])
    cuts.append(Frustum(base, base + (top - bottom + 2.0) * ABOVE))
    return ClipPlan(
        pieces=tuple(pieces),
        cuts=tuple(cuts),
        slide=slide,
        slide_x_mm=slide_x,
        slide_y_mm=outer_y,
        slide_z_mm=slide_z,
        travel_mm=clip.travel_mm,
        rib_mm=clip.rib_mm,
        from_x_mm=from_x,
        bottom_mm=bottom,
        top_mm=top,
        set_screw_tips=set_screws,
        board_screws=board_screws,
    )


def _slide_x_mm(hardware: Hardware) -> float:
    """Distance of the slide screws from the middle, in whole mm: no post stands before the pocket of a nut."""
    least, screw, held = hardware.clip.screws_apart_mm / 2.0, hardware.screw, hardware.camera.held_by
    if screw.kind == "insert" or isinstance(held, Lips):
        return least
    nut = screw.nut_flats_mm / np.sqrt(3.0) + hardware.fit.free_mm
    posts = max(abs(x) for x, _ in held.holes_mm) + _post_radius_mm(held) + held.post_mm
    return max(least, float(np.ceil(posts + nut)))


Held = tuple[list[Frustum], list[Frustum | Bore | Hexagon], float, float, FloatArray, FloatArray]


def _by_lips(camera: CameraBody, lips: Lips, body: BodyBox, from_x: float, to_x: float, hardware: Hardware) -> Held:
    """A channel that the body is slid into from +x; set screws in its floor press the body against the lips."""
    screw = hardware.screw
    # An insert in the floor is pressed in from the body's side: the set screw pushes it against a shoulder.
    holds = screw.insert_mm + 0.3 if screw.kind == "insert" else screw.nut_height_mm + 0.2
    channel = _channel(camera, lips, body, to_x, holds, hardware)
    low_y, high_y, cable = float(body.low[1]), float(body.high[1]), channel.cable_mm
    around = screw.insert_hole_mm / 2.0 + screw.insert_wall_mm
    if (width := -cable - low_y) < 2.0 * around:
        raise InputError(f"camera clip's floor beside the cable is {width:.1f} mm wide, expected {2.0 * around:g} mm")
    third = camera.width_mm / 3.0
    middle_x = float(body.low[0] + body.high[0]) / 2.0
    below, above = (low_y - cable) / 2.0, (high_y + cable) / 2.0
    spots = np.array([(middle_x - third, below), (middle_x + third, below), (middle_x - third, above)])
    set_screws = np.column_stack([spots, np.full(3, float(body.low[2]))])
    pieces = _channel_walls(camera, lips, body, from_x, to_x, channel)
    cuts = list(_set_screw_cuts(spots, channel.floor_mm, holds, screw))
    return pieces, cuts, channel.bottom_mm, channel.top_mm, set_screws, np.zeros((0, 3))


@dataclass(frozen=True)
class _Channel:
    """Numbers of a channel in rig, mm.

    Along z: the bottom and the top of its floor, the body's front, the top of its lips. Along y: the inner and the
    outer side of its wall towards the scene, and half the width of the cable's slot. At the hinge, from `hinge_from_mm`
    along x on, that wall begins at `hinge_top_mm`.
    """

    bottom_mm: float
    floor_mm: float
    front_mm: float
    top_mm: float
    inner_mm: float
    outer_mm: float
    cable_mm: float
    hinge_from_mm: float
    hinge_top_mm: float


def _channel(
    camera: CameraBody, lips: Lips, body: BodyBox, to_x: float, holds_mm: float, hardware: Hardware
) -> _Channel:
    """Lay out a channel whose floor holds inserts or nuts `holds_mm` deep; raises InputError where the body forbids."""
    clip, fit = hardware.clip, hardware.fit
    if (clear := camera.height_mm / 2.0 - abs(camera.lens_y_mm) - lips.lip_mm - camera.lens_ring_mm / 2.0) < 0.0:
        raise InputError(
            f"camera clip's lips reach {-clear:.1f} mm over the lens ring ({camera.lens_ring_mm:g} mm across), "
            f"expected them beside it: lip_mm at most {lips.lip_mm + clear:.1f}"
        )
    back, front = float(body.low[2]), float(body.high[2])
    floor = back - clip.behind_mm
    bottom = floor - holds_mm - hardware.printer.wall_mm * 1.5
    hinge_from, hinge_top = to_x, bottom
    if camera.hinge_mm:
        # Off the end wall all material is in reach of the bed: the hinge and the cable slide in from the open end.
        hinge_from = -camera.hinge_mm / 2.0 - fit.free_mm
        hinge_top = back + camera.hinge_from_back_mm + fit.free_mm
        if (patch := hinge_from - float(body.low[0])) < 10.0:
            raise InputError(f"camera clip holds {patch:.1f} mm of the body beside its hinge, expected at least 10 mm")
        if front - hinge_top < 2.0 * clip.wall_mm:
            raise InputError(
                f"camera clip's wall over the hinge is {front - hinge_top:.1f} mm, expected {2.0 * clip.wall_mm:g} mm"
            )
    inner = float(body.high[1]) + 2.0 * fit.slide_mm
    cable = camera.cable_mm / 2.0 + fit.free_mm
    top, outer = front + clip.wall_mm, inner + clip.wall_mm
    return _Channel(bottom, floor, front, top, inner, outer, cable, hinge_from, hinge_top)


def _channel_walls(
    camera: CameraBody, lips: Lips, body: BodyBox, from_x: float, to_x: float, channel: _Channel
) -> list[Frustum]:
    """The end wall, both lips, the wall towards the scene, and the floor on both sides of the cable."""
    low_x, low_y, high_y = float(body.low[0]), float(body.low[1]), float(body.high[1])
    bottom, floor, front, top = channel.bottom_mm, channel.floor_mm, channel.front_mm, channel.top_mm
    inner, outer, hinge_from = channel.inner_mm, channel.outer_mm, channel.hinge_from_mm
    cable_from = camera.cable_x_mm - channel.cable_mm
    pieces = [
        box((from_x, low_y, bottom), (low_x, outer, top)),
        box((from_x, low_y, front), (to_x, low_y + lips.lip_mm, top)),
        box((from_x, high_y - lips.lip_mm, front), (to_x, outer, top)),
        box((from_x, inner, bottom), (hinge_from, outer, top)),
        box((from_x, low_y, bottom), (cable_from, outer if hinge_from >= cable_from else inner, floor)),
        box((from_x, low_y, bottom), (to_x, -channel.cable_mm, floor)),
    ]
    if hinge_from < to_x:
        pieces.append(box((from_x, inner, channel.hinge_top_mm), (to_x, outer, top)))
    return pieces


def _set_screw_cuts(
    spots: FloatArray, floor_mm: float, holds_mm: float, screw: Fastening
) -> Iterator[Frustum | Bore | Hexagon]:
    """Holes through the floor at spots (n, 2), and space for their inserts or nuts."""
    deep = holds_mm + OUTSIDE_MM
    for spot in spots:
        mouth = np.array([*spot, floor_mm]) + OUTSIDE_MM * ABOVE
        yield Bore(mouth, -ABOVE, screw.clearance_hole_mm / 2.0, 99.0, UP)
        if screw.kind == "insert":
            yield Bore(mouth, -ABOVE, screw.insert_hole_mm / 2.0, deep, UP)
        else:
            yield Hexagon(mouth, -ABOVE, UP, screw.nut_flats_mm + 0.2, deep)


def _by_board(
    camera: CameraBody, holes: BoardHoles, body: BodyBox, from_x: float, to_x: float, hardware: Hardware
) -> Held:
    """Posts on a floor behind the board; each stands on a slope of 45 deg, since it lies when printed."""
    clip = hardware.clip
    back = float(body.low[2])
    floor_top = back - holes.post_mm
    bottom = floor_top - clip.wall_mm
    radius = _post_radius_mm(holes)
    low_y = float(body.low[1]) - hardware.fit.slide_mm
    high_y = max(float(body.high[1]), float(np.array(holes.holes_mm)[:, 1].max()) + radius)
    pieces = [box((from_x, low_y, bottom), (to_x, high_y, floor_top))]
    cuts: list[Frustum | Bore | Hexagon] = []
    centres = np.array(holes.holes_mm)
    # A thread-forming screw cuts its thread into a hole of about 0.8 of its diameter.
    pilot = 0.4 * holes.screw_mm
    for x, y in centres:
        profile = np.array(
            [[x + radius, floor_top], [x + radius, back], [x - radius, back], [x - radius - holes.post_mm, floor_top]]
        )
        pieces.append(along_y(profile, y - radius, y + radius))
        mouth = np.array([x, y, back])
        cuts.append(Bore(mouth + OUTSIDE_MM * ABOVE, -ABOVE, pilot, holes.post_mm + OUTSIDE_MM, UP))
    cable = camera.cable_mm / 2.0 + hardware.fit.free_mm
    cuts.append(
        Bore(np.array([camera.cable_x_mm, 0.0, floor_top + 1.0]), -ABOVE, max(cable, 4.0), clip.wall_mm + 2.0, UP)
    )
    board_screws = np.column_stack([centres, np.full(len(centres), back + camera.depth_mm)])
    return pieces, cuts, bottom, float(body.high[2]), np.zeros((0, 3)), board_screws


def _post_radius_mm(holes: BoardHoles) -> float:
    return holes.hole_mm / 2.0 + 2.0
