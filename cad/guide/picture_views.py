"""A picture of a device as views of bodies with names of bodies and points, and how it is drawn."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mirrorcam.cad.guide.labels import CAPTION_ROOM_PX, MARGIN_PX, Label, annotate, captioned, written
from mirrorcam.cad.guide.shading import Pixels, Rgb, Screen, ShadedBody, Shot, render
from mirrorcam.core.images.pictures import write_image
from mirrorcam.core.values import FloatArray

PICTURE_PX = (1400, 1050)
# Margin for the names at both sides.
MARGINS_PX = (275, 50)
# For a view that names points: of a letter, and beside the text.
NOTE_PX, NOTE_MARGIN_PX = 12, 50
BARE_MARGINS_PX = (60, 50)
LIGHT_RGB: Rgb = (0.94, 0.51, 0.10)
GUIDE_RGB: Rgb = (0.55, 0.62, 0.72)


@dataclass(frozen=True)
class Item:
    """A body of a picture, in rig, its label ("" for none), and a line to where it belongs."""

    body: ShadedBody
    label: str
    line: FloatArray | None = None


@dataclass(frozen=True)
class DevicePicture:
    """A picture before it is drawn: file stem, title, the viewer's axes (3, 3) in rig, bodies, rays.

    `notes` name points (3,) in rig where these are seen; `caption` is written above the view; with `inside`, names are
    written where what they name is, without leaders; `below` is a further view in the same file.
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
    """Draw a picture, all its views one below the other, and write it below a device's folder."""
    write_image(folder / picture.path, np.vstack([_drawn(view) for view in views_of(picture)]))


def views_of(picture: DevicePicture) -> list[DevicePicture]:
    """The views of a picture, the upper first."""
    return [picture, *(views_of(picture.below) if picture.below else ())]


def labels_of(view: DevicePicture) -> list[Label]:
    """The names in a view, of bodies and of points."""
    named = [Label(index, item.label) for index, item in enumerate(view.items) if item.label]
    return [*named, *(Label(-1, text, point) for text, point in view.notes)]


def shot_of(view: DevicePicture, size_px: tuple[int, int] = PICTURE_PX) -> Shot:
    """A view as it is rendered, without its names."""
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
