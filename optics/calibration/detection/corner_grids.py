"""Saddle points that look like corners of a checkerboard, linked into grids.

Two edges cross at a corner of a checkerboard, so grey values have a saddle point there: the Hessian's determinant is
negative. On a small circle around it, opposite sides are equal, and grey values change four times between black and
white, at the edges.

Every corner has four edges, which lead to its neighbours. The colours on the two sides of an edge stay the same from
one corner to the next, so the edge is the first of `SaddlePoints.axes` at one corner and the second at the next. Links
are kept if four of them close around a square, and if they continue the links before or after them; links between
boards of adjacent mirrors do neither. On an AprilGrid, whose columns are alternately wide and narrow, links must
continue the next but one.
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
SAME_PX = 2.5  # between detections of one saddle point at two scales, in px of the smaller picture
NEIGHBOURS = 24
NEIGHBOURS_ALTERNATING = 64  # more, because tags contain saddle points as well
MAX_ANGLE = np.deg2rad(20.0)  # between an edge and the line to the next corner
MAX_ANGLE_ALTERNATING = np.deg2rad(10.0)  # smaller than the angle to saddle points inside a tag
MAX_RATIO = 1.7  # of the lengths of opposite sides of a square
MIN_CORNERS = 6
MAX_CHANGE, MAX_CHANGE_PX = 0.15, 1.0  # between consecutive links along a line: relative part, plus a constant
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
        Angles (n, 2) of the two edges, rad, from 0 to pi. The sectors from the first edge to the second, by increasing
        angle, are white.
    strength
        Curvature (n,), grey levels per squared px of the picture in which it was found.
    """

    pixels: FloatArray
    axes: FloatArray
    strength: FloatArray

    def __len__(self) -> int:
        return len(self.pixels)

    def where(self, rows: NDArray[np.bool_] | IntArray) -> Self:
        """Select the saddle points of a mask (n,) or of indices."""
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
    local_max = np.asarray(cv2.dilate(curvature, np.ones((SUPPRESSION_PX, SUPPRESSION_PX), np.uint8)))
    band = np.s_[above : above + BAND_PX]
    rows, cols = np.nonzero((curvature[band] >= local_max[band]) & (curvature[band] > MIN_CURVATURE**2))
    hessian = np.stack([derivative[band][rows, cols] for derivative in (xx, yy, xy)]).astype(np.float64)
    return rows + top, cols, hessian


def _subpixel_offsets(smooth: NDArray[np.float32], rows: IntArray, cols: IntArray, hessian: FloatArray) -> FloatArray:
    """Offsets (n, 2) from pixels to zeros of the gradient, at most 1 px per axis; `hessian` (3, n) holds xx, yy, xy."""
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
    following = np.roll(signal, -1, axis=0)
    rising, falling = (signal <= 0) & (following > 0), (signal > 0) & (following <= 0)
    valid = (rising.sum(axis=0) == 1) & (falling.sum(axis=0) == 1) & (contrast > MIN_CONTRAST)
    valid &= np.sqrt((odd**2).mean(axis=0)) < MAX_ASYMMETRY * contrast / 2.0
    height, width = smooth.shape
    valid &= ((pixels > radius) & (pixels < [width - 1 - radius, height - 1 - radius])).all(axis=1)
    axes = np.full((len(pixels), 2), np.nan)
    points = np.flatnonzero(valid)
    for column, crossing in enumerate((rising, falling)):
        first = np.argmax(crossing[:, points], axis=0)
        grey_before, grey_after = signal[first, points], following[first, points]
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
    list of (members, grid_xy)
        For each grid, the largest first: indices (m,) of its saddle points, and their integer coordinates (m, 2). The
        axes have the handedness of the picture's x and y. A corner with an even coordinate sum has white
        towards larger coordinates.
    """
    if len(points) < MIN_CORNERS:
        return []
    if alternating:
        neighbour, reverse = _links(points, NEIGHBOURS_ALTERNATING, MAX_ANGLE_ALTERNATING)
    else:
        neighbour, reverse = _links(points, NEIGHBOURS, MAX_ANGLE)
    neighbour = _straight_links(points.pixels, neighbour, reverse, alternating=alternating)
    closed = _closed_links(points.pixels, neighbour, reverse)
    grids = []
    assigned = np.zeros(len(points), dtype=bool)
    for seed in np.flatnonzero(closed.any(axis=1)):
        if not assigned[seed]:
            members, grid_xy = _grid_from(int(seed), neighbour, reverse, closed & ~assigned[:, None])
            assigned[members] = True
            if len(members) >= MIN_CORNERS:
                grids.append((members, grid_xy))
    return sorted(grids, key=lambda grid: -len(grid[0]))


def _links(points: SaddlePoints, max_neighbours: int, max_angle: float) -> tuple[IntArray, IntArray]:
    """Return the neighbour (n, 4) of each saddle point in each direction, and the reverse direction (n, 4) there.

    Directions 0 to 3 are the first edge, the second one, and their opposites. `NO_NEIGHBOUR` marks a missing or a
    one-sided link.
    """
    count = len(points)
    distance, other = cKDTree(points.pixels).query(points.pixels, k=min(max_neighbours + 1, count))
    distance, other = distance[:, 1:], other[:, 1:]
    direction_to = (points.pixels[other] - points.pixels[:, None]) / np.maximum(distance, 1e-9)[..., None]
    first, second = points.axes[:, 0], points.axes[:, 1]
    angles = np.stack([first, first + (second - first) % np.pi], axis=1)
    edges = np.stack([np.cos(angles), np.sin(angles)], axis=2)
    directions = np.concatenate([edges, -edges], axis=1)
    # Cosines of the angles between the four edges and the lines to the other points, at both ends.
    cosines = directions @ direction_to.transpose(0, 2, 1)
    row, side, rank = np.nonzero(cosines > np.cos(max_angle))
    return_cosines = -(directions[other[row, rank]] @ direction_to[row, rank, :, None])[..., 0]
    # An edge along the first axis of one corner is along the second axis of the other.
    return_cosines[(side[:, None] + np.arange(4)) % 2 == 0] = -1.0
    cost, return_side = np.full(cosines.shape, np.inf), np.zeros(cosines.shape, dtype=np.int64)
    larger_angle = np.arccos(np.clip(np.minimum(cosines[row, side, rank], return_cosines.max(axis=1)), -1.0, 1.0))
    cost[row, side, rank] = np.where(larger_angle < max_angle, distance[row, rank] * (1.0 + larger_angle), np.inf)
    return_side[row, side, rank] = return_cosines.argmax(axis=1)
    best = cost.argmin(axis=2)
    rows, sides = np.meshgrid(np.arange(count), np.arange(4), indexing="ij")
    linked = np.isfinite(cost[rows, sides, best])
    neighbour = np.where(linked, other[rows, best], NO_NEIGHBOUR)
    reverse = return_side[rows, sides, best]
    mutual = linked & (neighbour[neighbour, reverse] == rows) & (reverse[neighbour, reverse] == sides)
    return np.where(mutual, neighbour, NO_NEIGHBOUR).astype(np.int64), reverse.astype(np.int64)


def _straight_links(pixels: FloatArray, neighbour: IntArray, reverse: IntArray, *, alternating: bool) -> IntArray:
    """Drop neighbours (n, 4) whose link continues neither the previous link nor the next, if there is one.

    If squares are alternately wide and narrow, each link is compared with the next but one.
    """
    linked = neighbour != NO_NEIGHBOUR
    vector = np.where(linked[..., None], pixels[neighbour] - pixels[:, None], np.nan)
    length = np.linalg.norm(vector, axis=2)
    next_vector = vector[neighbour, (reverse + 2) % 4]
    if alternating:
        next_point, next_side = neighbour[neighbour, (reverse + 2) % 4], (reverse[neighbour, (reverse + 2) % 4] + 2) % 4
        continued = linked & np.isfinite(next_vector[..., 0])
        next_vector = np.where(continued[..., None], vector[next_point, next_side], np.nan)
        opposite = np.roll(np.where(linked[..., None], vector[neighbour, (reverse + 2) % 4], np.nan), 2, axis=1)
    else:
        opposite = np.roll(vector, 2, axis=1)
    changes = np.stack([np.linalg.norm(vector + opposite, axis=2), np.linalg.norm(next_vector - vector, axis=2)])
    limit = MAX_CHANGE * length + MAX_CHANGE_PX
    smooth = (changes < limit).any(axis=0) | np.isnan(changes).all(axis=0)
    return np.where(linked & smooth, neighbour, NO_NEIGHBOUR)


def _closed_links(pixels: FloatArray, neighbour: IntArray, reverse: IntArray) -> np.ndarray:
    """Mask (n, 4) of the links on a closed square of four links with similar opposite sides."""
    rows, sides = np.meshgrid(np.arange(len(neighbour)), np.arange(4), indexing="ij")
    corners, path_sides = [rows], [sides]
    valid = np.ones(neighbour.shape, dtype=bool)
    for _ in range(3):
        point, side = corners[-1], path_sides[-1]
        valid &= neighbour[point, side] != NO_NEIGHBOUR
        corners.append(neighbour[point, side])
        # `reverse` points backwards; the next side is to the right of the direction of travel.
        path_sides.append((reverse[point, side] + 3) % 4)
    valid &= neighbour[corners[3], path_sides[3]] == rows
    lengths = [np.linalg.norm(pixels[corners[i]] - pixels[corners[(i + 1) % 4]], axis=2) for i in range(4)]
    for a, b in ((0, 2), (1, 3)):
        valid &= np.maximum(lengths[a], lengths[b]) < MAX_RATIO * np.minimum(lengths[a], lengths[b])
    closed = np.zeros_like(valid)
    for point, side in zip(corners, path_sides, strict=True):
        closed[point[valid], side[valid]] = True
        closed[neighbour[point[valid], side[valid]], reverse[point[valid], side[valid]]] = True
    return closed


def _grid_from(seed: int, neighbour: IntArray, reverse: IntArray, closed: np.ndarray) -> tuple[IntArray, IntArray]:
    """Return the saddle points (m,) that closed links connect with a seed, and their distinct coordinates (m, 2)."""
    grid_xy, rotations, occupied = {seed: (0, 0)}, {seed: 0}, {(0, 0): seed}
    queue = deque([seed])
    while queue:
        point = queue.popleft()
        for side in range(4):
            other = int(neighbour[point, side])
            if not closed[point, side] or other in grid_xy:
                continue
            step = (side + rotations[point]) % 4
            new_xy = (grid_xy[point][0] + int(STEPS[step, 0]), grid_xy[point][1] + int(STEPS[step, 1]))
            if new_xy in occupied:
                continue
            grid_xy[other], rotations[other], occupied[new_xy] = (
                new_xy,
                (step + 2 - int(reverse[point, side])) % 4,
                other,
            )
            queue.append(other)
    return np.array(list(grid_xy), dtype=np.int64), np.array(list(grid_xy.values()), dtype=np.int64)
