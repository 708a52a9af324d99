"""Saddle points linked into grids: parts of checkerboards, of any extent and at any rotation.

Every corner has four edges, which lead to its neighbours. From one corner to the next the colours on the two sides of
the edge between them stay, so that it is an edge of the first kind for one of them and of the second kind for the
other (`SaddlePoints.axes`). Links count where four of them close around a square, and where they go on as the links
before or after them do: where two mirrors meet, their boards do not. On an AprilGrid, whose columns are wide and narrow
by turns, they go on as the links after the next do.
"""

from __future__ import annotations

from collections import deque

import numpy as np
from scipy.spatial import cKDTree

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.detection.saddle_points import SaddlePoints
from mirrorcam.optics.calibration.solver.observations import IntArray

NEIGHBOURS = 24
NEIGHBOURS_BY_TURNS = 64  # more, as there are saddle points inside tags, too
MAX_ANGLE = np.deg2rad(20.0)  # between an edge and the line to the next corner
MAX_ANGLE_BY_TURNS = np.deg2rad(10.0)  # less than to saddle points inside a tag
MAX_RATIO = 1.7  # between opposite sides of a square
MIN_CORNERS = 6
MAX_CHANGE, MAX_CHANGE_PX = 0.15, 1.0  # from a link to the next one along a line: relative, and this much more
STEPS = np.array([[1, 0], [0, 1], [-1, 0], [0, -1]])
NO_NEIGHBOUR = -1


def corner_grids(points: SaddlePoints, *, by_turns: bool = False) -> list[tuple[IntArray, IntArray]]:
    """Link saddle points (n) into grids.

    Parameters
    ----------
    points
        The saddle points.
    by_turns
        Whether squares are wide and narrow by turns, as those of an AprilGrid.

    Returns
    -------
    list of (members, places)
        For each grid, the largest first: indices (m,) of its saddle points, and their integer positions (m, 2) on it.
        The second axis of the grid is turned from the first one as y is from x in the picture. Right of and below a
        corner whose coordinates have an even sum, towards larger coordinates, there is white.
    """
    if len(points) < MIN_CORNERS:
        return []
    if by_turns:
        neighbour, back = _links(points, NEIGHBOURS_BY_TURNS, MAX_ANGLE_BY_TURNS)
    else:
        neighbour, back = _links(points, NEIGHBOURS, MAX_ANGLE)
    neighbour = _straight(points.pixels, neighbour, back, by_turns=by_turns)
    closed = _closed(points.pixels, neighbour, back)
    grids = []
    done = np.zeros(len(points), dtype=bool)
    for seed in np.flatnonzero(closed.any(axis=1)):
        if not done[seed]:
            members, places = _walked(int(seed), neighbour, back, closed & ~done[:, None])
            done[members] = True
            if len(members) >= MIN_CORNERS:
                grids.append((members, places))
    return sorted(grids, key=lambda grid: -len(grid[0]))


def _links(points: SaddlePoints, most: int, max_angle: float) -> tuple[IntArray, IntArray]:
    """The neighbour (n, 4) of each saddle point along each of its directions, and its direction (n, 4) back.

    Directions 0 to 3 are the first edge, the second one, and their opposites. `NO_NEIGHBOUR` where there is none, or
    where the neighbour's own neighbour in that direction is another one.
    """
    count = len(points)
    distance, other = cKDTree(points.pixels).query(points.pixels, k=min(most + 1, count))
    distance, other = distance[:, 1:], other[:, 1:]
    towards = (points.pixels[other] - points.pixels[:, None]) / np.maximum(distance, 1e-9)[..., None]
    first, second = points.axes[:, 0], points.axes[:, 1]
    angles = np.stack([first, first + (second - first) % np.pi], axis=1)
    edges = np.stack([np.cos(angles), np.sin(angles)], axis=2)
    directions = np.concatenate([edges, -edges], axis=1)
    # Cosines of the angles between the four edges and the lines to the other points, here and there.
    here = directions @ towards.transpose(0, 2, 1)
    row, side, rank = np.nonzero(here > np.cos(max_angle))
    there = -(directions[other[row, rank]] @ towards[row, rank, :, None])[..., 0]
    # An edge of the first kind here is one of the second kind there.
    there[(side[:, None] + np.arange(4)) % 2 == 0] = -1.0
    cost, returning = np.full(here.shape, np.inf), np.zeros(here.shape, dtype=np.int64)
    worst = np.arccos(np.clip(np.minimum(here[row, side, rank], there.max(axis=1)), -1.0, 1.0))
    cost[row, side, rank] = np.where(worst < max_angle, distance[row, rank] * (1.0 + worst), np.inf)
    returning[row, side, rank] = there.argmax(axis=1)
    best = cost.argmin(axis=2)
    rows, sides = np.meshgrid(np.arange(count), np.arange(4), indexing="ij")
    linked = np.isfinite(cost[rows, sides, best])
    neighbour = np.where(linked, other[rows, best], NO_NEIGHBOUR)
    back = returning[rows, sides, best]
    mutual = linked & (neighbour[neighbour, back] == rows) & (back[neighbour, back] == sides)
    return np.where(mutual, neighbour, NO_NEIGHBOUR).astype(np.int64), back.astype(np.int64)


def _straight(pixels: FloatArray, neighbour: IntArray, back: IntArray, *, by_turns: bool) -> IntArray:
    """The neighbours (n, 4) without those that lie otherwise than the next ones on both sides, or on the only one.

    Where squares are wide and narrow by turns, these are the ones after the next.
    """
    linked = neighbour != NO_NEIGHBOUR
    vector = np.where(linked[..., None], pixels[neighbour] - pixels[:, None], np.nan)
    length = np.linalg.norm(vector, axis=2)
    beyond = vector[neighbour, (back + 2) % 4]
    if by_turns:
        next_one, onwards = neighbour[neighbour, (back + 2) % 4], (back[neighbour, (back + 2) % 4] + 2) % 4
        known = linked & np.isfinite(beyond[..., 0])
        beyond = np.where(known[..., None], vector[next_one, onwards], np.nan)
        opposite = np.roll(np.where(linked[..., None], vector[neighbour, (back + 2) % 4], np.nan), 2, axis=1)
    else:
        opposite = np.roll(vector, 2, axis=1)
    changes = np.stack([np.linalg.norm(vector + opposite, axis=2), np.linalg.norm(beyond - vector, axis=2)])
    limit = MAX_CHANGE * length + MAX_CHANGE_PX
    smooth = (changes < limit).any(axis=0) | np.isnan(changes).all(axis=0)
    return np.where(linked & smooth, neighbour, NO_NEIGHBOUR)


def _closed(pixels: FloatArray, neighbour: IntArray, back: IntArray) -> np.ndarray:
    """Mask (n, 4) of the links that are a side of a square of four links with about equal opposite sides."""
    rows, sides = np.meshgrid(np.arange(len(neighbour)), np.arange(4), indexing="ij")
    corners, turns = [rows], [sides]
    good = np.ones(neighbour.shape, dtype=bool)
    for _ in range(3):
        at, side = corners[-1], turns[-1]
        good &= neighbour[at, side] != NO_NEIGHBOUR
        corners.append(neighbour[at, side])
        # Where one came from is behind; the next side is to the right of going on.
        turns.append((back[at, side] + 3) % 4)
    good &= neighbour[corners[3], turns[3]] == rows
    lengths = [np.linalg.norm(pixels[corners[i]] - pixels[corners[(i + 1) % 4]], axis=2) for i in range(4)]
    for a, b in ((0, 2), (1, 3)):
        good &= np.maximum(lengths[a], lengths[b]) < MAX_RATIO * np.minimum(lengths[a], lengths[b])
    closed = np.zeros_like(good)
    for at, side in zip(corners, turns, strict=True):
        closed[at[good], side[good]] = True
        closed[neighbour[at[good], side[good]], back[at[good], side[good]]] = True
    return closed


def _walked(seed: int, neighbour: IntArray, back: IntArray, closed: np.ndarray) -> tuple[IntArray, IntArray]:
    """The saddle points that closed links lead to from one, and their places; of two at one place, the first."""
    place, turn, at = {seed: (0, 0)}, {seed: 0}, {(0, 0): seed}
    waiting = deque([seed])
    while waiting:
        here = waiting.popleft()
        for side in range(4):
            there = int(neighbour[here, side])
            if not closed[here, side] or there in place:
                continue
            step = (side + turn[here]) % 4
            to = (place[here][0] + int(STEPS[step, 0]), place[here][1] + int(STEPS[step, 1]))
            if to in at:
                continue
            place[there], turn[there], at[to] = to, (step + 2 - int(back[here, side])) % 4, there
            waiting.append(there)
    return np.array(list(place), dtype=np.int64), np.array(list(place.values()), dtype=np.int64)
