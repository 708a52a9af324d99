"""Corners of AprilGrids linked into grids: their squares are wide, which are tags, and narrow by turns.

An AprilGrid is a checkerboard whose columns and rows are as wide as a gap and a tag by turns. Which of them are tags is
seen from their widths, so that corners get places on the print but for whole tags, and a smooth map takes them there.
"""

from __future__ import annotations

import numpy as np

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.detection.checkerboard import Grey, smooth_parts
from mirrorcam.optics.calibration.detection.corner_grids import corner_grids
from mirrorcam.optics.calibration.detection.saddle_points import saddle_points
from mirrorcam.optics.calibration.solver.observations import IntArray
from mirrorcam.optics.geometry.targets import AprilGrid

MIN_RATIO = 0.5  # of the logarithm of a tag's side by a gap, in the picture by on the print


def linked_tags(grey: Grey, target: AprilGrid) -> list[tuple[IntArray, FloatArray]]:
    """Places (n, 2) of corners on grids of their own, and their approximate pixels (n, 2).

    The places are those of `corner_grids`; tags begin at odd x and at even y.
    """
    points = saddle_points(grey)
    found = []
    for members, places in corner_grids(points, by_turns=True):
        placed = _tags_placed(places, points.pixels[members], target)
        if placed is None:
            continue
        # Lines of corners on a print whose first tag begins at (1, 0).
        on_print = target.line_mm(placed - np.array([1, 0])) / target.pitch_mm
        parts = smooth_parts(on_print, points.pixels[members], target.longest_step)
        found += [(placed[part], points.pixels[members[part]]) for part in parts]
    return found


def _tags_placed(places: IntArray, pixels: FloatArray, target: AprilGrid) -> IntArray | None:
    """The places, moved so that tags begin at odd x and at even y; None where they are not wide and narrow by turns."""
    order = {(x, y): number for number, (x, y) in enumerate(places.tolist())}
    ratios = []
    for axis, wide in ((0, 1), (1, 0)):
        step = np.eye(2, dtype=np.int64)[axis]
        sides: tuple[list[float], list[float]] = ([], [])
        for (x, y), number in order.items():
            after = order.get((x + int(step[0]), y + int(step[1])))
            if after is not None:
                length = float(np.linalg.norm(pixels[after] - pixels[number]))
                sides[((x, y)[axis] + wide) % 2].append(np.log(max(length, 1e-6)))
        if sides[0] and sides[1]:
            ratios.append(float(np.median(sides[0]) - np.median(sides[1])))
    if not ratios or abs(np.mean(ratios)) < MIN_RATIO * -np.log(target.spacing):
        return None
    return places if np.mean(ratios) > 0 else places + 1
