"""The pictures of a device, made from its model: assembled, exploded, its light, and one for each step of the guide."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

from mirrorcam.cad.assembly.build_steps import CLIP
from mirrorcam.cad.assembly.device_plan import Device
from mirrorcam.cad.assembly.pieces import Piece
from mirrorcam.cad.documents.assembly_steps import Stages, home_of, joins_of
from mirrorcam.cad.documents.clip_picture import FIRST_END, end_point, notes_of, screw_label, tilted, viewers
from mirrorcam.cad.documents.picture_views import GUIDE_RGB, DevicePicture, Item
from mirrorcam.cad.documents.shading import Rgb, ShadedBody
from mirrorcam.cad.parts.mount_openings import longest_mark_mm
from mirrorcam.cad.plan.part_plan import BuiltPart
from mirrorcam.optics.base.values import FloatArray
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.transforms import transform

# Where the viewer stands, in view axes (right, down, forward): in the scene, seeing the mirrors; behind the device.
IN_FRONT = (0.95, 0.12, 1.0)
BELOW = (0.55, 0.75, 1.0)
BEHIND = (-0.80, -0.35, -1.0)
LEVEL = (1.0, -0.45, 0.45)
PALE = 0.55
RAY_BEYOND_MIRROR = 1.1
BED_GAP_MM = 14.0
# In the picture of a step what is new stands off by this share of its way in the exploded view.
STEP_SHARE = 0.8
# The head of an arrow, from what is put in towards where it goes: its length, its radius, and how far before it.
ARROW_MM, ARROW_RADIUS_MM, ARROW_BEFORE_MM = 6.0, 2.2, 3.5
ARROW_RGB: Rgb = (0.86, 0.16, 0.12)
COUNT_CAPTION = "From behind; the number after a name is how many go into the part"
# Bars that show which edge is read on a scale.
BAR_MM = 1.4
# How far mirrors are drawn before their seats, from how far below their normal they are seen, where a seat's name is.
MIRROR_LIFT_MM, SEATS_FROM_BELOW, SEAT_NAME_MM = 30.0, 0.3, 2.0
EDGE_TEXT = "This edge at the longest mark"


NO_BODY = ShadedBody(np.zeros((0, 3, 3)), GUIDE_RGB)
PICTURES = 11
"""Number of pictures of a device."""


def pictures_of(device: Device, parts: Sequence[BuiltPart], pieces: Sequence[Piece]) -> tuple[DevicePicture, ...]:
    """All pictures of a device, in the order in which the page shows them; those of steps have the steps' names."""
    layout = device.layout
    viewers = (IN_FRONT, LEVEL, BELOW, BEHIND)
    front, level, below, behind = (view_axes(layout, viewer) for viewer in viewers)
    whole = tuple(_item(piece, _big_label(piece)) for piece in pieces)
    bare = tuple(_item(piece) for piece in pieces)
    rays = tuple(middle_ray(layout, index) for index in range(len(layout.mirrors)))
    apart = _placed([(piece, piece.explode_mm) for piece in pieces])
    stages = Stages(pieces)
    return (
        DevicePicture("assembled", "The device, assembled", front, whole),
        DevicePicture("exploded", "Exploded view", front, apart),
        DevicePicture("light", "The light: from the lens via every mirror to the scene", front, bare, rays),
        DevicePicture("behind", "The device from behind", behind, bare),
        DevicePicture("print", "The printed parts as they lie on the printer's bed", ISOMETRIC_AXES, _on_bed(parts)),
        _inserts(layout, stages, behind, below),
        _mirrors(layout, stages),
        DevicePicture("holder", "Mirror holder and mount", behind, _holder_on_mount(stages)),
        _camera(device, stages),
        DevicePicture("clip", "Clip and mount", level, _clip_on_mount(device, stages)),
        DevicePicture("adapter", "What carries the device", front, _adapter_on_mount(stages)),
    )


def view_axes(layout: Layout, viewer_in_view: Sequence[float] | FloatArray) -> FloatArray:
    """Rows right, up and towards the viewer (3, 3) in rig; up is the scene's."""
    towards = layout.view_from_rig.T @ np.asarray(viewer_in_view, dtype=np.float64)
    towards /= np.linalg.norm(towards)
    up = -layout.view_from_rig[1]
    up = up - (up @ towards) * towards
    up /= np.linalg.norm(up)
    return np.array([np.cross(up, towards), up, towards])


# The printer's bed from the front right, above: z is up.
ISOMETRIC_AXES = Rotation.from_euler("zx", (-28.0, -52.0), degrees=True).as_matrix()


def middle_ray(layout: Layout, index: int) -> FloatArray:
    """Pupil, middle of a mirror, and a point towards the scene: (3, 3) in rig, mm."""
    mirror = layout.mirrors[index]
    middle = mirror.outline_in_rig_mm.mean(axis=0)
    direction = middle - mirror.virtual_centre_in_rig_mm
    length = RAY_BEYOND_MIRROR * np.linalg.norm(layout.mirrors[layout.central_index].outline_in_rig_mm.mean(axis=0))
    return np.array([np.zeros(3), middle, middle + length * direction / np.linalg.norm(direction)])


def axes_towards(layout: Layout, viewer_in_rig: FloatArray) -> FloatArray:
    """As `view_axes`, of a direction (3,) in rig."""
    return view_axes(layout, layout.view_from_rig @ viewer_in_rig)


def _inserts(layout: Layout, stages: Stages, behind: FloatArray, below: FloatArray) -> DevicePicture:
    """The parts with what is put into them from behind and from the front; those that carry mirrors by themselves."""
    title = "Where inserts and nuts go"
    carriers = stages.carriers
    items = _threads(stages, [part for part in stages.of_kind("part") if part not in carriers])
    third = None
    if carriers:
        ways = [np.diff(_places_out(thread), axis=0)[-1] for thread in stages.threads_in(carriers)]
        axes = axes_towards(layout, _mean([way / np.linalg.norm(way) for way in ways]))
        third = DevicePicture(
            "inserts", title, axes, _threads(stages, carriers), caption="The mirror carriers", inside=True
        )
    front = DevicePicture("inserts", title, below, items, caption="The same parts from the front", below=third)
    return DevicePicture("inserts", title, behind, items, caption=COUNT_CAPTION, below=front)


def _threads(stages: Stages, among: Sequence[Piece]) -> tuple[Item, ...]:
    """Parts away from each other, their inserts and nuts at the beginning of their ways in, with arrows."""
    parts = [part for part in among if stages.threads_in([part])]
    carriers = {piece.name for piece in stages.carriers}
    threads = stages.threads_in(parts)
    homes = [home_of(thread, joins_of(thread)[-1], parts) for thread in threads]
    counts = Counter(home.name for home in homes if home)
    items = [
        _moved(
            part,
            part.explode_mm,
            _label_with_count(part, part.name in carriers, counts[part.name]),
            pale=True,
        )
        for part in parts
    ]
    for thread, home in zip(threads, homes, strict=True):
        items += _put_in(thread, home.explode_mm if home else np.zeros(3))
    return tuple(items)


def _label_with_count(part: Piece, short: bool, count: int) -> str:
    """The name of a part in the picture of its inserts or nuts, and how many it takes."""
    return f"{part.number if short else _big_label(part)}: {count}"


def _put_in(thread: Piece, seat: FloatArray) -> tuple[Item, Item]:
    """An insert or a nut outside of its part, which is drawn `seat` (3,) mm away, its way in, and an arrow along it."""
    places = seat + _places_out(thread)
    drawn = _moved(thread, places[-1])
    inwards = places[-2] - places[-1]
    inwards /= np.linalg.norm(inwards)
    centre = np.asarray(thread.mesh.bounds).mean(axis=0)
    head = _arrow_head(centre + places[-1] + ARROW_BEFORE_MM * inwards, inwards)
    return replace(drawn, line=centre + places), Item(head, "")


def _places_out(thread: Piece) -> FloatArray:
    """Where an insert or a nut is on its way out of its seat (n, 3), from its seat on, mm."""
    moves = thread.item.way_out_mm if thread.item else np.zeros((0, 3))
    return np.concatenate([np.zeros((1, 3)), np.cumsum(moves, axis=0)])


def _arrow_head(at: FloatArray, way: FloatArray) -> ShadedBody:
    """A cone from a point (3,) along a unit vector (3,)."""
    cone = trimesh.creation.cone(ARROW_RADIUS_MM, ARROW_MM, sections=24)
    cone.apply_transform(trimesh.geometry.align_vectors(np.array([0.0, 0.0, 1.0]), way))
    return ShadedBody(np.asarray(cone.triangles, dtype=np.float64) + at, ARROW_RGB)


def _mirrors(layout: Layout, stages: Stages) -> DevicePicture:
    """The mirrors before their seats, seen along their normals, and in the same view the seats by name."""
    title = "Which mirror goes where"
    normal = _mean([mirror.normal_in_rig for mirror in layout.mirrors])
    normal = normal / np.linalg.norm(normal)
    axes = axes_towards(layout, normal + SEATS_FROM_BELOW * layout.view_from_rig[1])
    holder = tuple(_item(piece, pale=True) for piece in stages.holder)
    fasteners = [
        _moved(piece, piece.explode_mm - _mean([p.explode_mm for p in stages.holder]))
        for piece in stages.carrier_screws
    ]
    lifted = [_lifted(piece, stages.holder, normal) for piece in (*stages.mirrors, *stages.carriers)]
    lines = [
        Item(NO_BODY, "", np.array([corner, corner + MIRROR_LIFT_MM * normal]))
        for mirror in layout.mirrors
        for corner in mirror.outline_in_rig_mm
    ]
    names = tuple(
        (f"seat {name}", mirror.outline_in_rig_mm.mean(axis=0) + SEAT_NAME_MM * mirror.normal_in_rig)
        for name, mirror in zip(layout.mirror_names, layout.mirrors, strict=True)
    )
    seats = DevicePicture(
        "mirrors",
        title,
        axes,
        holder,
        notes=names,
        inside=True,
        caption="The seats without the mirrors, from the same side",
    )
    caption = "Seen from the front, from the scene: each mirror before its seat"
    return DevicePicture(
        "mirrors", title, axes, (*holder, *lifted, *fasteners, *lines), caption=caption, inside=True, below=seats
    )


def _holder_on_mount(stages: Stages) -> tuple[Item, ...]:
    rest = [*stages.holder, *stages.carriers, *stages.mirrors, *stages.threads_in(stages.holder)]
    return _joined(rest, stages.mount, stages.holder_screws, stages.holder)


def _camera(device: Device, stages: Stages) -> DevicePicture:
    """The camera before its clip from above the lens and from behind, with what of the clip the guide speaks of."""
    clip = device.clip
    rest = [*stages.clip, *stages.threads_in(stages.clip)]
    plain = _joined(rest, [], stages.camera_screws, stages.clip)
    plain = tuple(
        replace(item, label=screw_label(clip, screw)) if screw else item
        for item, screw in zip(plain, [*(None for _ in rest), *stages.camera_screws], strict=True)
    )
    away = STEP_SHARE * (stages.camera[0].explode_mm - _mean([piece.explode_mm for piece in stages.clip]))
    new = []
    for camera in stages.camera:
        body = _moved(camera, away, _big_label(camera)).body
        new.append(Item(replace(body, triangles=tilted(clip, body.triangles)), _big_label(camera)))
        if clip.nest is not None:
            end = end_point(clip.nest, body.triangles)
            seat = end_point(clip.nest, _triangles(camera))
            way = (seat - end) / np.linalg.norm(seat - end)
            head = _arrow_head((end + seat) / 2.0, way)
            new.append(Item(head, FIRST_END, np.array([end, seat])))
    first, second = (axes_towards(device.layout, viewer) for viewer in viewers(clip))
    notes, title = notes_of(clip), "Camera and clip"
    # The camera hides nothing of the clip in the lower view.
    lower = DevicePicture("camera", title, second, plain, notes=notes, caption="The clip alone, from the camera's back")
    return DevicePicture(
        "camera", title, first, (*plain, *new), notes=notes, caption="From above the lens", below=lower
    )


def _clip_on_mount(device: Device, stages: Stages) -> tuple[Item, ...]:
    """The clip with its camera before the mount; a red bar on each says what is read against what."""
    rest = [*stages.holder, *stages.carriers, *stages.mount, *stages.mirrors, *stages.holder_screws]
    new = [*stages.clip, *stages.camera, *stages.camera_screws]
    items = _joined(rest, new, stages.clip_screws, stages.mount, together=stages.clip)
    away = STEP_SHARE * (
        _mean([piece.explode_mm for piece in stages.clip]) - _mean([p.explode_mm for p in stages.mount])
    )
    inside = [_moved(thread, away) for thread in stages.threads_in(stages.clip)]
    edge, mark = scale_edges(device)
    bars = (ShadedBody(edge + away, ARROW_RGB), ShadedBody(mark, ARROW_RGB))
    between = np.array([mark.mean(axis=(0, 1)), edge.mean(axis=(0, 1)) + away])
    return (*items, *inside, Item(bars[0], EDGE_TEXT, between), Item(bars[1], ""))


def scale_edges(device: Device) -> tuple[FloatArray, FloatArray]:
    """Bars (n, 3, 3) as triangles in rig: along the clip's edge that reads the scale, and along the longest mark."""
    clip, mount = device.clip, device.mount
    longest = longest_mark_mm(clip, mount.half_width_mm, device.hardware)
    ends = np.array([mount.half_width_mm - longest, mount.half_width_mm])
    bar = trimesh.creation.box((float(np.ptp(ends)), BAR_MM, BAR_MM))
    bar.apply_translation((float(ends.mean()), clip.slide_y_mm, clip.top_mm))
    triangles = np.asarray(bar.triangles, dtype=np.float64)
    return triangles, triangles


def _adapter_on_mount(stages: Stages) -> tuple[Item, ...]:
    held = stages.threads_in(stages.adapter)
    new = {piece.name for piece in (*stages.adapter, *stages.adapter_screws, *stages.back_nuts, *held)}
    rest = [piece for piece in stages.pieces if piece.name not in new]
    items = _joined(rest, stages.adapter, (*stages.adapter_screws, *stages.back_nuts), stages.mount)
    # Inserts and nuts are in the adapter already.
    base = _mean([piece.explode_mm for piece in stages.mount])
    homes = [(thread, home_of(thread, joins_of(thread)[-1], stages.adapter)) for thread in held]
    return (*items, *(_moved(thread, STEP_SHARE * (home.explode_mm - base)) for thread, home in homes if home))


def _joined(
    rest: Sequence[Piece],
    new: Sequence[Piece],
    fasteners: Sequence[Piece],
    still: Sequence[Piece],
    together: Sequence[Piece] = (),
) -> tuple[Item, ...]:
    """Pieces already assembled, pale, and new ones, moved away as in the exploded view in which `still` rests."""
    base = _mean([piece.explode_mm for piece in still])
    block = _mean([piece.explode_mm for piece in together]) - base if together else None
    moves = [(piece, STEP_SHARE * (piece.explode_mm - base if block is None else block)) for piece in new]
    moves += [(piece, STEP_SHARE * (piece.explode_mm - base)) for piece in fasteners]
    return (*(_item(piece, _big_label(piece), pale=True) for piece in rest), *_placed(moves))


def _placed(moves: Sequence[tuple[Piece, FloatArray]]) -> tuple[Item, ...]:
    """Pieces away from their places, each fastener and the camera with a line to where it belongs as that is drawn."""
    parts = {piece.name: piece for piece, _ in moves if piece.kind == "part"}
    away = {piece.name: move for piece, move in moves}
    items: list[Item] = []
    for piece, move in moves:
        joins = (CLIP,) if piece.kind == "camera" else joins_of(piece)
        homes = [
            home_of(piece, name, parts.values())
            for name in (joins if piece.kind in ("screw", "washer") else joins[::-1])
        ]
        home = next((home for home in homes if home), None)
        seat = away[home.name] if home else np.zeros(3) if joins else None
        if seat is not None and piece.kind in ("insert", "nut"):
            items += _put_in(piece, seat)
            continue
        items.append(_moved(piece, move, _big_label(piece), seat=seat))
    return tuple(items)


def _lifted(piece: Piece, holder: Sequence[Piece], normal: FloatArray) -> Item:
    """A mirror lifted along the viewer's way, or a carrier between it and the holder."""
    if piece.kind == "mirror":
        return _moved(piece, MIRROR_LIFT_MM * normal, piece.name.removeprefix("mirror_"))
    nearest = min((part.explode_mm for part in holder), key=lambda move: _distance(move, piece))
    away = float(np.linalg.norm(piece.explode_mm - nearest))
    return _moved(piece, min(away, MIRROR_LIFT_MM / 2.0) * normal)


def _distance(move: FloatArray, piece: Piece) -> float:
    return float(np.linalg.norm(piece.explode_mm - move))


def _mean(vectors: Sequence[FloatArray]) -> FloatArray:
    return np.mean(vectors, axis=0) if vectors else np.zeros(3)


def _item(piece: Piece, label: str = "", *, pale: bool = False) -> Item:
    rgb = piece.rgb
    if pale and piece.kind != "mirror":
        red, green, blue = (PALE * 0.93 + (1.0 - PALE) * channel for channel in rgb)
        rgb = (red, green, blue)
    return Item(ShadedBody(_triangles(piece), rgb, shine=piece.kind == "mirror"), label)


def _moved(
    piece: Piece, away: FloatArray, label: str = "", *, pale: bool = False, seat: FloatArray | None = None
) -> Item:
    """A piece drawn `away` (3,) mm from its place, with a line from where that is drawn, `seat` (3,), if given."""
    here = _item(piece, label, pale=pale)
    centre = np.asarray(piece.mesh.bounds).mean(axis=0)
    path = None if seat is None else np.array([centre + seat, centre + away])
    return Item(ShadedBody(here.body.triangles + away, here.body.rgb, here.body.shine), label, path)


def _triangles(piece: Piece) -> FloatArray:
    return np.asarray(piece.mesh.triangles, dtype=np.float64)


def _big_label(piece: Piece) -> str:
    return f"{piece.number} {piece.title}".strip() if piece.kind in ("part", "camera") else ""


def _on_bed(parts: Sequence[BuiltPart]) -> tuple[Item, ...]:
    """The parts as printed, in rows on a floor, as wide as deep."""

    meshes = [(part, trimesh.load_mesh(part.stl)) for part in parts]
    laid = [(part, transform(part.print_from_rig, np.asarray(mesh.triangles))) for part, mesh in meshes]
    sizes = [np.ptp(triangles.reshape(-1, 3), axis=0) for _, triangles in laid]
    row_end = 1.05 * np.sqrt(sum((size[0] + BED_GAP_MM) * (size[1] + BED_GAP_MM) for size in sizes))
    x = y = deepest = 0.0
    items = []
    for (part, triangles), size in zip(laid, sizes, strict=True):
        if x > 0.0 and x + size[0] > row_end:
            x, y, deepest = 0.0, y - deepest - BED_GAP_MM, 0.0
        shift = np.array([x, y - size[1], 0.0]) - triangles.reshape(-1, 3).min(axis=0)
        items.append(Item(ShadedBody(triangles + shift, part.rgb), f"{part.number} {part.title}"))
        x, deepest = x + size[0] + BED_GAP_MM, max(deepest, float(size[1]))
    return tuple(items)
