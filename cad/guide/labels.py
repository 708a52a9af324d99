"""Labels around a picture, each with a leader to the body or point that it names; leaders do not cross."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import cv2
import numpy as np
from numpy.typing import NDArray

from mirrorcam.cad.guide.shading import Pixels, Rendering
from mirrorcam.core.values import FloatArray

INK = (28, 33, 45)
SOFT = (104, 112, 128)
TEXT_PX = 22
MIN_TEXT_PX = 15
LINE_SPACING = 1.9
MARGIN_PX = 26
SUBPIXEL_BITS = 4
# Distance by which a surface must be in front of a point to hide it.
HIDDEN_MM = 1.0
# Regular font weight: OpenCV's default is the weight of the last text drawn in the process.
WEIGHT = 400
CAPTION_PX, BOLD = 26, 700
CAPTION_ROOM_PX = MARGIN_PX + TEXT_PX + 16
"""Height of the space for a caption at the upper edge of a picture."""


@dataclass(frozen=True)
class Label:
    """A label for the body with an index, or for a `point` (3,) in the rig frame on it (`body` -1: on any body)."""

    body: int
    text: str
    point: FloatArray | None = None


@dataclass(frozen=True)
class _Leader:
    start: FloatArray
    end: FloatArray

    def crosses(self, other: _Leader) -> bool:
        def side(a: FloatArray, b: FloatArray, c: FloatArray) -> float:
            return float((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))

        return (
            side(self.start, self.end, other.start) * side(self.start, self.end, other.end) < 0.0
            and side(other.start, other.end, self.start) * side(other.start, other.end, self.end) < 0.0
        )


def innermost_pixel(mask: NDArray[np.bool_]) -> tuple[FloatArray, float] | None:
    """The pixel (column, row) of a mask (h, w) farthest from its border, and that distance in px; None if empty."""
    if not mask.any():
        return None
    distance = cv2.distanceTransform(np.pad(mask.astype(np.uint8), 1), cv2.DIST_L2, 3)[1:-1, 1:-1]
    row, column = np.unravel_index(int(distance.argmax()), distance.shape)
    return np.array([column, row], dtype=np.float64), float(distance[row, column])


def innermost_body_pixel(rendering: Rendering, body: int) -> FloatArray | None:
    """The innermost pixel (column, row) of the visible part of a body; None if the body is hidden."""
    innermost = innermost_pixel(rendering.bodies == body)
    return innermost[0] if innermost else None


def pixel_of(rendering: Rendering, label: Label) -> FloatArray | None:
    """The pixel (column, row) that a label names; None if it is hidden or outside the picture.

    A point of a body gives the nearest visible pixel of the body.
    """
    if label.point is None:
        return innermost_body_pixel(rendering, label.body)
    column, row, z = rendering.screen.pixels(label.point)
    if label.body >= 0:
        rows, columns = np.nonzero(rendering.bodies == label.body)
        if not len(rows):
            return None
        nearest = int(np.argmin((columns - column) ** 2 + (rows - row) ** 2))
        return np.array([columns[nearest], rows[nearest]], dtype=np.float64)
    height, width = rendering.bodies.shape
    if not (0 <= column < width and 0 <= row < height):
        return None
    hidden = rendering.bodies[int(row), int(column)] >= 0 and rendering.z_mm[int(row), int(column)] > z + HIDDEN_MM
    return None if hidden else np.array([column, row])


def annotate(rendering: Rendering, labels: Sequence[Label], top_px: int = MARGIN_PX) -> Pixels:
    """The picture with names in columns at its left and right sides, from `top_px` down; hidden bodies have none."""
    visible = [(label, point) for label in labels if (point := pixel_of(rendering, label)) is not None]
    image = rendering.image.copy()
    height, width = image.shape[:2]
    # Split into a left and a right half, so that leaders to the left and to the right never meet.
    visible.sort(key=lambda item: (item[1][0], item[1][1], item[0].text))
    n_left = (len(visible) + 1) // 2
    rows = max(n_left, len(visible) - n_left)
    size = int(min(TEXT_PX, max(MIN_TEXT_PX, (height - 2 * MARGIN_PX) / max(rows, 1) / LINE_SPACING)))
    font = cv2.FontFace("sans")
    for left, group in ((True, visible[:n_left]), (False, visible[n_left:])):
        group = sorted(group, key=lambda item: (item[1][1], item[0].text))
        levels = rows_near([float(point[1]) for _, point in group], size * LINE_SPACING, top_px, height - MARGIN_PX)
        boxes = [cv2.getTextSize((width, height), label.text, (0, 0), font, size, WEIGHT) for label, _ in group]
        starts = [
            np.array([MARGIN_PX + box[2] + 8.0 if left else width - MARGIN_PX - box[2] - 8.0, y])
            for box, y in zip(boxes, levels, strict=True)
        ]
        order = uncrossed_order(starts, [point for _, point in group])
        # A name keeps its width when it changes rows.
        for y, index in zip(levels, order, strict=True):
            label, point = group[index]
            box = boxes[index]
            x = MARGIN_PX if left else width - MARGIN_PX - box[2]
            start = np.array([x + box[2] + 8.0 if left else x - 8.0, y])
            _leader(image, start, point)
            # A white background keeps a long name legible over the picture.
            background = ((int(x) - 4, int(y - 0.6 * size)), (int(x + box[2]) + 4, int(y + 0.6 * size)))
            cv2.rectangle(image, *background, (255, 255, 255), -1)
            cv2.putText(image, label.text, (int(x), int(y + 0.36 * size)), INK, font, size, WEIGHT)
    return image


def with_names_on_bodies(rendering: Rendering, labels: Sequence[Label]) -> Pixels:
    """The picture with each name at the centre of its body, on white; hidden bodies have none."""
    image = rendering.image.copy()
    height, width = image.shape[:2]
    font = cv2.FontFace("sans")
    for label in labels:
        if (point := pixel_of(rendering, label)) is None:
            continue
        box = cv2.getTextSize((width, height), label.text, (0, 0), font, TEXT_PX, WEIGHT)
        x, y = int(point[0] - box[2] / 2.0), int(point[1])
        background = ((x - 6, int(y - 0.7 * TEXT_PX)), (x + box[2] + 6, int(y + 0.7 * TEXT_PX)))
        cv2.rectangle(image, *background, (255, 255, 255), -1)
        cv2.putText(image, label.text, (x, int(y + 0.36 * TEXT_PX)), INK, font, TEXT_PX, WEIGHT)
    return image


def with_caption(image: Pixels, caption: str) -> Pixels:
    """The picture with a caption at its upper left, if any, on white."""
    if not caption:
        return image
    captioned, font = image.copy(), cv2.FontFace("sans")
    height, width = image.shape[:2]
    box = cv2.getTextSize((width, height), caption, (0, 0), font, CAPTION_PX, BOLD)
    cv2.rectangle(captioned, (0, 0), (int(MARGIN_PX + box[2]) + 12, CAPTION_ROOM_PX), (255, 255, 255), -1)
    cv2.putText(captioned, caption, (MARGIN_PX, MARGIN_PX + TEXT_PX), INK, font, CAPTION_PX, BOLD)
    return captioned


def uncrossed_order(starts: Sequence[FloatArray], ends: Sequence[FloatArray]) -> list[int]:
    """Index of an end for each start, so that no two lines cross: swapping ends of crossing lines shortens them."""
    order = list(range(len(starts)))
    swapped = True
    while swapped:
        swapped = False
        for i, j in combinations(range(len(order)), 2):
            if _Leader(starts[i], ends[order[i]]).crosses(_Leader(starts[j], ends[order[j]])):
                order[i], order[j] = order[j], order[i]
                swapped = True
    return order


def rows_near(preferred: Sequence[float], pitch: float, top: float, bottom: float) -> list[float]:
    """Coordinates near the preferred ones (ascending), at least a pitch apart, and half a pitch inside a range."""
    low, high = top + pitch / 2.0, bottom - pitch / 2.0
    rows: list[float] = []
    for value in preferred:
        rows.append(max(value, low if not rows else rows[-1] + pitch))
    limit = high
    for index in reversed(range(len(rows))):
        rows[index] = min(rows[index], limit)
        limit = rows[index] - pitch
    return rows


def _leader(image: Pixels, start: FloatArray, end: FloatArray) -> None:
    scale = 1 << SUBPIXEL_BITS
    tail, tip = ([round(float(value) * scale) for value in point] for point in (start, end))
    cv2.line(image, tail, tip, (255, 255, 255), 4, cv2.LINE_AA, SUBPIXEL_BITS)
    cv2.line(image, tail, tip, SOFT, 1, cv2.LINE_AA, SUBPIXEL_BITS)
    cv2.circle(image, tip, 5 * scale, (255, 255, 255), -1, cv2.LINE_AA, SUBPIXEL_BITS)
    cv2.circle(image, tip, 4 * scale, INK, -1, cv2.LINE_AA, SUBPIXEL_BITS)
