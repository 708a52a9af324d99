"""Numbering of a grid of corners by all the markers between them jointly.

Every square of the grid that may hold a marker is sampled at the positions of the marker's modules. Its agreement with
each marker counts for the numbering that puts that marker there, so markers too blurred to be read individually can
still number a board jointly.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.detection.blurred_print import Image, sample
from mirrorcam.optics.calibration.detection.detections import DetectedGrid
from mirrorcam.optics.calibration.solver.observations import IntArray

MIN_CORRELATION = 0.5  # mean correlation of the squares with the markers of a numbering
MIN_SIGMAS = 5.0  # minimum of this mean, in standard deviations of a chance correlation
MAX_RIVAL = 0.6  # mean correlation of any other numbering, relative to the best one
OFFSETS = (-0.2, 0.2)  # of the samples from a module's centre, in modules


@dataclass(frozen=True)
class Markers:
    """The markers of a print.

    Attributes
    ----------
    codes
        White modules (m, b, b) of each marker, inside its black border.
    grid_xy
        Lowest corner coordinates (m, 2), along x and y, of the square that holds each marker.
    side
        Side of a marker with its border, relative to the side of that square.
    parity
        Colour of the squares that hold markers: 1 for white, 0 for black.
    every_other
        Whether only every other square of that colour holds a marker: even coordinates on the print, odd x and even y
        on a grid.
    """

    codes: NDArray[np.bool_]
    grid_xy: IntArray
    side: float
    parity: int
    every_other: bool = False


def numbered_by_markers(picture: Image, grid: DetectedGrid, markers: Markers) -> DetectedGrid | None:
    """Shift and rotate a grid to the coordinates of the print.

    Parameters
    ----------
    picture
        Grey values (h, w).
    grid
        Corners as on the print (`DetectedGrid.as_printed`), up to a shift and quarter turns.
    markers
        The markers of the print.

    Returns
    -------
    DetectedGrid or None
        The grid in the coordinates of the print; None if its squares show none of the print's markers, or several
        numberings are about equally likely.
    """
    codes = standardised(markers.codes.reshape(len(markers.codes), -1).astype(np.float64))
    scores: list[tuple[float, int, IntArray, int]] = []
    for turn in range(4):
        low, quads = _candidate_squares(grid, turn, markers)
        if not len(low):
            continue
        agreement = standardised(_module_greys(picture, quads, markers)) @ codes.T
        shifts = markers.grid_xy - low[:, None]
        lowest = shifts.min(axis=(0, 1))
        width = np.ptp(shifts, axis=(0, 1)) + 1
        total = np.zeros(width)
        np.add.at(total, tuple(np.moveaxis(shifts - lowest, -1, 0)), agreement)
        best = np.argsort(total, axis=None)[-2:][::-1]
        scores += [
            (float(total.flat[index]) / len(low), turn, lowest + np.unravel_index(index, width), len(low))
            for index in best
        ]
    scores.sort(key=lambda score: -score[0])
    if not scores:
        return None
    mean, turn, shift, count = scores[0]
    chance = 1.0 / np.sqrt(codes.shape[1] * count)
    if mean < max(MIN_CORRELATION, MIN_SIGMAS * chance) or any(other[0] > MAX_RIVAL * mean for other in scores[1:]):
        return None
    return grid.transformed(turn, np.asarray(shift, dtype=np.int64))


@dataclass(frozen=True)
class ReadMarkers:
    """Squares of a grid that show markers.

    Attributes
    ----------
    low
        Lowest coordinates (n, 2) of the squares, along x and y of the print, up to a shift.
    ids
        Marker (n,) in each square.
    quads
        Pixels (n, 4, 2) of their corners, row by row.
    correlation
        Mean correlation of all candidate squares with their most similar markers.
    """

    low: IntArray
    ids: IntArray
    quads: FloatArray
    correlation: float


def read_markers(picture: Image, grid: DetectedGrid, markers: Markers) -> ReadMarkers:
    """Read the squares of a grid individually, for any board.

    Parameters
    ----------
    picture
        Grey values (h, w).
    grid
        Corners as on the print, up to a shift and quarter turns.
    markers
        All possible markers, without coordinates.
    """
    codes = standardised(markers.codes.reshape(len(markers.codes), -1).astype(np.float64))
    no_ids = np.empty(0, dtype=np.int64)
    best = ReadMarkers(np.empty((0, 2), dtype=np.int64), no_ids, np.empty((0, 4, 2)), 0.0)
    for turn in range(4):
        low, quads = _candidate_squares(grid, turn, markers)
        if not len(low):
            continue
        agreement = standardised(_module_greys(picture, quads, markers)) @ codes.T
        correlation = agreement.max(axis=1)
        if correlation.mean() > best.correlation:
            valid = correlation > MIN_CORRELATION
            ids = agreement.argmax(axis=1)[valid].astype(np.int64)
            best = ReadMarkers(low[valid], ids, quads[valid], float(correlation.mean()))
    return best


def _candidate_squares(grid: DetectedGrid, turn: int, markers: Markers) -> tuple[IntArray, FloatArray]:
    """Return lowest coordinates (n, 2) and corner pixels (n, 4, 2) of the candidate squares, after quarter turns."""
    rotated = grid.transformed(turn, np.zeros(2, dtype=np.int64))
    # A corner with an even sum has white at its lower right on a grid, black on a print; quarter turns swap them.
    low, quads = squares_of(rotated, markers.parity + turn + 1)
    if markers.every_other:
        holds_marker = low[:, 0] % 2 == (turn < 2)
        low, quads = low[holds_marker], quads[holds_marker]
    return low, quads


def standardised(values: FloatArray) -> FloatArray:
    """Normalise rows to mean 0 and norm 1."""
    centred = values - values.mean(axis=1, keepdims=True)
    return np.asarray(centred / np.maximum(np.linalg.norm(centred, axis=1, keepdims=True), 1e-9))


def squares_of(grid: DetectedGrid, parity: int) -> tuple[IntArray, FloatArray]:
    """Return lowest coordinates (n, 2) of the squares of one colour, and pixels (n, 4, 2) of their corners."""
    low = grid.grid_xy.min(axis=0)
    index = np.full(np.ptp(grid.grid_xy, axis=0) + 2, -1)
    index[tuple((grid.grid_xy - low).T)] = np.arange(len(grid))
    corners = np.stack([index[:-1, :-1], index[1:, :-1], index[:-1, 1:], index[1:, 1:]], axis=-1)
    x, y = np.nonzero((corners >= 0).all(axis=-1))
    squares = np.stack([x, y], axis=1) + low
    has_colour = (squares.sum(axis=1) - parity) % 2 == 0
    return squares[has_colour], grid.corners.pixels[corners[x, y][has_colour]]


def _module_greys(picture: Image, quads: FloatArray, markers: Markers) -> FloatArray:
    """Mean grey values (n, b * b) of squares (n, 4, 2) at the modules of a marker, row by row."""
    return module_greys(picture, quads, markers.codes.shape[1], markers.side)


def module_greys(picture: Image, quads: FloatArray, count: int, side: float) -> FloatArray:
    """Mean grey values (n, count * count) of the modules inside a marker's border of one module, row by row.

    The markers, of `side` relative to the squares, are centred in squares with corners (n, 4, 2), row by row.
    """
    centres = 0.5 + side * ((np.arange(count) + 1.5) / (count + 2) - 0.5)
    positions = (centres[:, None] + np.array(OFFSETS) * side / (count + 2)).ravel()
    v, u = (axis.ravel() for axis in np.meshgrid(positions, positions, indexing="ij"))
    weights = np.stack([(1 - u) * (1 - v), u * (1 - v), (1 - u) * v, u * v], axis=1)
    sampled = sample(picture, weights @ quads)
    means = sampled.reshape(len(quads), count, len(OFFSETS), count, len(OFFSETS)).mean(axis=(2, 4))
    return np.asarray(means.reshape(len(quads), count**2))
