"""Where each mirror's sub-image lies on the sensor, as the frames themselves show it.

What a mirror shows changes from frame to frame; the gaps between mirrors and the holder do not. The edges of the
nominal sub-images are moved to where the change ends.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from optics.calibration.detection.corners import Grey
from optics.layout import Layout
from optics.values import FloatArray

REACH_PX = 45.0  # of an edge: 2 degrees of tilt move it by 15 px, 2 mm by 32 px, on a C920
STEP_PX = 4.0  # along an edge
LEAST_CHANGE = 25.0  # grey levels between a pixel's darkest and brightest, of what a mirror shows
LEAST_SEEN = 0.5  # part of an edge's length where it must be seen
LEAST_LENGTH_PX = 40.0
TOLERANCE_PX = 1.5  # of a place to the straight line through the others


class Extremes:
    """The darkest and the brightest that each pixel was in some frames (h, w)."""

    def __init__(self) -> None:
        self.darkest: Grey | None = None
        self.brightest: Grey | None = None

    def add(self, grey: Grey) -> None:
        """Take in a frame."""
        if self.darkest is None or self.brightest is None:
            self.darkest, self.brightest = grey.copy(), grey.copy()
        else:
            np.minimum(self.darkest, grey, out=self.darkest)
            np.maximum(self.brightest, grey, out=self.brightest)

    def change(self) -> NDArray[np.float32]:
        """How much each pixel (h, w) changed, in grey levels; raises ValueError before there is a frame."""
        if self.darkest is None or self.brightest is None:
            raise ValueError("no frame was taken in, expected at least one")
        return np.asarray(cv2.subtract(self.brightest, self.darkest), dtype=np.float32)


@dataclass(frozen=True)
class Outline:
    """A sub-image as it was seen.

    `corners_px` (n, 2) are those of the polygon. `seen` (n,) tells of each edge, from a corner to the next, whether it
    was found; else it is the nominal one: off the sensor, or where another sub-image begins without a gap. `rms_px`
    (n,) is how straight a found edge is.
    """

    corners_px: FloatArray
    seen: NDArray[np.bool_]
    rms_px: FloatArray


def segment(extremes: Extremes, layout: Layout) -> list[Outline | None]:
    """The outline of each mirror's sub-image; None where fewer than two of its edges are seen.

    Edges are sought within `REACH_PX` of the nominal ones, and taken to be straight on the sensor: a webcam's lens
    bends them by about a pixel.
    """
    change = extremes.change()
    return [_outline(change, layout, index) for index in range(len(layout.mirrors))]


def _outline(change: NDArray[np.float32], layout: Layout, index: int) -> Outline | None:
    camera = layout.camera
    corners = camera.pixels_from_normalized(layout.mirrors[index].apparent.outline_normalized)
    middle = corners.mean(axis=0)
    lines, seen, rms = [], [], []
    for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        line, straight = _edge(change, start, end, middle)
        nominal = _line(start, end)
        lines.append(nominal if line is None else line)
        seen.append(line is not None)
        rms.append(straight)
    if sum(seen) < 2:
        return None
    found = []
    for number, line in enumerate(lines):
        crossing = np.cross(lines[number - 1], line)
        if abs(crossing[2]) < 1e-9:
            return None
        found.append(crossing[:2] / crossing[2])
    return Outline(np.array(found), np.array(seen), np.array(rms))


def _line(start: FloatArray, end: FloatArray) -> FloatArray:
    """The line (3,) through two pixels, n.x + d = 0 with a unit normal."""
    along = (end - start) / np.linalg.norm(end - start)
    normal = np.array([along[1], -along[0]])
    return np.array([*normal, -normal @ start])


def _edge(
    change: NDArray[np.float32], start: FloatArray, end: FloatArray, middle: FloatArray
) -> tuple[FloatArray | None, float]:
    """The line (3,) of an edge near that from start to end, and the rms of places off it; None where it is not seen."""
    length = float(np.linalg.norm(end - start))
    count = int(length / STEP_PX)
    if count < 4:
        return None, float("nan")
    along = (end - start) / length
    outward = np.array([along[1], -along[0]])
    if outward @ (middle - start) > 0:
        outward = -outward
    # Not near the ends, where the neighbouring edges are.
    places = start + along * np.linspace(0.06 * length, 0.94 * length, count)[:, None]
    depths = np.arange(-REACH_PX, REACH_PX + 0.25, 0.5)
    at = (places[:, None] + depths[:, None] * outward).astype(np.float32)
    size = np.array(change.shape[::-1], dtype=np.float32)
    on_sensor = ((at >= 0) & (at <= size - 1)).all(axis=2)
    profile = cv2.remap(change, at[..., 0], at[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    offsets = np.array([_end_of_change(p, depths) for p in np.where(on_sensor, profile, np.nan)])
    have = np.flatnonzero(np.isfinite(offsets))
    if len(have) * STEP_PX < max(LEAST_LENGTH_PX, LEAST_SEEN * 0.88 * length):
        return None, float("nan")
    # The line that most places agree on, found by all pairs of some of them.
    positions = (places - start) @ along
    some = have[:: max(len(have) // 24, 1)]
    best, votes = (0.0, 0.0), -1
    for i in some:
        for j in some:
            if positions[j] - positions[i] > 0.25 * length:
                slope = (offsets[j] - offsets[i]) / (positions[j] - positions[i])
                level = offsets[i] - slope * positions[i]
                near = np.abs(offsets[have] - slope * positions[have] - level) < TOLERANCE_PX
                if near.sum() > votes:
                    best, votes = (float(slope), float(level)), int(near.sum())
    near = np.abs(offsets[have] - best[0] * positions[have] - best[1]) < TOLERANCE_PX
    kept = have[near]
    if len(kept) * STEP_PX < max(LEAST_LENGTH_PX, LEAST_SEEN * 0.88 * length):
        return None, float("nan")
    slope, level = np.polyfit(positions[kept], offsets[kept], 1)
    rms = float(np.sqrt(np.mean((offsets[kept] - slope * positions[kept] - level) ** 2)))
    ends = [start + along * s + outward * (slope * s + level) for s in (0.0, length)]
    return _line(ends[0], ends[1]), rms


def _end_of_change(profile: FloatArray, depths: FloatArray) -> float:
    """Where a profile from inside to outside falls below half of what it is inside; NaN where it does not."""
    usable = np.isfinite(profile)
    if usable.sum() < 20:
        return float("nan")
    profile, depths = profile[usable], depths[usable]
    inside = float(np.median(profile[: max(len(profile) // 4, 8)]))
    if inside < LEAST_CHANGE:
        return float("nan")
    below = profile < 0.5 * inside
    # The first place from where it stays below for three pixels.
    run = np.convolve(below, np.ones(6), mode="valid") == 6
    if not run.any() or run[0]:
        return float("nan")
    first = int(np.argmax(run))
    before, after = profile[first - 1], profile[first]
    return float(depths[first - 1] + 0.5 * (before - 0.5 * inside) / max(before - after, 1e-6))
