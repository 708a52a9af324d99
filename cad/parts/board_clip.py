"""The clip's holding of a bare board: posts behind it, whose screws cut their own threads."""

from __future__ import annotations

import numpy as np

from mirrorcam.cad.parts.camera_box import ABOVE, SCENE, Held, body_box, tie_height_mm
from mirrorcam.cad.plan.fasteners import OUTSIDE_MM, Bore, Hexagon
from mirrorcam.cad.plan.hardware import Hardware
from mirrorcam.cad.plan.prisms import along_x, box
from mirrorcam.cad.plan.seats import Frustum
from mirrorcam.optics.geometry.camera_body import BoardHoles, CameraBody

# The least radius of the hole for the cable: a plug of four pins passes.
PLUG_RADIUS_MM = 4.0
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
    floor = (float(low_y), high_y)
    cuts.append(
        _cable_hole(camera, (camera.cable_x_mm, float(body.middle[1]) + camera.cable_y_mm), floor_top, floor, hardware)
    )
    return Held(
        pieces=tuple(pieces),
        cuts=tuple(cuts),
        inner_y_mm=low_y,
        x_mm=(low_x, high_x),
        z_mm=(bottom - tie_height_mm(hardware), float(body.high[2])),
        board_screws=np.column_stack([centres, np.full(len(centres), back + camera.depth_mm)]),
    )


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
