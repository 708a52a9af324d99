"""Close-ups of single actions of the guide: an insert or a nut, a mirror over its glue or tape, its film, a cable tie.

The parts are the device's own; consumables such as beads of glue, film and ties are drawn by their dimensions in the
plan.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import trimesh
from shapely import MultiPoint, Point, Polygon, box, get_coordinates
from shapely.geometry.polygon import orient

from mirrorcam.cad.assembly.device_plan import Device
from mirrorcam.cad.guide.assembly_steps import Stages, belongs, home_of, joins_of
from mirrorcam.cad.guide.picture_views import (
    ARROW_GAP_MM,
    ARROW_MM,
    CLOSE_UP_PX,
    DevicePicture,
    Item,
    arrow_head,
    axes_towards,
    displaced,
    exit_path,
    in_place,
    inserted,
)
from mirrorcam.cad.guide.shading import Rgb, ShadedBody
from mirrorcam.cad.holder.glue import bead_mm
from mirrorcam.cad.parts.camera_box import body_box
from mirrorcam.cad.parts.ties import TIE_THICK_MM
from mirrorcam.cad.plan.device_names import FILM, SEAT, THREAD, TIE, carrier_name
from mirrorcam.cad.plan.seats import Frustum, pad_height_mm, seat_height_mm
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.mirror import Mirror
from mirrorcam.optics.geometry.mirror_gaps import edges_mm
from mirrorcam.optics.geometry.transforms import inverse, transform

GLUE_RGB: Rgb = (0.93, 0.91, 0.80)
TAPE_RGB: Rgb = (0.93, 0.72, 0.25)
FILM_RGB: Rgb = (0.42, 0.66, 0.92)
TIE_RGB: Rgb = (0.93, 0.93, 0.93)
IRON_RGB: Rgb = (0.62, 0.45, 0.35)
# Distance of the mirror from its seat, as a ratio of its smaller side.
LIFT_RATIO = 0.75
# A soldering iron: radius and length of its tip and of its barrel.
IRON_TIP_MM, IRON_BARREL_MM = (2.2, 9.0), (3.2, 14.0)
# The film is peeled over this share of the mirror's diagonal, round a roll of this radius, up to this angle.
PEELED, ROLL_MM, ROLL_DEG = 0.55, 3.5, 140.0
FILM_STRIPS = 40
FILM_GAP_MM = 0.05
# Distance of a bead's ends from the edge of the mirror and from pads.
BEAD_END_MM = 1.5
# Width of a tie that is sold as 2.5 mm, and its head and free end.
TIE_WIDTH_MM, TIE_HEAD_MM, TIE_END_MM = 2.5, (4.5, 4.0), 16.0


def action_pictures(device: Device, stages: Stages) -> tuple[DevicePicture, ...]:
    """The close-ups of a device, in the order of the guide."""
    makers = {THREAD: _thread, SEAT: _seat, FILM: _film, TIE: _tie}
    return tuple(makers[name](device, stages) for name in action_names(device))


def action_names(device: Device) -> tuple[str, ...]:
    """The names of the close-ups of a device."""
    tied = device.hardware.camera.has_cable or len(device.clip.straps_mm) > 0
    return (THREAD, SEAT, *([FILM] if has_film(device) else []), *([TIE] if tied else []))


def has_film(device: Device) -> bool:
    """Whether the mirrors' fronts have a protective film, as coatings and acrylic have when sold, not glass."""
    acrylic = device.hardware.cutting.material == "acrylic"
    return acrylic or any(mirror.surface == "first" for mirror in device.layout.mirrors)


def _close_up(
    name: str, title: str, axes: FloatArray, items: Sequence[Item], caption: str, focus: FloatArray
) -> DevicePicture:
    """A small picture of the surroundings of the points `focus` (n, 3)."""
    return DevicePicture(name, title, axes, tuple(items), caption=caption, focus=focus, size_px=CLOSE_UP_PX)


def _thread(device: Device, stages: Stages) -> DevicePicture:
    """One insert under the iron's tip, or one nut before its pocket."""
    thread = stages.threads[0]
    parts = stages.of_kind("part")
    home = home_of(thread, joins_of(thread)[-1], parts)
    assert home is not None and thread.item is not None
    path = exit_path(thread)
    out, leaves = thread.item.rig_from_item[:3, 2], path[-1] / np.linalg.norm(path[-1])
    side = np.cross(out, device.level_from_rig[1])
    items = [in_place(home, pale=True), *inserted(thread, np.zeros(3))]
    centre = np.asarray(thread.mesh.bounds).mean(axis=0)
    focus = [centre, centre + path[-1]]
    if thread.kind == "insert":
        top = thread.item.rig_from_item.copy()
        top[:3, 3] += path[-1]
        items += [Item(ShadedBody(transform(top, triangles), IRON_RGB), "") for triangles in _iron()]
        focus.append(top[:3, 3] + 0.9 * sum(length for _, length in (IRON_TIP_MM, IRON_BARREL_MM)) * out)
        title, caption = "An insert", "The tip of the iron in the insert, square to the face"
    else:
        title, caption = "A nut", "A nut goes into its pocket as the arrow shows"
    axes = axes_towards(device.level_from_rig, 0.7 * out + 0.5 * leaves + 0.9 * side / np.linalg.norm(side))
    return _close_up(THREAD, title, axes, items, caption, np.array(focus))


def _iron() -> tuple[FloatArray, FloatArray]:
    """Tip and barrel of a soldering iron on the z axis, its point at the origin."""
    tip = trimesh.creation.cone(*IRON_TIP_MM, sections=24)
    tip.apply_transform(trimesh.transformations.rotation_matrix(np.pi, (1.0, 0.0, 0.0), (0.0, 0.0, IRON_TIP_MM[1] / 2)))
    barrel = trimesh.creation.cylinder(*IRON_BARREL_MM, sections=24)
    barrel.apply_translation((0.0, 0.0, IRON_TIP_MM[1] + IRON_BARREL_MM[1] / 2.0))
    return _triangles(tip), _triangles(barrel)


def _seat(device: Device, stages: Stages) -> DevicePicture:
    """A mirror over its seat, which has beads of glue or squares of tape."""
    layout = device.layout
    centres = np.array([mirror.outline_in_rig_mm.mean(axis=0) for mirror in layout.mirrors])
    # The outermost mirror has the most rims.
    index = int(np.argmax(np.linalg.norm(centres - centres.mean(axis=0), axis=1)))
    mirror, name = layout.mirrors[index], layout.mirror_names[index]
    carriers = [carrier for carrier in stages.carriers if belongs(carrier, carrier_name(name))]
    (component,) = [mirror for mirror in stages.mirrors if mirror.name == f"mirror_{name}"]
    taped = device.hardware.holder.mirrors == "tape"
    stuck = _tape(device, index) if taped else glue_beads(device, index)
    lift = LIFT_RATIO * edges_mm(mirror).min() * mirror.normal_in_rig
    corners = mirror.outline_in_rig_mm
    edge = np.argmax(((corners + np.roll(corners, -1, axis=0)) / 2.0) @ device.level_from_rig[1])
    middle = (corners[edge] + np.roll(corners, -1, axis=0)[edge]) / 2.0
    outward = middle - corners.mean(axis=0)
    at = middle + ARROW_GAP_MM * outward / np.linalg.norm(outward)
    items = [
        *(in_place(part, pale=True) for part in carriers or stages.holder),
        *(Item(ShadedBody(triangles, TAPE_RGB if taped else GLUE_RGB), "") for triangles in stuck),
        displaced(component, lift),
        Item(arrow_head(at + 0.5 * lift, -mirror.normal_in_rig), "", np.array([at + lift, at])),
    ]
    right, down, _ = device.level_from_rig
    axes = axes_towards(device.level_from_rig, 0.4 * mirror.normal_in_rig + 0.75 * down + 0.3 * right)
    title = "A mirror and its tape" if taped else "A mirror and its glue"
    what = "A square of tape on each pad" if taped else "Beads of glue between the grooves, none on the pads"
    return _close_up(SEAT, title, axes, items, what, np.vstack([corners, corners + lift]))


def _pads(device: Device, index: int) -> tuple[Frustum, ...]:
    """The pads under a mirror, on its carrier or on the holder."""
    carriers = device.mirror_carriers
    return carriers[index].pads if carriers else device.holder.pads_of_mirrors[index]


def glue_beads(device: Device, index: int) -> list[FloatArray]:
    """Beads of glue midway between the grooves of a seat, clear of its pads: triangles (n, 3, 3) in the rig frame."""
    mirror, hardware = device.layout.mirrors[index], device.hardware
    pitch, radius = hardware.holder.groove_pitch_mm, bead_mm(hardware) / 2.0
    room = Polygon(mirror.outline_in_plane_mm).buffer(-BEAD_END_MM)
    for pad in _pads(device, index):
        in_plane = transform(inverse(mirror.rig_from_plane), pad.top)[:, :2]
        room = room.difference(Polygon(in_plane).buffer(radius + BEAD_END_MM))
    low, bottom, high, top = room.bounds
    beads = []
    for x in pitch * np.arange(np.ceil(low / pitch), np.floor(high / pitch) + 1.0):
        line = room.intersection(box(x - 1e-3, bottom, x + 1e-3, top))
        for piece in getattr(line, "geoms", [line]):
            if not piece.is_empty and piece.bounds[3] - piece.bounds[1] > 2.0 * radius:
                height = seat_height_mm(mirror, hardware) + radius
                ends = [(x, piece.bounds[1], height), (x, piece.bounds[3], height)]
                bead = trimesh.creation.cylinder(radius, segment=np.array(ends), sections=12)
                beads.append(transform(mirror.rig_from_plane, _triangles(bead)))
    return beads


def _tape(device: Device, index: int) -> list[FloatArray]:
    """The squares of tape on a mirror's pads as triangles (n, 3, 3) in the rig frame."""
    mirror, holder = device.layout.mirrors[index], device.hardware.holder
    squares = []
    for pad in _pads(device, index):
        centre = transform(inverse(mirror.rig_from_plane), pad.top).mean(axis=0)
        square = trimesh.creation.box((holder.tape_pad_mm, holder.tape_pad_mm, holder.tape_mm))
        square.apply_translation((*centre[:2], pad_height_mm(mirror, device.hardware) + holder.tape_mm / 2.0))
        squares.append(transform(mirror.rig_from_plane, _triangles(square)))
    return squares


def _film(device: Device, stages: Stages) -> DevicePicture:
    """The film half peeled off the central mirror, all mirrors in their seats."""
    layout = device.layout
    mirror = layout.mirrors[layout.central_index]
    film, corner, pull = peeled_film(mirror)
    body = ShadedBody(np.concatenate([film, film[:, ::-1]]), FILM_RGB)
    items = [
        *(in_place(part, pale=True) for part in (*stages.holder, *stages.carriers)),
        *(in_place(component) for component in stages.mirrors),
        Item(body, ""),
        Item(arrow_head(corner + ARROW_GAP_MM * pull, pull), ""),
    ]
    viewer = mirror.normal_in_rig + 0.45 * device.level_from_rig[1] + 0.3 * device.level_from_rig[0]
    focus = np.vstack([mirror.outline_in_rig_mm, film.reshape(-1, 3)])
    caption = "Last of all: peel the film off slowly, from a corner"
    return _close_up(FILM, "The film of a mirror", axes_towards(device.level_from_rig, viewer), items, caption, focus)


def peeled_film(mirror: Mirror) -> tuple[FloatArray, FloatArray, FloatArray]:
    """A film partly rolled off a mirror's front: triangles (n, 3, 3), its free corner (3,) and its pull (3,), in rig.

    The film is developable: strips across the diagonal from the free corner keep their lengths.
    """
    outline = np.array(orient(Polygon(mirror.outline_in_plane_mm)).exterior.coords)[:-1]
    corner = outline[np.argmax(np.linalg.norm(outline, axis=1))]
    along = -corner / np.linalg.norm(corner)
    across = np.array([-along[1], along[0]])
    flat = (outline - corner) @ np.column_stack([along, across])
    length = float(flat[:, 0].max())
    polygon, fold = Polygon(flat), PEELED * length
    edges = np.linspace(flat[:, 0].min(), length, FILM_STRIPS + 1)
    wide = float(np.abs(flat).max()) + 1.0
    triangles = []
    for start, end in pairwise(edges):
        loop = get_coordinates(polygon.intersection(box(start, -wide, end, wide)))[:-1]
        rolled = _rolled(loop, fold)
        triangles += [[rolled[0], rolled[k], rolled[k + 1]] for k in range(1, len(rolled) - 1)]
    free, before = _rolled(np.array([[0.0, 0.0], [1.0, 0.0]]), fold)
    in_plane, front = np.column_stack([along, across]), mirror.front_mm + FILM_GAP_MM

    def in_rig(points: FloatArray) -> FloatArray:
        local = np.concatenate([points[..., :2] @ in_plane.T + corner, points[..., 2:] + front], axis=-1)
        return transform(mirror.rig_from_plane, local)

    tip, pull = in_rig(free), in_rig(free) - in_rig(before)
    return in_rig(np.array(triangles)), tip, pull / np.linalg.norm(pull)


def _rolled(points: FloatArray, fold: float) -> FloatArray:
    """Points (n, 2) of a flat film, along and across, rolled up (n, 3) where they are before the fold."""
    angle_max = np.radians(ROLL_DEG)
    free = np.maximum(fold - points[:, 0], 0.0)
    angle = np.minimum(free / ROLL_MM, angle_max)
    straight = free - angle * ROLL_MM
    along = np.maximum(points[:, 0], fold) - ROLL_MM * np.sin(angle) - straight * np.cos(angle)
    height = ROLL_MM * (1.0 - np.cos(angle)) + straight * np.sin(angle)
    return np.column_stack([along, points[:, 1], height])


def _tie(device: Device, stages: Stages) -> DevicePicture:
    """The ties of the camera and of its cable in the slots of the clip."""
    loops = tie_loops(device)
    items = [in_place(part, pale=True) for part in (*stages.clip, *stages.camera, *stages.camera_screws)]
    focus = []
    for content, z, pull in loops:
        band, head, end = tie_solids(content, z, pull)
        items += [Item(ShadedBody(np.concatenate([band, head]), TIE_RGB), ""), Item(arrow_head(end, _level(pull)), "")]
        focus += [*band.reshape(-1, 3), end + ARROW_MM * _level(pull)]
    viewer = np.array([-0.45, 0.75, -0.75])
    caption = "Close the tie round the cable" if len(loops) == 1 else "Close the ties round body and cable"
    return _close_up(TIE, "Cable ties", axes_towards(device.level_from_rig, viewer), items, caption, np.array(focus))


def tie_loops(device: Device) -> list[tuple[FloatArray, float, FloatArray]]:
    """What each tie surrounds: points (n, 2) in x and y of the rig, z, and the direction (2,) of the tie's free end."""
    clip, camera = device.clip, device.hardware.camera
    body = body_box(camera)
    # The tie lies on the floor of the hollow in the wall's outer face.
    floor_y = clip.slide_y_mm + clip.rib_mm + device.hardware.fit.slide_mm + TIE_THICK_MM
    loops = []
    if camera.has_cable:
        left, right, z = clip.tie_mm
        thick = camera.cable_thick_mm or camera.cable_mm
        centre = np.array([camera.cable_x_mm, float(body.centre[1]) + camera.cable_y_mm])
        half = np.array([camera.cable_mm, thick]) / 2.0
        cable = (
            get_coordinates(box(*(centre - half), *(centre + half)))
            if camera.cable_thick_mm
            else get_coordinates(Point(*centre).buffer(half[0]))
        )
        loops.append((np.vstack([cable, [(left, floor_y), (right, floor_y)]]), z, np.array([0.0, 1.0])))
    for left, right, z in clip.straps_mm:
        low, high = body.low, body.high
        corners = [(left, floor_y), (right, floor_y), (low[0], high[1]), (high[0], high[1])]
        loops.append((np.array(corners), float(z), np.array([-1.0, 0.0])))
    return loops


def tie_solids(content: FloatArray, z: float, pull: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """A tie round points (n, 2): triangles (n, 3, 3) of its band, of its head with its free end, and that end (3,)."""
    hull = MultiPoint(content).convex_hull
    inner, outer = (
        np.array(orient(hull.buffer(margin, quad_segs=8)).exterior.segmentize(1.0).coords)[:-1]
        for margin in (0.0, TIE_THICK_MM)
    )
    # Each point of the band's inside is opposite its nearest outside point.
    nearest = np.argmin(np.linalg.norm(outer[:, None] - inner[None], axis=2), axis=1)
    inside = inner[nearest]
    low, high = z - TIE_WIDTH_MM / 2.0, z + TIE_WIDTH_MM / 2.0
    rings = [
        np.column_stack([loop, np.full(len(loop), height)])
        for loop, height in ((outer, low), (outer, high), (inside, high), (inside, low))
    ]
    band = []
    for ring, following in zip(rings, [*rings[1:], rings[0]], strict=True):
        after, opposite = np.roll(ring, -1, axis=0), np.roll(following, -1, axis=0)
        band += [np.stack([ring, after, opposite], axis=1), np.stack([ring, opposite, following], axis=1)]
    at = outer[np.argmax(outer @ pull)]
    size, height = TIE_HEAD_MM
    head = trimesh.creation.box((size, size, height))
    head.apply_translation((*at, z))
    end = trimesh.creation.box((*(np.abs(pull) * TIE_END_MM + (1.0 - np.abs(pull)) * TIE_THICK_MM), TIE_WIDTH_MM))
    end.apply_translation((*(at + pull * TIE_END_MM / 2.0), z))
    tip = np.array([*(at + pull * (TIE_END_MM + ARROW_GAP_MM)), z])
    return np.concatenate(band), np.concatenate([_triangles(head), _triangles(end)]), tip


def _level(direction: FloatArray) -> FloatArray:
    return np.array([*direction, 0.0])


def _triangles(mesh: trimesh.Trimesh) -> FloatArray:
    """The triangles (n, 3, 3) of a mesh."""
    return np.asarray(mesh.triangles, dtype=np.float64)
