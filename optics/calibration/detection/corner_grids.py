"""Saddle points that look like corners of a checkerboard, linked into grids.

Two edges cross at a corner of a checkerboard, so grey values have a saddle point there: the Hessian's determinant is
negative. On a small circle around it, opposite sides are equal, and grey values change four times between black and
white, at the edges.

Every corner has four edges, which lead to its neighbours. The colours on the two sides of an edge stay the same from
one corner to the next, so the edge is of the first kind for one corner and of the second kind for the other
(`SaddlePoints.axes`). Links count if four of them close around a square, and if they continue the links before or after
them; boards of adjacent mirrors do not. On an AprilGrid, whose columns are alternately wide and narrow, they must
continue the second next links.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, fields
from typing import Self

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.solver.observations import IntArray

SCALES = (1, 2, 4)  # factors by which the picture is reduced
SMOOTHING_PX = 1.0  # sigma, in px of the reduced picture, like all lengths below
BAND_PX = 64  # rows searched at a time
SUPPRESSION_PX = 5  # side of the window in which only the strongest saddle point counts
RINGS_PX = (3.0, 4.5)  # radii of the circles; the smaller one is for small cells
RING_POINTS = 32
MIN_CURVATURE = 0.6  # grey levels per squared px
MIN_CONTRAST = 8.0  # grey levels on the circle, from black to white
MAX_ASYMMETRY = 0.35  # difference between opposite sides, relative to the signal on the circle
MAX_POINTS = 6000  # saddle points at each scale
SAME_PX = 2.5  # between saddle points found at two scales, in px of the more reduced one
NEIGHBOURS = 24
NEIGHBOURS_ALTERNATING = 64  # more, because tags contain saddle points as well
MAX_ANGLE = np.deg2rad(20.0)  # between an edge and the line to the next corner
MAX_ANGLE_ALTERNATING = np.deg2rad(10.0)  # smaller than the angle to saddle points inside a tag
MAX_RATIO = 1.7  # between opposite sides of a square
MIN_CORNERS = 6
MAX_CHANGE, MAX_CHANGE_PX = 0.15, 1.0  # between consecutive links along a line: relative, plus a constant
STEPS = np.array([[1, 0], [0, 1], [-1, 0], [0, -1]])
NO_NEIGHBOUR = -1


@dataclass(frozen=True)
class SaddlePoints:
    """Saddle points (n) of a picture.

    Attributes
    ----------
    pixels
        Positions (n, 2).
    axes
        Angles (n, 2), rad, from 0 to pi, of the two edges. The sectors from the first edge to the second, in the sense
        of increasing angle, are white.
    strength
        Curvature (n,), grey levels per squared px of the picture in which it was found.
    """

    pixels: FloatArray
    axes: FloatArray
    strength: FloatArray

    def __len__(self) -> int:
        return len(self.pixels)

    def where(self, rows: NDArray[np.bool_] | IntArray) -> Self:
        """The saddle points of a mask (n,) or of indices."""
        return type(self)(*(getattr(self, field.name)[rows] for field in fields(self)))

    def with_new(self, other: Self, min_distance_px: float) -> Self:
        """Append the saddle points of `other` that are farther than `min_distance_px` from all of these."""
        if len(self) and len(other):
            other = other.where(cKDTree(self.pixels).query(other.pixels)[0] > min_distance_px)
        return type(self)(
            *(np.concatenate([getattr(self, field.name), getattr(other, field.name)]) for field in fields(self))
        )


def saddle_points(grey: NDArray[np.uint8]) -> SaddlePoints:
    """Find the saddle points of a picture (h, w) that look like corners of a checkerboard."""
    picture = np.asarray(grey, dtype=np.float32)
    found = SaddlePoints(np.empty((0, 2)), np.empty((0, 2)), np.empty(0))
    for scale in SCALES:
        if scale > 1:
            # A pixel of the reduced picture is the mean of two by two.
            picture = np.asarray(cv2.resize(picture, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA))
        if min(picture.shape) < 16:
            break
        at_scale = _saddles_at_scale(picture)
        pixels = (at_scale.pixels + 0.5) * scale - 0.5
        found = found.with_new(SaddlePoints(pixels, at_scale.axes, at_scale.strength), SAME_PX * scale)
    return found


def _saddles_at_scale(picture: NDArray[np.float32]) -> SaddlePoints:
    smooth = np.asarray(cv2.GaussianBlur(picture, (0, 0), SMOOTHING_PX), dtype=np.float32)
    bands = [_band_saddles(smooth, top) for top in range(0, len(smooth), BAND_PX)]
    rows, cols, hessian = (np.concatenate(parts, axis=-1) for parts in zip(*bands, strict=True))
    strength = np.sqrt(hessian[2] ** 2 - hessian[0] * hessian[1])
    if len(rows) > MAX_POINTS:
        strongest = np.argsort(-strength, kind="stable")[:MAX_POINTS]
        rows, cols, hessian, strength = rows[strongest], cols[strongest], hessian[:, strongest], strength[strongest]
    pixels = np.stack([cols, rows], axis=1) + _subpixel_offsets(smooth, rows, cols, hessian)
    axes = np.full((len(pixels), 2), np.nan)
    for radius in RINGS_PX:
        missing = np.isnan(axes[:, 0])
        axes[missing] = _axes(smooth, pixels[missing], radius)
    valid = np.isfinite(axes[:, 0])
    return SaddlePoints(pixels[valid], axes[valid], strength[valid])


def _band_saddles(smooth: NDArray[np.float32], top: int) -> tuple[IntArray, IntArray, FloatArray]:
    """Return rows and columns (n,) of a band's strongest saddle points, and the Hessian (3, n) there: xx, yy, xy.

    A band fits the processor's cache, and no memory is allocated.
    """
    above = min(SUPPRESSION_PX, top)  # rows that the band's derivatives and maxima depend on
    part = smooth[top - above : top + BAND_PX + SUPPRESSION_PX]
    xx, yy, xy = (
        np.asarray(cv2.Sobel(part, cv2.CV_32F, *order, ksize=3, scale=0.25)) for order in ((2, 0), (0, 2), (1, 1))
    )
    curvature = xy * xy - xx * yy
    highest = np.asarray(cv2.dilate(curvature, np.ones((SUPPRESSION_PX, SUPPRESSION_PX), np.uint8)))
    band = np.s_[above : above + BAND_PX]
    rows, cols = np.nonzero((curvature[band] >= highest[band]) & (curvature[band] > MIN_CURVATURE**2))
    hessian = np.stack([each[band][rows, cols] for each in (xx, yy, xy)]).astype(np.float64)
    return rows + top, cols, hessian


def _subpixel_offsets(smooth: NDArray[np.float32], rows: IntArray, cols: IntArray, hessian: FloatArray) -> FloatArray:
    """Offsets (n, 2) from pixels to where the gradient vanishes, at most 1 px; `hessian` (3, n) holds xx, yy, xy."""
    height, width = smooth.shape
    right, left = np.minimum(cols + 1, width - 1), np.maximum(cols - 1, 0)
    below, above = np.minimum(rows + 1, height - 1), np.maximum(rows - 1, 0)
    x = (smooth[rows, right] - smooth[rows, left]) / 2.0
    y = (smooth[below, cols] - smooth[above, cols]) / 2.0
    xx, yy, xy = hessian
    step = np.stack([xy * y - yy * x, xy * x - xx * y], axis=1) / (xx * yy - xy * xy)[:, None]
    return np.asarray(np.clip(step, -1.0, 1.0))


def _axes(smooth: NDArray[np.float32], pixels: FloatArray, radius: float) -> FloatArray:
    """Angles (n, 2) of the edges that cross at pixels (n, 2); NaN unless the circle shows exactly two edges."""
    if not len(pixels):
        return np.empty((0, 2))
    angles = np.arange(RING_POINTS) * (2.0 * np.pi / RING_POINTS)
    offsets = radius * np.stack([np.cos(angles), np.sin(angles)])
    x, y = pixels.T.astype(np.float32)[:, None] + offsets.astype(np.float32)[:, :, None]
    ring = np.asarray(cv2.remap(smooth, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE))
    half = RING_POINTS // 2
    even, odd = (ring[:half] + ring[half:]) / 2.0, (ring[:half] - ring[half:]) / 2.0
    mid_grey = (even.max(axis=0) + even.min(axis=0)) / 2.0
    contrast = even.max(axis=0) - even.min(axis=0)
    signal = even - mid_grey
    after = np.roll(signal, -1, axis=0)
    rising, falling = (signal <= 0) & (after > 0), (signal > 0) & (after <= 0)
    valid = (rising.sum(axis=0) == 1) & (falling.sum(axis=0) == 1) & (contrast > MIN_CONTRAST)
    valid &= np.sqrt((odd**2).mean(axis=0)) < MAX_ASYMMETRY * contrast / 2.0
    height, width = smooth.shape
    valid &= ((pixels > radius) & (pixels < [width - 1 - radius, height - 1 - radius])).all(axis=1)
    axes = np.full((len(pixels), 2), np.nan)
    points = np.flatnonzero(valid)
    for column, crossing in enumerate((rising, falling)):
        first = np.argmax(crossing[:, points], axis=0)
        grey_before, grey_after = signal[first, points], after[first, points]
        axes[points, column] = ((first + grey_before / (grey_before - grey_after)) * (np.pi / half)) % np.pi
    return axes


def corner_grids(points: SaddlePoints, *, alternating: bool = False) -> list[tuple[IntArray, IntArray]]:
    """Link saddle points (n) into grids.

    Parameters
    ----------
    points
        The saddle points.
    alternating
        Whether squares are alternately wide and narrow, as on an AprilGrid.

    Returns
    -------
    list of (members, places)
        For each grid, the largest first: indices (m,) of its saddle points, and their integer coordinates (m, 2). The
        axes have the handedness of the picture's x and y. A corner whose coordinates have an even sum has white
        towards larger coordinates.
    """
    if len(points) < MIN_CORNERS:
        return []
    if alternating:
        neighbour, back = _links(points, NEIGHBOURS_ALTERNATING, MAX_ANGLE_ALTERNATING)
    else:
        neighbour, back = _links(points, NEIGHBOURS, MAX_ANGLE)
    neighbour = _straight_links(points.pixels, neighbour, back, alternating=alternating)
    closed = _closed_links(points.pixels, neighbour, back)
    grids = []
    done = np.zeros(len(points), dtype=bool)
    for seed in np.flatnonzero(closed.any(axis=1)):
        if not done[seed]:
            members, places = _grid_from(int(seed), neighbour, back, closed & ~done[:, None])
            done[members] = True
            if len(members) >= MIN_CORNERS:
                grids.append((members, places))
    return sorted(grids, key=lambda grid: -len(grid[0]))


def _links(points: SaddlePoints, max_neighbours: int, max_angle: float) -> tuple[IntArray, IntArray]:
    """Return the neighbour (n, 4) of each saddle point in each direction, and its direction (n, 4) back.

    Directions 0 to 3 are the first edge, the second one, and their opposites. `NO_NEIGHBOUR` marks a missing or a
    one-sided link.
    """
    count = len(points)
    distance, other = cKDTree(points.pixels).query(points.pixels, k=min(max_neighbours + 1, count))
    distance, other = distance[:, 1:], other[:, 1:]
    towards = (points.pixels[other] - points.pixels[:, None]) / np.maximum(distance, 1e-9)[..., None]
    first, second = points.axes[:, 0], points.axes[:, 1]
    angles = np.stack([first, first + (second - first) % np.pi], axis=1)
    edges = np.stack([np.cos(angles), np.sin(angles)], axis=2)
    directions = np.concatenate([edges, -edges], axis=1)
    # Cosines of the angles between the four edges and the lines to the other points, at both ends.
    cosines = directions @ towards.transpose(0, 2, 1)
    row, side, rank = np.nonzero(cosines > np.cos(max_angle))
    return_cosines = -(directions[other[row, rank]] @ towards[row, rank, :, None])[..., 0]
    # An edge of the first kind here is one of the second kind there.
    return_cosines[(side[:, None] + np.arange(4)) % 2 == 0] = -1.0
    cost, returning = np.full(cosines.shape, np.inf), np.zeros(cosines.shape, dtype=np.int64)
    worst = np.arccos(np.clip(np.minimum(cosines[row, side, rank], return_cosines.max(axis=1)), -1.0, 1.0))
    cost[row, side, rank] = np.where(worst < max_angle, distance[row, rank] * (1.0 + worst), np.inf)
    returning[row, side, rank] = return_cosines.argmax(axis=1)
    best = cost.argmin(axis=2)
    rows, sides = np.meshgrid(np.arange(count), np.arange(4), indexing="ij")
    linked = np.isfinite(cost[rows, sides, best])
    neighbour = np.where(linked, other[rows, best], NO_NEIGHBOUR)
    back = returning[rows, sides, best]
    mutual = linked & (neighbour[neighbour, back] == rows) & (back[neighbour, back] == sides)
    return np.where(mutual, neighbour, NO_NEIGHBOUR).astype(np.int64), back.astype(np.int64)


def _straight_links(pixels: FloatArray, neighbour: IntArray, back: IntArray, *, alternating: bool) -> IntArray:
    """Drop neighbours (n, 4) whose link continues neither the previous link nor the next, if there is one.

    If squares are alternately wide and narrow, the second next links are compared.
    """
    linked = neighbour != NO_NEIGHBOUR
    vector = np.where(linked[..., None], pixels[neighbour] - pixels[:, None], np.nan)
    length = np.linalg.norm(vector, axis=2)
    beyond = vector[neighbour, (back + 2) % 4]
    if alternating:
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


def _closed_links(pixels: FloatArray, neighbour: IntArray, back: IntArray) -> np.ndarray:
    """Mask (n, 4) of the links on a closed square of four links with similar opposite sides."""
    rows, sides = np.meshgrid(np.arange(len(neighbour)), np.arange(4), indexing="ij")
    corners, sides_walked = [rows], [sides]
    valid = np.ones(neighbour.shape, dtype=bool)
    for _ in range(3):
        point, side = corners[-1], sides_walked[-1]
        valid &= neighbour[point, side] != NO_NEIGHBOUR
        corners.append(neighbour[point, side])
        # The reverse direction is behind; the next side is to the right of the forward direction.
        sides_walked.append((back[point, side] + 3) % 4)
    valid &= neighbour[corners[3], sides_walked[3]] == rows
    lengths = [np.linalg.norm(pixels[corners[i]] - pixels[corners[(i + 1) % 4]], axis=2) for i in range(4)]
    for a, b in ((0, 2), (1, 3)):
        valid &= np.maximum(lengths[a], lengths[b]) < MAX_RATIO * np.minimum(lengths[a], lengths[b])
    closed = np.zeros_like(valid)
    for point, side in zip(corners, sides_walked, strict=True):
        closed[point[valid], side[valid]] = True
        closed[neighbour[point[valid], side[valid]], back[point[valid], side[valid]]] = True
    return closed


def _grid_from(seed: int, neighbour: IntArray, back: IntArray, closed: np.ndarray) -> tuple[IntArray, IntArray]:
    """Return the saddle points (m,) that closed links reach from a seed, and their places (m, 2), all distinct."""
    places, turns, taken = {seed: (0, 0)}, {seed: 0}, {(0, 0): seed}
    waiting = deque([seed])
    while waiting:
        point = waiting.popleft()
        for side in range(4):
            other = int(neighbour[point, side])
            if not closed[point, side] or other in places:
                continue
            step = (side + turns[point]) % 4
            new_place = (places[point][0] + int(STEPS[step, 0]), places[point][1] + int(STEPS[step, 1]))
            if new_place in taken:
                continue
            places[other], turns[other], taken[new_place] = new_place, (step + 2 - int(back[point, side])) % 4, other
            waiting.append(other)
    return np.array(list(places), dtype=np.int64), np.array(list(places.values()), dtype=np.int64)
