"""A picture of a device: views of bodies with labels, the placement of pieces in them, and the drawing.

Pieces are in their places, possibly pale, or displaced, with arrows and lines to their seats.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import trimesh

from mirrorcam.cad.assembly.pieces import Piece
from mirrorcam.cad.guide.assembly_steps import home_of, joins_of
from mirrorcam.cad.guide.labels import CAPTION_ROOM_PX, MARGIN_PX, Label, annotate, captioned, written
from mirrorcam.cad.guide.shading import Pixels, Rgb, Screen, ShadedBody, Shot, render
from mirrorcam.cad.plan.device_names import CLIP
from mirrorcam.core.images.pictures import write_image
from mirrorcam.core.values import FloatArray

PICTURE_PX = (1400, 1050)
# Margins for the names at both sides.
MARGINS_PX = (275, 50)
# Width of a letter, and margin next to the text, for a view with labels of points.
NOTE_PX, NOTE_MARGIN_PX = 12, 50
BARE_MARGINS_PX = (60, 50)
LIGHT_RGB: Rgb = (0.94, 0.51, 0.10)
GUIDE_RGB: Rgb = (0.55, 0.62, 0.72)


@dataclass(frozen=True)
class Item:
    """A body of a picture, in rig, its label ("" for none), and a line to its place."""

    body: ShadedBody
    label: str
    line: FloatArray | None = None


@dataclass(frozen=True)
class DevicePicture:
    """A picture before it is drawn: file name, title, the viewer's axes (3, 3) in rig, bodies and rays.

    `notes` are labels of points (3,) in rig, drawn if these are visible. `caption` is written above the view. With
    `inside`, names are written on the bodies, without leaders. `below` is a further view in the same file.
    """

    name: str
    title: str
    axes: FloatArray
    items: tuple[Item, ...]
    rays: tuple[FloatArray, ...] = ()
    notes: tuple[tuple[str, FloatArray], ...] = ()
    caption: str = ""
    inside: bool = False
    below: DevicePicture | None = None

    @property
    def path(self) -> str:
        """Path below a device's folder."""
        return f"pictures/{self.name}.png"


def write_picture(folder: Path, picture: DevicePicture) -> None:
    """Draw a picture, with its views one below the other, and write it into a device's folder."""
    write_image(folder / picture.path, np.vstack([_drawn(view) for view in views_of(picture)]))


def views_of(picture: DevicePicture) -> list[DevicePicture]:
    """The views of a picture, from top to bottom."""
    return [picture, *(views_of(picture.below) if picture.below else ())]


def labels_of(view: DevicePicture) -> list[Label]:
    """The labels in a view, of bodies and of points."""
    named = [Label(index, item.label) for index, item in enumerate(view.items) if item.label]
    return [*named, *(Label(-1, text, point) for text, point in view.notes)]


def shot_of(view: DevicePicture, size_px: tuple[int, int] = PICTURE_PX) -> Shot:
    """A rendered view, without its labels."""
    points = np.concatenate([*(item.body.triangles.reshape(-1, 3) for item in view.items), *view.rays])
    margins = MARGINS_PX if labels_of(view) and not view.inside else BARE_MARGINS_PX
    if view.notes and not view.inside:
        longest = max(len(label.text) for label in labels_of(view))
        margins = (max(margins[0], NOTE_MARGIN_PX + NOTE_PX * longest), margins[1])
    if view.caption:
        margins = (margins[0], max(margins[1], CAPTION_ROOM_PX))
    screen = Screen.around(points, view.axes, size_px, margins)
    lines: list[tuple[FloatArray, Rgb, float]] = [
        (item.line, GUIDE_RGB, 1.5) for item in view.items if item.line is not None
    ]
    lines += [(ray, LIGHT_RGB, 2.0) for ray in view.rays]
    return render([item.body for item in view.items], screen, lines)


def _drawn(view: DevicePicture) -> Pixels:
    shot, labels = shot_of(view), labels_of(view)
    if view.inside:
        return captioned(written(shot, labels), view.caption)
    return captioned(annotate(shot, labels, CAPTION_ROOM_PX if view.caption else MARGIN_PX), view.caption)


PALE = 0.55
# Displacement of new pieces in the picture of a step, as a share of that in the exploded view.
STEP_SHARE = 0.8
# Length and radius of an arrow's head towards a seat, and its distance from the inserted piece.
ARROW_MM, ARROW_RADIUS_MM, ARROW_BEFORE_MM = 6.0, 2.2, 3.5
ARROW_RGB: Rgb = (0.86, 0.16, 0.12)
# Distance of mirrors drawn in front of their seats.
MIRROR_LIFT_MM = 30.0


def still(piece: Piece, label: str = "", *, pale: bool = False) -> Item:
    """A piece in its place."""
    rgb = piece.rgb
    if pale and piece.kind != "mirror":
        red, green, blue = (PALE * 0.93 + (1.0 - PALE) * channel for channel in rgb)
        rgb = (red, green, blue)
    return Item(ShadedBody(triangles_of(piece), rgb, shine=piece.kind == "mirror"), label)


def moved(
    piece: Piece, away: FloatArray, label: str = "", *, pale: bool = False, seat: FloatArray | None = None
) -> Item:
    """A piece displaced by `away` (3,) mm, with a line to its place, which is displaced by `seat` (3,), if given."""
    here = still(piece, label, pale=pale)
    centre = np.asarray(piece.mesh.bounds).mean(axis=0)
    path = None if seat is None else np.array([centre + seat, centre + away])
    return Item(ShadedBody(here.body.triangles + away, here.body.rgb, here.body.shine), label, path)


def name_of(piece: Piece) -> str:
    """Number and title of a part or the camera; "" for other pieces."""
    return f"{piece.number} {piece.title}".strip() if piece.kind in ("part", "camera") else ""


def triangles_of(piece: Piece) -> FloatArray:
    """The piece's mesh as triangles (n, 3, 3) in rig, mm."""
    return np.asarray(piece.mesh.triangles, dtype=np.float64)


def mean(vectors: Sequence[FloatArray]) -> FloatArray:
    """The mean (3,) of vectors; 0 if there are none."""
    return np.mean(vectors, axis=0) if vectors else np.zeros(3)


def put_in(thread: Piece, seat: FloatArray) -> tuple[Item, Item]:
    """An insert or a nut outside its part, which is displaced by `seat` (3,) mm, with its path and an arrow."""
    places = seat + places_out(thread)
    drawn = moved(thread, places[-1])
    inwards = places[-2] - places[-1]
    inwards /= np.linalg.norm(inwards)
    centre = np.asarray(thread.mesh.bounds).mean(axis=0)
    head = arrow_head(centre + places[-1] + ARROW_BEFORE_MM * inwards, inwards)
    return replace(drawn, line=centre + places), Item(head, "")


def places_out(thread: Piece) -> FloatArray:
    """Displacements (n, 3) of an insert or a nut along its exit moves, starting at its seat, mm."""
    moves = thread.item.exit_moves_mm if thread.item else np.zeros((0, 3))
    return np.concatenate([np.zeros((1, 3)), np.cumsum(moves, axis=0)])


def arrow_head(at: FloatArray, direction: FloatArray) -> ShadedBody:
    """A cone at a point (3,) along a unit vector (3,)."""
    cone = trimesh.creation.cone(ARROW_RADIUS_MM, ARROW_MM, sections=24)
    cone.apply_transform(trimesh.geometry.align_vectors(np.array([0.0, 0.0, 1.0]), direction))
    return ShadedBody(np.asarray(cone.triangles, dtype=np.float64) + at, ARROW_RGB)


def joined(
    rest: Sequence[Piece],
    new: Sequence[Piece],
    fasteners: Sequence[Piece],
    resting: Sequence[Piece],
    together: Sequence[Piece] = (),
) -> tuple[Item, ...]:
    """Pieces already assembled, pale, and new pieces, displaced as in an exploded view in which `resting` stays.

    New pieces move by the mean displacement of `together`, if given.
    """
    base = mean([piece.explode_mm for piece in resting])
    block = mean([piece.explode_mm for piece in together]) - base if together else None
    moves = [(piece, STEP_SHARE * (piece.explode_mm - base if block is None else block)) for piece in new]
    moves += [(piece, STEP_SHARE * (piece.explode_mm - base)) for piece in fasteners]
    return (*(still(piece, name_of(piece), pale=True) for piece in rest), *placed(moves))


def placed(moves: Sequence[tuple[Piece, FloatArray]]) -> tuple[Item, ...]:
    """Displaced pieces; fasteners and the camera have a line to their displaced place."""
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
            items += put_in(piece, seat)
            continue
        items.append(moved(piece, move, name_of(piece), seat=seat))
    return tuple(items)


def lifted(piece: Piece, holder: Sequence[Piece], normal: FloatArray) -> Item:
    """A mirror lifted towards the viewer, or a carrier between it and the holder."""
    if piece.kind == "mirror":
        return moved(piece, MIRROR_LIFT_MM * normal, piece.name.removeprefix("mirror_"))
    nearest = min((part.explode_mm for part in holder), key=lambda move: _distance(move, piece))
    away = float(np.linalg.norm(piece.explode_mm - nearest))
    return moved(piece, min(away, MIRROR_LIFT_MM / 2.0) * normal)


def _distance(move: FloatArray, piece: Piece) -> float:
    return float(np.linalg.norm(piece.explode_mm - move))
