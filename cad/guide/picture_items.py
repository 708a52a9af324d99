"""Pieces of a device in a picture: in their places or away from them, pale, with arrows and lines to their seats."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import trimesh

from mirrorcam.cad.assembly.pieces import Piece
from mirrorcam.cad.guide.assembly_steps import home_of, joins_of
from mirrorcam.cad.guide.picture_views import Item
from mirrorcam.cad.guide.shading import Rgb, ShadedBody
from mirrorcam.cad.plan.device_names import CLIP
from mirrorcam.core.values import FloatArray

PALE = 0.55
# In the picture of a step what is new stands off by this share of its way in the exploded view.
STEP_SHARE = 0.8
# The head of an arrow, from what is put in towards where it goes: its length, its radius, and how far before it.
ARROW_MM, ARROW_RADIUS_MM, ARROW_BEFORE_MM = 6.0, 2.2, 3.5
ARROW_RGB: Rgb = (0.86, 0.16, 0.12)
# How far mirrors are drawn before their seats.
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
    """A piece drawn `away` (3,) mm from its place, with a line from where that is drawn, `seat` (3,), if given."""
    here = still(piece, label, pale=pale)
    centre = np.asarray(piece.mesh.bounds).mean(axis=0)
    path = None if seat is None else np.array([centre + seat, centre + away])
    return Item(ShadedBody(here.body.triangles + away, here.body.rgb, here.body.shine), label, path)


def name_of(piece: Piece) -> str:
    """Number and title of a part or the camera; "" of anything smaller."""
    return f"{piece.number} {piece.title}".strip() if piece.kind in ("part", "camera") else ""


def triangles_of(piece: Piece) -> FloatArray:
    """The piece's mesh as triangles (n, 3, 3) in rig, mm."""
    return np.asarray(piece.mesh.triangles, dtype=np.float64)


def mean(vectors: Sequence[FloatArray]) -> FloatArray:
    """The mean (3,) of vectors; 0 of none."""
    return np.mean(vectors, axis=0) if vectors else np.zeros(3)


def put_in(thread: Piece, seat: FloatArray) -> tuple[Item, Item]:
    """An insert or a nut outside of its part, which is drawn `seat` (3,) mm away, its way in, and an arrow along it."""
    places = seat + places_out(thread)
    drawn = moved(thread, places[-1])
    inwards = places[-2] - places[-1]
    inwards /= np.linalg.norm(inwards)
    centre = np.asarray(thread.mesh.bounds).mean(axis=0)
    head = arrow_head(centre + places[-1] + ARROW_BEFORE_MM * inwards, inwards)
    return replace(drawn, line=centre + places), Item(head, "")


def places_out(thread: Piece) -> FloatArray:
    """Where an insert or a nut is on its way out of its seat (n, 3), from its seat on, mm."""
    moves = thread.item.way_out_mm if thread.item else np.zeros((0, 3))
    return np.concatenate([np.zeros((1, 3)), np.cumsum(moves, axis=0)])


def arrow_head(at: FloatArray, way: FloatArray) -> ShadedBody:
    """A cone from a point (3,) along a unit vector (3,)."""
    cone = trimesh.creation.cone(ARROW_RADIUS_MM, ARROW_MM, sections=24)
    cone.apply_transform(trimesh.geometry.align_vectors(np.array([0.0, 0.0, 1.0]), way))
    return ShadedBody(np.asarray(cone.triangles, dtype=np.float64) + at, ARROW_RGB)


def joined(
    rest: Sequence[Piece],
    new: Sequence[Piece],
    fasteners: Sequence[Piece],
    resting: Sequence[Piece],
    together: Sequence[Piece] = (),
) -> tuple[Item, ...]:
    """Pieces already assembled, pale, and new ones, moved away as in the exploded view in which `resting` rests."""
    base = mean([piece.explode_mm for piece in resting])
    block = mean([piece.explode_mm for piece in together]) - base if together else None
    moves = [(piece, STEP_SHARE * (piece.explode_mm - base if block is None else block)) for piece in new]
    moves += [(piece, STEP_SHARE * (piece.explode_mm - base)) for piece in fasteners]
    return (*(still(piece, name_of(piece), pale=True) for piece in rest), *placed(moves))


def placed(moves: Sequence[tuple[Piece, FloatArray]]) -> tuple[Item, ...]:
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
            items += put_in(piece, seat)
            continue
        items.append(moved(piece, move, name_of(piece), seat=seat))
    return tuple(items)


def lifted(piece: Piece, holder: Sequence[Piece], normal: FloatArray) -> Item:
    """A mirror lifted along the viewer's way, or a carrier between it and the holder."""
    if piece.kind == "mirror":
        return moved(piece, MIRROR_LIFT_MM * normal, piece.name.removeprefix("mirror_"))
    nearest = min((part.explode_mm for part in holder), key=lambda move: _distance(move, piece))
    away = float(np.linalg.norm(piece.explode_mm - nearest))
    return moved(piece, min(away, MIRROR_LIFT_MM / 2.0) * normal)


def _distance(move: FloatArray, piece: Piece) -> float:
    return float(np.linalg.norm(piece.explode_mm - move))
