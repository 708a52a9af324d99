"""The pictures of a device, made from its model: assembled, exploded, its light, and one for each step of the guide."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

from mirrorcam.cad.assembly.build_steps import CLIP
from mirrorcam.cad.assembly.device_plan import Device
from mirrorcam.cad.assembly.pieces import Piece
from mirrorcam.cad.documents.assembly_steps import Stages, home_of, joins_of
from mirrorcam.cad.documents.labels import Label, annotate
from mirrorcam.cad.documents.shading import Rgb, Screen, ShadedBody, render
from mirrorcam.cad.parts.mount_openings import longest_mark_mm
from mirrorcam.cad.plan.part_plan import BuiltPart
from mirrorcam.optics.base.pictures import write_image
from mirrorcam.optics.base.values import FloatArray
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.transforms import transform

PICTURE_PX = (1400, 1050)
# Margin for the names at both sides.
MARGINS_PX = (275, 50)
BARE_MARGINS_PX = (60, 50)
# Where the viewer stands, in view axes (right, down, forward): in the scene, seeing the mirrors; behind the device.
IN_FRONT = (0.95, 0.12, 1.0)
BELOW = (0.55, 0.75, 1.0)
BEHIND = (-0.80, -0.35, -1.0)
BESIDE = (1.0, -0.80, 0.25)
LEVEL = (1.0, -0.45, 0.45)
LIGHT_RGB: Rgb = (0.94, 0.51, 0.10)
GUIDE_RGB: Rgb = (0.55, 0.62, 0.72)
PALE = 0.55
RAY_BEYOND_MIRROR = 1.1
BED_GAP_MM = 14.0
# In the picture of a step what is new stands off by this share of its way in the exploded view.
STEP_SHARE = 0.8
# The head of an arrow, from what is put in towards where it goes: its length, its radius, and how far before it.
ARROW_MM, ARROW_RADIUS_MM, ARROW_BEFORE_MM = 6.0, 2.2, 3.5
ARROW_RGB: Rgb = (0.86, 0.16, 0.12)
# Bars that show which edge is read on a scale.
BAR_MM = 1.4
EDGE_TEXT = "This edge at the longest mark"


@dataclass(frozen=True)
class Item:
    """A body of a picture, in rig, its label ("" for none), and a line to where it belongs."""

    body: ShadedBody
    label: str
    line: FloatArray | None = None


@dataclass(frozen=True)
class DevicePicture:
    """A picture before it is drawn: file stem, title, the viewer's axes (3, 3) in rig, bodies, rays."""

    name: str
    title: str
    axes: FloatArray
    items: tuple[Item, ...]
    rays: tuple[FloatArray, ...] = ()

    @property
    def path(self) -> str:
        """Path below a device's folder."""
        return f"pictures/{self.name}.png"


PICTURES = 11
"""Number of pictures of a device."""


def write_picture(folder: Path, picture: DevicePicture) -> None:
    """Draw a picture and write it below a device's folder."""
    bodies = [item.body for item in picture.items]
    labelled = [Label(index, item.label) for index, item in enumerate(picture.items) if item.label]
    points = np.concatenate([*(body.triangles.reshape(-1, 3) for body in bodies), *picture.rays])
    screen = Screen.around(points, picture.axes, PICTURE_PX, MARGINS_PX if labelled else BARE_MARGINS_PX)
    lines: list[tuple[FloatArray, Rgb, float]] = [
        (item.line, GUIDE_RGB, 1.5) for item in picture.items if item.line is not None
    ]
    lines += [(ray, LIGHT_RGB, 2.0) for ray in picture.rays]
    write_image(folder / picture.path, annotate(render(bodies, screen, lines), labelled))


def pictures_of(device: Device, parts: Sequence[BuiltPart], pieces: Sequence[Piece]) -> tuple[DevicePicture, ...]:
    """All pictures of a device, in the order in which the page shows them; those of steps have the steps' names."""
    layout = device.layout
    viewers = (IN_FRONT, BESIDE, LEVEL, BELOW, BEHIND)
    front, beside, level, below, behind = (view_axes(layout, viewer) for viewer in viewers)
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
        DevicePicture("inserts", "Where inserts and nuts go", behind, _threads(stages)),
        DevicePicture("mirrors", "Which mirror goes where", below, _seating(stages)),
        DevicePicture("holder", "Mirror holder and mount", behind, _holder_on_mount(stages)),
        DevicePicture("camera", "Camera and clip", beside, _camera_in_clip(stages)),
        DevicePicture("clip", "Clip and mount", level, _clip_on_mount(device, stages)),
        DevicePicture("adapter", "What carries the device", front, _adapter_on_mount(stages)),
    )


def view_axes(layout: Layout, viewer_in_view: Sequence[float]) -> FloatArray:
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


def _threads(stages: Stages) -> tuple[Item, ...]:
    """Parts away from each other, their inserts and nuts at the beginning of their ways in, with arrows."""
    parts = [part for part in stages.of_kind("part") if stages.threads_in([part])]
    carriers = {piece.name for piece in stages.carriers}
    items = [
        _moved(part, part.explode_mm, part.number if part.name in carriers else _big_label(part), pale=True)
        for part in parts
    ]
    for thread in stages.threads:
        home = home_of(thread, joins_of(thread)[-1], parts)
        items += _put_in(thread, home.explode_mm if home else np.zeros(3))
    return tuple(items)


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


def _seating(stages: Stages) -> tuple[Item, ...]:
    """The mirrors before their seats, or with their carriers before the holder."""
    lifted = [_lifted(piece, stages.holder) for piece in (*stages.mirrors, *stages.carriers)]
    fasteners = [
        _moved(piece, piece.explode_mm - _mean([p.explode_mm for p in stages.holder]))
        for piece in stages.carrier_screws
    ]
    return (*(_item(piece, pale=True) for piece in stages.holder), *lifted, *fasteners)


def _holder_on_mount(stages: Stages) -> tuple[Item, ...]:
    rest = [*stages.holder, *stages.carriers, *stages.mirrors, *stages.threads_in(stages.holder)]
    return _joined(rest, stages.mount, stages.holder_screws, stages.holder)


def _camera_in_clip(stages: Stages) -> tuple[Item, ...]:
    rest = [*stages.clip, *stages.threads_in(stages.clip)]
    return _joined(rest, stages.camera, stages.camera_screws, stages.clip)


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


def _lifted(piece: Piece, holder: Sequence[Piece]) -> Item:
    away = piece.explode_mm - min((part.explode_mm for part in holder), key=lambda move: _distance(move, piece))
    return _moved(piece, away, piece.name.removeprefix("mirror_") if piece.kind == "mirror" else "")


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
