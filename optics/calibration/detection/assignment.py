"""Assignment of the boards detected in a frame to mirrors, and of numberings to plain boards."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from scipy.optimize import linear_sum_assignment

from mirrorcam.optics.base.values import FloatArray
from mirrorcam.optics.calibration.solver import initial_estimates
from mirrorcam.optics.calibration.solver.observations import Corners
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.targets import Target
from mirrorcam.optics.geometry.transforms import transform

MIN_INSIDE = 0.5  # fraction of a board's corners inside a mirror's sub-image, to belong to the mirror
MAX_OFFSET = 0.7  # of a sub-image's size, between a board and its prediction by another view's pose


@dataclass(frozen=True)
class _PossibleMirror:
    """A mirror that may show a board, with one of the board's numberings and the pose (4, 4) that follows."""

    mirror: int
    corners: Corners
    inside: float
    rig_from_board: FloatArray


def assign(
    boards: Sequence[tuple[Corners, ...]],
    layout: Layout,
    target: Target,
) -> list[tuple[int, Corners]]:
    """Assign detected boards to mirrors.

    A board belongs to the mirror whose sub-image holds most of it, and by the nominal layout its pose must be about
    that of the largest board of the frame: a mirror tilted by 2 degrees moves its image by a tenth of a frame, while
    the neighbouring mirror shows the board half a frame away. Turning a plain board upside down in all views at once
    changes nothing, so the largest board decides.

    Parameters
    ----------
    boards
        Each board in its possible numberings: one, or two for a plain board that looks the same upside down.
    layout
        The nominal layout.
    target
        The board.

    Returns
    -------
    list of (mirror index, Corners)
        In the order of the mirrors; boards that belong to no mirror are left out.
    """
    outlines = [layout.outline_px(index) for index in range(len(layout.mirrors))]
    regions = [shapely.Polygon(outline[np.isfinite(outline).all(axis=1)]) for outline in outlines]
    shapely.prepare(regions)
    sizes_px = np.array([np.sqrt(region.area) for region in regions])
    places = [_places(board, regions, layout, target) for board in boards]
    certain = [options for options in places if options]
    if not certain:
        return []
    first = max(certain, key=lambda options: options[0].inside * len(options[0].corners))[0]
    points = transform(first.rig_from_board, target.corners_in_board_mm)
    gains = np.zeros((len(boards), len(layout.mirrors)))
    chosen: dict[tuple[int, int], Corners] = {}
    for number, options in enumerate(places):
        for option in options:
            expected = layout.project(points[option.corners.ids], option.mirror)
            offset = float(np.median(np.nan_to_num(np.linalg.norm(expected - option.corners.pixels, axis=1), nan=1e9)))
            limit = MAX_OFFSET * sizes_px[option.mirror]
            gain = len(option.corners) * option.inside * max(1.0 - offset / limit, 0.0)
            if gain > gains[number, option.mirror]:
                gains[number, option.mirror] = gain
                chosen[number, option.mirror] = option.corners
    rows, columns = linear_sum_assignment(-gains)
    taken = [(int(mirror), int(number)) for number, mirror in zip(rows, columns, strict=True)]
    return [(mirror, chosen[number, mirror]) for mirror, number in sorted(taken) if (number, mirror) in chosen]


def _places(
    board: tuple[Corners, ...], regions: Sequence[shapely.Polygon], layout: Layout, target: Target
) -> list[_PossibleMirror]:
    """All mirrors that may show a board, in all of its numberings; the most likely mirror first."""
    found = []
    inside = np.array([shapely.contains_xy(region, *board[0].pixels.T).mean() for region in regions])
    for mirror in np.argsort(-inside, kind="stable").tolist():
        if inside[mirror] < MIN_INSIDE:
            break
        for corners in board:
            centre = layout.mirrors[mirror].apparent.virtual_centre_in_rig_mm
            pose = initial_estimates.rig_from_board(layout.camera, corners, target.corners_in_board_mm, centre)
            if pose is not None:
                found.append(_PossibleMirror(mirror, corners, float(inside[mirror]), pose))
    return found
