"""The corner of a camera's body that a tray cannot hold: small cubes, machine-vision cameras and heavy bodies.

Three points on the clip's wall, two on a fence behind the body and one on a stop beside it locate the body. Ties round
it draw it to the wall, or countersunk screws from behind the wall in the body's own threads. The clip prints lying on
its slide, and all of the corner stands upright on the wall.
"""

from __future__ import annotations

import numpy as np

from mirrorcam.cad.parts.camera_box import (
    ABOVE,
    GRAVITY_N_PER_KG,
    SCENE,
    UP,
    BodyBox,
    CameraScrew,
    Cradle,
    Nest,
    body_box,
    tie_height_mm,
)
from mirrorcam.cad.parts.ties import tie_slot_mm
from mirrorcam.cad.plan.fasteners import OUTSIDE_MM, ROOF_DEG, Bore, Countersink
from mirrorcam.cad.plan.hardware import Hardware
from mirrorcam.cad.plan.prisms import box
from mirrorcam.cad.plan.seats import Frustum
from mirrorcam.cad.plan.threads import COUNTERSUNK, SUNK_HEAD, thread_of
from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.camera_body import CameraBody, Threads

# Height of the pads on the wall for ties, their side, and the largest height of fence and stop.
PAD_MM, PAD_SIDE_MM, FENCE_MM = 0.8, 3.0, 12.0
# Lowest fence and stop that locate a body.
MIN_FENCE_MM = 2.0
# Overlap of joined pieces.
OVERLAP_MM = 0.5
# Tension of a nylon tie of 2.5 mm after relaxation: a quarter of its strength in a loop, 80 N by its makers.
TIE_N = 20.0
# Friction of plastic on plastic or painted metal, a low value, and the factor by which the ties hold more than needed.
FRICTION, RESERVE = 0.25, 1.5
# Ties round a body, at most, and the distance of a tie from the body's front and back.
MAX_TIES, TIE_EDGE_MM = 3, 1.0
# Smallest and best engagement of a screw in a camera's thread, in diameters, and the space left below its tip.
MIN_ENGAGED, ENGAGED, BELOW_TIP_MM = 0.8, 1.5, 0.3
# Plastic between a countersunk head and the body, at least, and depth of the head below the wall's outer face.
HEAD_FLOOR_MM, SINK_MM = 1.6, 0.2
# How much higher a plateau may be for the screws on sale.
MAX_HIGHER_MM = 4.0


def hold_by_straps(camera: CameraBody, hardware: Hardware) -> Cradle:
    """Lay out a corner with ties round the body; raises InputError, with the remedy, if they cannot hold it."""
    body = body_box(camera)
    need = RESERVE * camera.mass_g / 1000.0 * GRAVITY_N_PER_KG * hardware.clip.shaken_g
    # Each tie presses with both its ends; the body would slip at the wall and under the tie.
    count = max(1, int(np.ceil(need / (4.0 * FRICTION * TIE_N))))
    half_z, half_x = tie_slot_mm(hardware)
    room = float(body.high[2] - body.low[2]) - 2.0 * TIE_EDGE_MM
    if count > MAX_TIES or count * (2.0 * half_z + hardware.printer.wall_mm) > room:
        raise InputError(
            f"ties round the body would hold it with {4.0 * FRICTION * TIE_N:g} N each, but {camera.mass_g:g} g at "
            f'{hardware.clip.shaken_g:g} g need {need:.0f} N: give its threads (held_by.kind = "threads"), its true '
            "mass_g, or a lower shaken_g under [clip]"
        )
    levels = body.low[2] + TIE_EDGE_MM + room * (np.arange(count) + 0.5) / count
    stop_x = float(body.low[0]) - hardware.clip.wall_mm
    gap = half_x + hardware.fit.free_mm
    straps = np.array([(stop_x - gap, float(body.high[0]) + gap, z) for z in levels])
    inner_y = float(body.low[1]) - PAD_MM
    pads = _pad_points(body)
    half = PAD_SIDE_MM / 2.0
    pieces = [
        box((x - half, inner_y - OVERLAP_MM, z - half), (x + half, float(body.low[1]), z + half)) for x, _, z in pads
    ]
    wall = hardware.printer.wall_mm + half_x
    return _corner(
        camera, body, inner_y, pads, pieces, (float(straps[0, 0]) - wall, float(straps[0, 1]) + wall), straps, hardware
    )


def _pad_points(body: BodyBox) -> FloatArray:
    """Three points (3, 3) of the wall on the body's side, near its corners."""
    inset = PAD_SIDE_MM / 2.0 + 0.5
    (low_x, y, low_z), (high_x, _, high_z) = body.low, body.high
    middle = float(low_x + high_x) / 2.0
    return np.array(
        [(low_x + inset, y, low_z + inset), (high_x - inset, y, low_z + inset), (middle, y, high_z - inset)]
    )


def hold_by_threads(camera: CameraBody, threads: Threads, wall_mm: float, hardware: Hardware) -> Cradle:
    """Lay out a corner with screws in the body's threads, through a wall of `wall_mm` and a plateau on it.

    Raises InputError if no screw on sale fits, or a thread is not in the body's side.
    """
    body = body_box(camera)
    thread = thread_of(threads.thread)
    head_radius = SUNK_HEAD * thread.diameter_mm / 2.0
    head_mm = (SUNK_HEAD - 1.0) * thread.diameter_mm / 2.0
    # The plateau makes the wall thick enough for the head.
    # A head over the mount's rib, such as that of a tripod's thread below the lens, is deeper than the rib's groove.
    groove = hardware.clip.rib_mm + 2.0 * hardware.fit.slide_mm
    over_rib = any(abs(x) < head_radius + groove for x, _ in threads.threads_mm)
    min_sink = max(SINK_MM, groove) if over_rib else SINK_MM
    plateau = max(PAD_MM, head_mm + min_sink + HEAD_FLOOR_MM - wall_mm)
    # A screw that would be too long engages as far as it may through a higher plateau.
    deepest = _most_mm(threads)
    exact = [length + min_sink - deepest - wall_mm for length in sunk_lengths_mm(threads.thread)]
    if over_rib:
        plateau = min((mm for mm in exact if plateau <= mm <= plateau + MAX_HIGHER_MM), default=plateau)
    through = wall_mm + plateau
    length, engaged = _screw(threads, through, (min_sink, through - head_mm - HEAD_FLOOR_MM))
    sink = engaged + through - length
    inner_y = float(body.low[1]) - plateau
    outer_y = inner_y - wall_mm
    heads = np.array([(x, outer_y + sink, camera.pupil_behind_front_mm - behind) for x, behind in threads.threads_mm])
    for x, _, z in heads:
        edge = min(x - body.low[0], body.high[0] - x, z - body.low[2], body.high[2] - z)
        if edge < thread.diameter_mm / 2.0:
            raise InputError(
                f"camera body {camera.name}: thread at {x:g} mm from the lens axis and "
                f"{camera.pupil_behind_front_mm - z:g} mm behind the front, expected it inside the body's side"
            )
    cuts = [cut for head in heads for cut in _countersunk(head, outer_y, through, thread.clearance_mm, head_radius)]
    low, high = body.low, body.high
    plate = box((low[0], inner_y - OVERLAP_MM, low[2]), (high[0], float(low[1]), high[2]))
    screws = tuple(CameraScrew(head, -SCENE, f"{threads.thread}{COUNTERSUNK}", length, engaged) for head in heads)
    x_mm = (float(low[0]) - hardware.clip.wall_mm, float(high[0]))
    cradle = _corner(camera, body, inner_y, _pad_points(body), [plate], x_mm, np.zeros((0, 3)), hardware)
    return Cradle(
        pieces=cradle.pieces,
        cuts=tuple(cuts),
        inner_y_mm=inner_y,
        x_mm=x_mm,
        z_mm=cradle.z_mm,
        screws=screws,
        nest=cradle.nest,
    )


def _most_mm(threads: Threads) -> float:
    """The largest engagement of a screw in a body's thread."""
    return min(threads.thread_depth_mm - BELOW_TIP_MM, ENGAGED * thread_of(threads.thread).diameter_mm)


def _screw(threads: Threads, through_mm: float, sink_mm: tuple[float, float]) -> tuple[float, float]:
    """Length of a screw for a wall of `through_mm`, and its engagement; its head is from .. to `sink_mm` deep."""
    min_sink_mm, max_sink_mm = sink_mm
    thread = thread_of(threads.thread)
    most = _most_mm(threads)
    least = MIN_ENGAGED * thread.diameter_mm
    fits = [
        (min(most, length + max_sink_mm - through_mm), length)
        for length in sunk_lengths_mm(threads.thread)
        if min(most, length + max_sink_mm - through_mm) >= max(least, length + min_sink_mm - through_mm) - 1e-9
    ]
    if not fits:
        raise InputError(
            f"camera's {threads.thread} thread is {threads.thread_depth_mm:g} mm deep, but screws through "
            f"{through_mm:.1f} mm of clip engage less than {least:.1f} mm in it: expected at least "
            f'{least + BELOW_TIP_MM:.1f} mm of thread_depth_mm; held_by.kind = "lips" holds the body by ties'
        )
    engaged, length = max(fits, key=lambda fit: (fit[0], -fit[1]))
    return length, engaged


def sunk_lengths_mm(size: str) -> tuple[float, ...]:
    """Lengths on sale of countersunk screws: ISO 10642 and 7046, and in inches 3/8 to 1 in (ASME B18.3)."""
    if size.endswith("UNC"):
        return tuple(25.4 * eighths / 8.0 for eighths in (3, 4, 5, 6, 8))
    return (5.0, 6.0, 8.0, 10.0, 12.0, 16.0, 20.0)


def _countersunk(
    head: FloatArray, outer_y: float, through_mm: float, clearance_mm: float, head_radius_mm: float
) -> list[Bore | Countersink]:
    """A hole along y through the wall and the plateau for a countersunk screw with its head's rim at a point (3,).

    It prints with its mouth on the bed: the cone is as steep as an overhang may be.
    """
    half, slope = clearance_mm / 2.0, float(np.tan(np.deg2rad(ROOF_DEG)))
    mouth = head_radius_mm + 0.1
    outer = np.array([head[0], outer_y - OUTSIDE_MM, head[2]])
    sink = float(head[1]) - outer_y
    return [
        Bore(outer, SCENE, half, through_mm + 1.0),
        Bore(outer, SCENE, mouth, sink + 2.0 * OUTSIDE_MM),
        Countersink(head, SCENE, mouth, half, (mouth - half) / slope),
    ]


def _corner(
    camera: CameraBody,
    body: BodyBox,
    inner_y: float,
    wall_points: FloatArray,
    pieces: list[Frustum],
    x_mm: tuple[float, float],
    straps: FloatArray,
    hardware: Hardware,
) -> Cradle:
    """Add the fence behind the body and the stop at its lower x to the pieces on the wall."""
    wall, low, high = hardware.clip.wall_mm, body.low, body.high
    height = float(high[1] - low[1])
    fence_y = float(low[1]) + min(FENCE_MM, 0.6 * height)
    if camera.has_cable:
        cable_y = float(body.centre[1]) + camera.cable_y_mm
        cable_half = (camera.cable_thick_mm or camera.cable_mm) / 2.0
        fence_y = min(fence_y, cable_y - cable_half - hardware.fit.free_mm)
    if fence_y - float(low[1]) < MIN_FENCE_MM:
        raise InputError(
            f"camera's cable leaves {fence_y - float(low[1]):.1f} mm for the fence behind the body, expected at least "
            f"{MIN_FENCE_MM:g} mm: use the camera upside down, or give cable_y_mm"
        )
    stop_y = float(low[1]) + min(FENCE_MM, 0.6 * height)
    root = inner_y - OVERLAP_MM
    pieces = [
        *pieces,
        box((float(low[0]) - wall, root, float(low[2]) - wall), (float(high[0]), fence_y, float(low[2]))),
        box((float(low[0]) - wall, root, float(low[2]) - wall), (float(low[0]), stop_y, float(high[2]) - 1.0)),
    ]
    y, inset = (float(low[1]) + fence_y) / 2.0, 0.2 * float(high[0] - low[0])
    points = np.vstack(
        [
            wall_points,
            [(low[0] + inset, y, low[2]), (high[0] - inset, y, low[2])],
            [(low[0], (float(low[1]) + stop_y) / 2.0, float(low[2] + high[2]) / 2.0)],
        ]
    )
    normals = np.array([SCENE, SCENE, SCENE, ABOVE, ABOVE, UP])
    bottom = float(low[2]) - wall - tie_height_mm(hardware)
    return Cradle(
        pieces=tuple(pieces),
        cuts=(),
        inner_y_mm=inner_y,
        x_mm=x_mm,
        z_mm=(bottom, float(high[2])),
        nest=Nest(points, normals, ()),
        straps_mm=straps,
    )
