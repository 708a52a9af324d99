"""The clip's holding of a bare board: posts behind it, whose screws cut their own threads."""

from __future__ import annotations

import numpy as np

from mirrorcam.cad.parts.camera_box import ABOVE, SCENE, Held, body_box, tie_height_mm
from mirrorcam.cad.plan.fasteners import OUTSIDE_MM, Bore, Hexagon
from mirrorcam.cad.plan.hardware import Hardware
from mirrorcam.cad.plan.prisms import along_x, along_z, box
from mirrorcam.cad.plan.seats import Frustum
from mirrorcam.core.values import InputError
from mirrorcam.optics.geometry.camera_body import BoardHoles, CameraBody

# The least radius of the hole for the cable: a plug of four pins passes.
PLUG_RADIUS_MM = 4.0
# The two faces on which a heavy lens's barrel rests look at its axis at this angle to the clip's wall on either side:
# between them is a gap for what stands out of the barrel, and beside them the screws of the board.
REST_DEG = 35.0
REST_FROM_MM, REST_TO_MM = 6.0, 12.4
# A ribbon bends: its slot is wider than it is thick, on both sides.
RIBBON_FREE_MM = 1.0


def hold_board(camera: CameraBody, holes: BoardHoles, hardware: Hardware) -> Held:
    """Posts on a floor behind the board; each stands on a slope of 45 deg, since the clip prints on its slide."""
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
    pilot = 0.4 * holes.screw_mm
    for x, y in centres:
        # The slope ends in the wall.
        slope = min(holes.post_mm, y - radius - (low_y - 0.5))
        under = [(y - radius, floor_top)]
        if slope > 0.0:
            under = [(y - radius - slope, back - slope), (y - radius - slope, floor_top)][: 1 + (slope < holes.post_mm)]
        profile = [(y + radius, floor_top), (y + radius, back), (y - radius, back), *under]
        pieces.append(along_x(np.array(profile), x - radius, x + radius))
        mouth = np.array([x, y, back])
        cuts.append(Bore(mouth + OUTSIDE_MM * ABOVE, -ABOVE, pilot, holes.post_mm + OUTSIDE_MM, SCENE))
    if camera.rest_mm is not None:
        pieces += _rest(camera, holes.play_mm / 2.0, low_y - 0.5)
    floor = (float(low_y), high_y)
    cuts.append(
        _cable_hole(camera, (camera.cable_x_mm, float(body.middle[1]) + camera.cable_y_mm), floor_top, floor, hardware)
    )
    return Held(
        pieces=tuple(pieces),
        cuts=tuple(cuts),
        inner_y_mm=low_y,
        x_mm=(low_x, high_x),
        z_mm=(
            bottom - tie_height_mm(hardware),
            float(body.high[2]) + (camera.rest_mm[1] if camera.rest_mm is not None else 0.0),
        ),
        board_screws=np.column_stack([centres, np.full(len(centres), back + camera.depth_mm)]),
    )


def _rest(camera: CameraBody, gap_mm: float, wall_y: float) -> list[Frustum]:
    """Wedges on the wall left and right, whose faces are `gap_mm` off the barrel as it is drawn.

    That is less than the play of the board's holes: a tie round the barrel draws it onto both.
    """
    if camera.rest_mm is None:
        return []
    z = [camera.pupil_behind_front_mm + height for height in camera.rest_mm]
    angle, away = np.deg2rad(REST_DEG), camera.lens_ring_mm / 2.0 + gap_mm

    def face_y(x: float) -> float:
        return float((x * np.sin(angle) - away) / np.cos(angle))

    if (reach := face_y(REST_FROM_MM)) <= wall_y:
        raise InputError(
            f"camera clip's rest for the lens would begin {wall_y - reach:.1f} mm inside its wall, "
            f"expected a barrel less wide than {camera.lens_ring_mm:g} mm, or no rest_mm"
        )
    profile = np.array(
        [(REST_FROM_MM, wall_y), (REST_TO_MM, wall_y), (REST_TO_MM, face_y(REST_TO_MM)), (REST_FROM_MM, reach)]
    )
    return [along_z(profile * (side, 1.0), z[0], z[1]) for side in (-1.0, 1.0)]


def _post_radius_mm(holes: BoardHoles) -> float:
    """Half the width of a post, which is square."""
    return holes.hole_mm / 2.0 + 2.0


def _cable_hole(
    camera: CameraBody, at: tuple[float, float], top: float, floor_y: tuple[float, float], hardware: Hardware
) -> Frustum | Bore:
    """The hole in the floor for a cable at (x, y): round for a plug; for a ribbon a slot, open if near the edge."""
    free, wall = hardware.fit.free_mm, hardware.clip.wall_mm
    if not camera.cable_thick_mm:
        radius = max(camera.cable_mm / 2.0 + free, PLUG_RADIUS_MM)
        return Bore(np.array([*at, top + 1.0]), -ABOVE, radius, wall + 2.0, SCENE)
    half, thick = camera.cable_mm / 2.0 + free, camera.cable_thick_mm / 2.0 + RIBBON_FREE_MM
    high = at[1] + thick
    if high > floor_y[1] - wall:
        high = floor_y[1] + 1.0
    return box((at[0] - half, at[1] - thick, top - wall - 1.0), (at[0] + half, high, top + 1.0))
