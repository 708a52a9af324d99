"""A picture of a device: views of bodies with labels, and the placement of components in the views.

Pieces are drawn in place, possibly pale, or displaced, with arrows and lines to their seats.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import trimesh

from mirrorcam.cad.assembly.components import Component
from mirrorcam.cad.guide.assembly_steps import home_of, joins_of
from mirrorcam.cad.guide.labels import CAPTION_ROOM_PX, MARGIN_PX, Label, annotate, with_caption, with_names_on_bodies
from mirrorcam.cad.guide.shading import Pixels, Rendering, Rgb, Screen, ShadedBody, render
from mirrorcam.cad.plan.device_names import CLIP
from mirrorcam.core.images.pictures import write_image
from mirrorcam.core.values import FloatArray

PICTURE_PX, CLOSE_UP_PX = (1400, 1050), (800, 560)
# Horizontal and vertical margins, the former for labels on both sides.
MARGINS_PX = (275, 50)
# Width of a letter, and margin next to the text, for labels of points.
LETTER_PX, LABEL_MARGIN_PX = 12, 50
BARE_MARGINS_PX, CLOSE_UP_MARGINS_PX = (60, 50), (120, 90)
LIGHT_RGB: Rgb = (0.94, 0.51, 0.10)
GUIDE_RGB: Rgb = (0.55, 0.62, 0.72)


@dataclass(frozen=True)
class Item:
    """A body of a picture in the rig frame, mm, its label ("" for none), and a line (n, 3) to its seat."""

    body: ShadedBody
    label: str
    line: FloatArray | None = None


@dataclass(frozen=True)
class DevicePicture:
    """A picture before rendering: file name, title, the viewer's axes (3, 3) in the rig frame, bodies and rays.

    `notes` are labels of points (3,) in the rig frame, drawn if these are visible. `caption` is printed above the view.
    With `labels_on_bodies`, labels have no leaders. `lower` is a further view in the same file, below this one. The
    view shows the points `focus` (n, 3); without them, all bodies and rays.
    """

    name: str
    title: str
    axes: FloatArray
    items: tuple[Item, ...]
    rays: tuple[FloatArray, ...] = ()
    notes: tuple[tuple[str, FloatArray], ...] = ()
    caption: str = ""
    labels_on_bodies: bool = False
    lower: DevicePicture | None = None
    focus: FloatArray | None = None
    size_px: tuple[int, int] = PICTURE_PX

    @property
    def path(self) -> str:
        """Path below a device's folder."""
        return f"pictures/{self.name}.png"


def view_axes(level_from_rig: FloatArray, viewer_in_level: Sequence[float] | FloatArray) -> FloatArray:
    """Rows right, up and towards the viewer (3, 3) in the rig frame, with up as the device stands.

    `level_from_rig` (3, 3) has the rows right, down and forward; so has the direction (3,) to the viewer.
    """
    towards = level_from_rig.T @ np.asarray(viewer_in_level, dtype=np.float64)
    towards /= np.linalg.norm(towards)
    up = -level_from_rig[1]
    up = up - (up @ towards) * towards
    up /= np.linalg.norm(up)
    return np.array([np.cross(up, towards), up, towards])


def axes_towards(level_from_rig: FloatArray, viewer_in_rig: FloatArray) -> FloatArray:
    """`view_axes` for a direction (3,) in the rig frame."""
    return view_axes(level_from_rig, level_from_rig @ viewer_in_rig)


def write_picture(folder: Path, picture: DevicePicture) -> None:
    """Render a picture, its views one below the other, and write it into a device's folder."""
    write_image(folder / picture.path, np.vstack([_drawn(view) for view in views_of(picture)]))


def views_of(picture: DevicePicture) -> list[DevicePicture]:
    """The views of a picture, from top to bottom."""
    return [picture, *(views_of(picture.lower) if picture.lower else ())]


def labels_of(view: DevicePicture) -> list[Label]:
    """The labels in a view, of bodies and of points."""
    named = [Label(index, item.label) for index, item in enumerate(view.items) if item.label]
    return [*named, *(Label(-1, text, point) for text, point in view.notes)]


def rendering_of(view: DevicePicture) -> Rendering:
    """A rendered view, without its labels."""
    points = view.focus
    if points is None:
        points = np.concatenate([*(item.body.triangles.reshape(-1, 3) for item in view.items), *view.rays])
    margins = MARGINS_PX if labels_of(view) and not view.labels_on_bodies else BARE_MARGINS_PX
    if view.notes and not view.labels_on_bodies:
        longest = max(len(label.text) for label in labels_of(view))
        margins = (max(margins[0], LABEL_MARGIN_PX + LETTER_PX * longest), margins[1])
    if view.focus is not None:
        margins = CLOSE_UP_MARGINS_PX
    if view.caption:
        margins = (margins[0], max(margins[1], CAPTION_ROOM_PX))
    screen = Screen.around(points, view.axes, view.size_px, margins)
    lines: list[tuple[FloatArray, Rgb, float]] = [
        (item.line, GUIDE_RGB, 1.5) for item in view.items if item.line is not None
    ]
    lines += [(ray, LIGHT_RGB, 2.0) for ray in view.rays]
    return render([item.body for item in view.items], screen, lines)


def _drawn(view: DevicePicture) -> Pixels:
    rendering, labels = rendering_of(view), labels_of(view)
    if view.labels_on_bodies:
        return with_caption(with_names_on_bodies(rendering, labels), view.caption)
    return with_caption(annotate(rendering, labels, CAPTION_ROOM_PX if view.caption else MARGIN_PX), view.caption)


# Weight of light grey in the colours of pale components.
PALE = 0.55
# Ratio of the displacement of new components in the picture of a step to that in the exploded view.
STEP_RATIO = 0.8
# Length and radius of the head of an arrow towards a seat, and its distance from the component.
ARROW_MM, ARROW_RADIUS_MM, ARROW_GAP_MM = 6.0, 2.2, 3.5
ARROW_RGB: Rgb = (0.86, 0.16, 0.12)
# Distance of mirrors drawn in front of their seats.
MIRROR_LIFT_MM = 30.0


def in_place(component: Component, label: str = "", *, pale: bool = False) -> Item:
    """A component in its assembled position."""
    rgb = component.rgb
    if pale and component.kind != "mirror":
        red, green, blue = (PALE * 0.93 + (1.0 - PALE) * channel for channel in rgb)
        rgb = (red, green, blue)
    return Item(ShadedBody(triangles_of(component), rgb, shine=component.kind == "mirror"), label)


def displaced(
    component: Component, shift: FloatArray, label: str = "", *, pale: bool = False, seat: FloatArray | None = None
) -> Item:
    """A component displaced by `shift` (3,) mm; with `seat` (3,), a line leads to its seat, displaced by `seat`."""
    item = in_place(component, label, pale=pale)
    centre = np.asarray(component.mesh.bounds).mean(axis=0)
    line = None if seat is None else np.array([centre + seat, centre + shift])
    return Item(ShadedBody(item.body.triangles + shift, item.body.rgb, item.body.shine), label, line)


def name_of(component: Component) -> str:
    """Number and title of a part or the camera; "" for other components."""
    return f"{component.number} {component.title}".strip() if component.kind in ("part", "camera") else ""


def triangles_of(component: Component) -> FloatArray:
    """The component's mesh as triangles (n, 3, 3) in the rig frame, mm."""
    return np.asarray(component.mesh.triangles, dtype=np.float64)


def mean(vectors: Sequence[FloatArray]) -> FloatArray:
    """The mean (3,) of vectors; 0 if there are none."""
    return np.mean(vectors, axis=0) if vectors else np.zeros(3)


def inserted(component: Component, seat: FloatArray) -> tuple[Item, Item]:
    """An insert or a nut outside its part, with its path and an arrow; the part is displaced by `seat` (3,) mm."""
    path = seat + exit_path(component)
    body = displaced(component, path[-1])
    inwards = path[-2] - path[-1]
    inwards /= np.linalg.norm(inwards)
    centre = np.asarray(component.mesh.bounds).mean(axis=0)
    head = arrow_head(centre + path[-1] + ARROW_GAP_MM * inwards, inwards)
    return replace(body, line=centre + path), Item(head, "")


def exit_path(component: Component) -> FloatArray:
    """Displacements (n, 3), mm, of an insert or a nut along its exit moves, from its seat."""
    moves = component.item.exit_moves_mm if component.item else np.zeros((0, 3))
    return np.concatenate([np.zeros((1, 3)), np.cumsum(moves, axis=0)])


def arrow_head(position: FloatArray, direction: FloatArray) -> ShadedBody:
    """A cone at a position (3,) along a unit vector (3,)."""
    cone = trimesh.creation.cone(ARROW_RADIUS_MM, ARROW_MM, sections=24)
    cone.apply_transform(trimesh.geometry.align_vectors(np.array([0.0, 0.0, 1.0]), direction))
    return ShadedBody(np.asarray(cone.triangles, dtype=np.float64) + position, ARROW_RGB)


def assembled(
    existing: Sequence[Component],
    new: Sequence[Component],
    fasteners: Sequence[Component],
    fixed: Sequence[Component],
    moved_with: Sequence[Component] = (),
) -> tuple[Item, ...]:
    """Existing components, pale, and new ones, displaced as in an exploded view in which the `fixed` ones stay.

    With `moved_with`, all new components have the mean displacement of those components.
    """
    base = mean([component.explode_mm for component in fixed])
    common = mean([component.explode_mm for component in moved_with]) - base if moved_with else None
    moves = [(component, STEP_RATIO * (component.explode_mm - base if common is None else common)) for component in new]
    moves += [(component, STEP_RATIO * (component.explode_mm - base)) for component in fasteners]
    return (*(in_place(component, name_of(component), pale=True) for component in existing), *exploded_items(moves))


def exploded_items(moves: Sequence[tuple[Component, FloatArray]]) -> tuple[Item, ...]:
    """Displaced components; fasteners and the camera have a line to their seats, which are displaced with their
    parts."""
    parts = {component.name: component for component, _ in moves if component.kind == "part"}
    move_of = {component.name: move for component, move in moves}
    items: list[Item] = []
    for component, move in moves:
        joins = (CLIP,) if component.kind == "camera" else joins_of(component)
        candidates = [
            home_of(component, name, parts.values())
            for name in (joins if component.kind in ("screw", "washer") else joins[::-1])
        ]
        home = next((home for home in candidates if home), None)
        seat = move_of[home.name] if home else np.zeros(3) if joins else None
        if seat is not None and component.kind in ("insert", "nut"):
            items += inserted(component, seat)
            continue
        items.append(displaced(component, move, name_of(component), seat=seat))
    return tuple(items)


def lifted(component: Component, holder: Sequence[Component], normal: FloatArray) -> Item:
    """A mirror lifted towards the viewer, or a carrier between it and the holder."""
    if component.kind == "mirror":
        return displaced(component, MIRROR_LIFT_MM * normal, component.name.removeprefix("mirror_"))
    nearest_move = min((part.explode_mm for part in holder), key=lambda move: _distance(move, component))
    distance = float(np.linalg.norm(component.explode_mm - nearest_move))
    return displaced(component, min(distance, MIRROR_LIFT_MM / 2.0) * normal)


def _distance(move: FloatArray, component: Component) -> float:
    return float(np.linalg.norm(component.explode_mm - move))
