"""Assignment of the boards detected in a frame to mirrors, choice of plain boards' numberings, and stray boards."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from scipy.optimize import linear_sum_assignment

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.detection.checkerboard import cell_px
from mirrorcam.optics.calibration.solver import initial_estimates
from mirrorcam.optics.calibration.solver.observations import Corners
from mirrorcam.optics.geometry.boards import CalibrationBoard
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.transforms import transform

MIN_INSIDE = 0.5  # fraction of a board's corners inside a mirror's sub-image, to belong to the mirror
MAX_OFFSET = 0.7  # between a board and its prediction by another view's pose, relative to the sub-image's size
MIN_STRAY = 0.5  # number of corners for a stray board, relative to the frame's typical board


@dataclass(frozen=True)
class _PossibleMirror:
    """A mirror that may show a board, with one of the board's numberings and the resulting pose (4, 4)."""

    mirror: int
    corners: Corners
    inside: float
    rig_from_board: FloatArray


def assign(
    boards: Sequence[tuple[Corners, ...]],
    layout: Layout,
    board: CalibrationBoard,
) -> list[tuple[int, Corners]]:
    """Assign detected boards to mirrors.

    A board belongs to the mirror whose sub-image holds most of it. Its pose by the nominal layout must roughly equal
    the pose of the frame's largest board: a mirror tilted by 2 degrees moves its image by a tenth of a frame, while the
    adjacent mirror shows the board half a frame away. If a plain board looks the same upside down, the numbering of the
    largest board is kept, because rotating the board in all views changes nothing.

    Parameters
    ----------
    boards
        Each board in its possible numberings: one, or two for a plain board that looks the same upside down.
    layout
        The nominal layout.
    board
        The board.

    Returns
    -------
    list of (mirror index, Corners)
        In the order of the mirrors; boards that match no mirror are left out.
    """
    regions = regions_px(layout)
    sizes_px = np.array([np.sqrt(region.area) for region in regions])
    candidates = [_possible_mirrors(detected, regions, layout, board) for detected in boards]
    located = [options for options in candidates if options]
    if not located:
        return []
    largest = max(located, key=lambda options: options[0].inside * len(options[0].corners))[0]
    points = transform(largest.rig_from_board, board.corners_in_board_mm)
    gains = np.zeros((len(boards), len(layout.mirrors)))
    chosen: dict[tuple[int, int], Corners] = {}
    for number, options in enumerate(candidates):
        for option in options:
            expected = layout.project(points[option.corners.ids], option.mirror)
            offset = float(np.median(np.nan_to_num(np.linalg.norm(expected - option.corners.pixels, axis=1), nan=1e9)))
            limit = MAX_OFFSET * sizes_px[option.mirror]
            gain = len(option.corners) * option.inside * max(1.0 - offset / limit, 0.0)
            if gain > gains[number, option.mirror]:
                gains[number, option.mirror] = gain
                chosen[number, option.mirror] = option.corners
    rows, columns = linear_sum_assignment(-gains)
    pairs = [(int(mirror), int(number)) for number, mirror in zip(rows, columns, strict=True)]
    return [(mirror, chosen[number, mirror]) for mirror, number in sorted(pairs) if (number, mirror) in chosen]


def regions_px(layout: Layout) -> list[shapely.Polygon]:
    """The sub-image of each mirror, px, in the order of the mirrors."""
    outlines = [layout.outline_px(index) for index in range(len(layout.mirrors))]
    regions = [shapely.Polygon(outline[np.isfinite(outline).all(axis=1)]) for outline in outlines]
    shapely.prepare(regions)
    return regions


def likely_mirror(corners: Corners, layout: Layout) -> int | None:
    """Return the mirror whose sub-image holds most of a board's corners; None if none holds half of them."""
    inside = [_inside(region, corners) for region in regions_px(layout)]
    best = int(np.argmax(inside))
    return best if inside[best] >= MIN_INSIDE else None


def unassigned_px(
    boards: Sequence[tuple[Corners, ...]], assigned: Sequence[tuple[int, Corners]], layout: Layout
) -> FloatArray:
    """Find stray boards, which match no mirror of the layout: the device differs, or there is a second board.

    A small part of a board does not count, nor does a board that continues or repeats one in the same mirror, such as
    a board crossed by a cable.

    Parameters
    ----------
    boards
        Each board in its possible numberings.
    assigned
        Result of `assign`.
    layout
        The nominal layout.

    Returns
    -------
    array
        Centroids (k, 2) of the stray boards, px.
    """
    assigned_ids = {id(corners) for _, corners in assigned}
    stray = [board for board in boards if not any(id(corners) in assigned_ids for corners in board)]
    sizes = [len(corners) for _, corners in assigned] or [max((len(board[0]) for board in stray), default=0)]
    regions, min_corners = regions_px(layout), MIN_STRAY * np.median(sizes)
    centroids = []
    for board in stray:
        in_mirror = [corners for mirror, corners in assigned if _inside(regions[mirror], board[0]) >= MIN_INSIDE]
        if len(board[0]) >= min_corners and not any(_same_or_part(board, corners) for corners in in_mirror):
            centroids.append(board[0].pixels.mean(axis=0))
    return np.array(centroids).reshape(-1, 2)


def _same_or_part(board: tuple[Corners, ...], assigned: Corners) -> bool:
    """Return whether a board continues an assigned board of the same mirror, or is the same board found twice."""
    for corners in board:
        _, first, second = np.intersect1d(corners.ids, assigned.ids, return_indices=True)
        distances = np.linalg.norm(corners.pixels[first] - assigned.pixels[second], axis=1)
        if 2 * len(first) < len(corners) or np.median(distances) < np.median(cell_px(corners.pixels)):
            return True
    return False


def _inside(region: shapely.Polygon, corners: Corners) -> float:
    """Fraction of a board's corners in a sub-image."""
    return float(shapely.contains_xy(region, *corners.pixels.T).mean())


def _possible_mirrors(
    detected: tuple[Corners, ...], regions: Sequence[shapely.Polygon], layout: Layout, board: CalibrationBoard
) -> list[_PossibleMirror]:
    """Return all mirrors that may show a board, in all of its numberings; the most likely mirror first."""
    possible = []
    inside = np.array([_inside(region, detected[0]) for region in regions])
    for mirror in np.argsort(-inside, kind="stable").tolist():
        if inside[mirror] < MIN_INSIDE:
            break
        for corners in detected:
            centre = layout.mirrors[mirror].apparent.virtual_centre_in_rig_mm
            pose = initial_estimates.rig_from_board(layout.camera, corners, board.corners_in_board_mm, centre)
            if pose is not None:
                possible.append(_PossibleMirror(mirror, corners, float(inside[mirror]), pose))
    return possible
