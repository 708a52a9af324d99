"""Detection of ChArUco boards or AprilGrids in a picture, by grids of corners and the markers between them.

An AprilGrid is a checkerboard with columns and rows alternately as wide as a gap and a tag. The widths show which are
tags, so corners get places on the print up to a shift by entire tags, and a smooth warp maps them to the picture.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import cv2
import numpy as np
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import connected_components

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.detection.board_growing import (
    BoolArray,
    grow_board,
    same_board,
)
from mirrorcam.optics.calibration.detection.board_warp import BoardWarp, corner_places
from mirrorcam.optics.calibration.detection.checkerboard import Grey, linked_grids, new_corners, smooth_parts
from mirrorcam.optics.calibration.detection.corner_grids import corner_grids, saddle_points
from mirrorcam.optics.calibration.detection.detections import NO_LIMITS, SeenGrid
from mirrorcam.optics.calibration.detection.marker_numbering import Markers, numbered_by_markers
from mirrorcam.optics.calibration.solver.observations import Corners, IntArray
from mirrorcam.optics.geometry import marker_dictionaries as dictionaries
from mirrorcam.optics.geometry.targets import TAG_BORDER, TAG_FAMILY, AprilGrid, Charuco

WHITE_QUANTILE = 0.995
WINDOWS_PX = (15, 31, 7)  # sides of the adaptive threshold's window, tried in turn
MIN_PERIMETER = 0.01  # of a marker, in sides of the picture
NEIGHBOUR_SQUARES = 2.3  # squares between the centres of markers that predict each other
PREDICTION_ERROR = 0.12  # error of a marker's predicted position, per square between the two markers
MIN_MARKERS = 2
MAX_OFFSET = 0.3  # of a marker from its place on the board that holds it, in squares
MIN_LOG_RATIO = 0.5  # least logarithm of tag over gap in the picture, relative to the print


def find_marked_boards(grey: Grey, target: Charuco | AprilGrid, *, mirrored: bool, most: int) -> list[Corners]:
    """Find up to `most` boards in a picture, those with most corners first.

    Grids of saddle points are numbered by the markers between them. If fewer than half of the boards are found this
    way, as with markers that nearly touch the corners, boards are also grown from single markers.

    Parameters
    ----------
    grey
        Picture (h, w).
    target
        The board.
    mirrored
        Whether the boards are seen in mirrors.
    most
        Largest number of boards to return.
    """
    picture = np.asarray(grey, dtype=np.float32)
    found: list[Corners] = []
    markers = _markers(target)
    for places, pixels in linked_grids(grey) if isinstance(target, Charuco) else linked_tags(grey, target):
        if not new_corners(pixels, found):
            continue
        grid = SeenGrid(places, Corners(np.arange(len(places)), pixels), NO_LIMITS)
        numbered = numbered_by_markers(picture, grid.as_printed if mirrored else grid, markers)
        if numbered is None:
            continue
        board = grow_board(picture, _on_print(numbered.places, target), pixels, target, mirrored=mirrored)
        if len(board) and not any(same_board(board, other) for other in found):
            found.append(board)
    if 2 * len(found) < most:
        found = _from_markers(grey, target, found, mirrored=mirrored)
    return sorted(found, key=len, reverse=True)[:most]


def _on_print(places: IntArray, target: Charuco | AprilGrid) -> FloatArray:
    """Places (n, 2) on the print, in pitches, of corners given by column and row (n, 2)."""
    if isinstance(target, AprilGrid):
        return target.line_mm(places) / target.pitch_mm
    return places.astype(np.float64) + 1.0


@lru_cache(maxsize=8)
def _markers(target: Charuco | AprilGrid) -> Markers:
    if isinstance(target, AprilGrid):
        numbers = target.tag_numbers
        tags = np.array([~target.tag(number)[1:-1, 1:-1] for number in numbers.ravel().tolist()])
        return Markers(tags, 2 * np.argwhere(numbers >= 0)[:, ::-1], 1.0, parity=0, every_other=True)
    return Markers(
        target.markers[:, 1:-1, 1:-1], target.marker_squares[:, ::-1] - 1, target.marker_mm / target.square_mm, parity=1
    )


def _from_markers(grey: Grey, target: Charuco | AprilGrid, known: list[Corners], *, mirrored: bool) -> list[Corners]:
    """Return the known boards and those grown from single markers that these do not show."""
    ids, quads = find_markers(grey, target, mirrored=mirrored)
    places = marker_places(target)[ids]
    picture = np.asarray(grey, dtype=np.float32)
    found = list(known)
    taken = np.zeros(len(ids), dtype=bool)
    for board in known:
        taken |= _on_board(board, places, quads, target)
    queue = groups(places, quads)
    while queue:
        members = queue.pop(0)
        members = members[~taken[members]]
        if len(members) < MIN_MARKERS:
            continue
        known_places, known_pixels = places[members].reshape(-1, 2), quads[members].reshape(-1, 2)
        board = grow_board(picture, known_places, known_pixels, target, mirrored=mirrored)
        if not len(board) or any(same_board(board, other) for other in found):
            continue
        found.append(board)
        on_board = _on_board(board, places, quads, target)
        taken |= on_board
        # A group may hold two boards that seem to continue each other; one of them is found now.
        remaining = members[~on_board[members]]
        if MIN_MARKERS <= len(remaining) < len(members):
            queue = [remaining[part] for part in groups(places[remaining], quads[remaining])] + queue
    return found


def _on_board(board: Corners, places: FloatArray, quads: FloatArray, target: Charuco | AprilGrid) -> BoolArray:
    """Mask of the markers (n, 4, 2), with places (n, 4, 2) on the print, that match a detected board."""
    warp = BoardWarp.through(corner_places(target)[board.ids], board.pixels)
    if warp is None:
        return np.zeros(len(places), dtype=bool)
    centres = places.mean(axis=1)
    cells, _ = warp.shapes(centres)
    distance = np.linalg.norm(warp.at(centres) - quads.mean(axis=1), axis=1)
    return np.asarray(distance < MAX_OFFSET * np.sqrt(np.abs(np.linalg.det(cells))))


def marker_places(target: Charuco | AprilGrid) -> FloatArray:
    """Corners (markers, 4, 2) of the markers in squares from the print's top left, in the detector's order."""
    if isinstance(target, AprilGrid):
        # OpenCV numbers a tag's corners from the top left as it draws the tag, half a turn from the print.
        numbers = target.tag_numbers.ravel().argsort()
        low = 2 * np.stack([numbers % target.cols, numbers // target.cols], axis=1)
        return target.line_mm(low[:, None] + np.array([[1, 1], [0, 1], [0, 0], [1, 0]])) / target.pitch_mm
    half = target.marker_mm / target.square_mm / 2.0
    centres = target.marker_squares[:, None, ::-1] + 0.5
    return np.asarray(centres + half * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]))


def find_markers(grey: Grey, target: Charuco | AprilGrid, *, mirrored: bool) -> tuple[IntArray, FloatArray]:
    """Return numbers (n,), from 0 and with repetitions, and corners (n, 4, 2) of the target's markers.

    A few suffice to grow boards; if there are too few, other window sizes are tried.
    """
    bright, parameters = _prepared(grey, mirrored=mirrored)
    parameters.markerBorderBits = TAG_BORDER if isinstance(target, AprilGrid) else 1
    dictionary, first, count = _dictionary(target)
    for window_px in WINDOWS_PX:
        parameters.adaptiveThreshWinSizeMin = parameters.adaptiveThreshWinSizeMax = window_px
        detector = cv2.aruco.ArucoDetector(dictionary, parameters)
        quads, ids, _ = detector.detectMarkers(bright)
        numbers = (np.empty(0, dtype=np.int64) if ids is None else np.asarray(ids, dtype=np.int64).ravel()) - first
        known = (numbers >= 0) & (numbers < count)
        if known.sum() >= MIN_MARKERS:
            break
    corners = np.array(quads, dtype=np.float64).reshape(-1, 4, 2)
    if mirrored:
        corners[..., 0] = grey.shape[1] - 1 - corners[..., 0]
    return numbers[known], corners[known]


def families_seen(grey: Grey, families: Sequence[str], first: int, *, mirrored: bool) -> IntArray:
    """Count, for each of some dictionary families (f,), how many of its first markers a picture shows."""
    bright, parameters = _prepared(grey, mirrored=mirrored)
    parameters.adaptiveThreshWinSizeMin = parameters.adaptiveThreshWinSizeMax = WINDOWS_PX[0]
    detector = cv2.aruco.ArucoDetector([dictionaries.dictionary(name, first) for name in families], parameters)
    _, _, _, seen = detector.detectMarkersMultiDict(bright)
    return np.bincount(np.zeros(0, np.int64) if seen is None else np.ravel(seen), minlength=len(families))


def _prepared(grey: Grey, *, mirrored: bool) -> tuple[Grey, cv2.aruco.DetectorParameters]:
    """Return the picture, brightened and flipped if mirrored, and the marker detector's parameters."""
    image = cv2.flip(grey, 1) if mirrored else grey
    white = float(np.quantile(image[::4, ::4], WHITE_QUANTILE))
    parameters = cv2.aruco.DetectorParameters()
    parameters.minMarkerPerimeterRate = MIN_PERIMETER
    return np.asarray(cv2.convertScaleAbs(image, alpha=255.0 / max(white, 16.0)), dtype=np.uint8), parameters


def _dictionary(target: Charuco | AprilGrid) -> tuple[cv2.aruco.Dictionary, int, int]:
    """Return OpenCV's dictionary for a print's markers, the id of the first one, and their number."""
    if isinstance(target, AprilGrid):
        return TAG_FAMILY, 0, target.cols * target.rows
    return dictionaries.dictionary(target.dictionary), target.first_marker, len(target.markers)


def groups(places: FloatArray, quads: FloatArray) -> list[IntArray]:
    """Group markers (n, 4, 2) with places (n, 4, 2) on the print into boards whose markers predict each other."""
    if not len(places):
        return []
    count, labels = connected_components(linked_markers(places, quads), directed=False)
    members = [np.flatnonzero(labels == label) for label in range(count)]
    return [m for m in sorted(members, key=len, reverse=True) if len(m) >= MIN_MARKERS]


def marker_maps(place: FloatArray, quads: FloatArray) -> FloatArray:
    """Linear maps (n, 2, 2), px per square, from a marker's corners (4, 2) on the print to detected ones (n, 4, 2)."""
    sides = place - place.mean(axis=0)
    seen = quads - quads.mean(axis=1, keepdims=True)
    return np.asarray(np.einsum("nij,ik->njk", seen, sides @ np.linalg.inv(sides.T @ sides)))


def linked_markers(places: FloatArray, quads: FloatArray) -> csr_array:
    """Symmetric matrix (n, n) of the markers (n, 4, 2), with places (n, 4, 2) on the print, that predict each other.

    The affine map of each marker predicts the positions of its neighbours on the print; two markers that agree belong
    to one board. A misread marker agrees with none.
    """
    centres, centres_px = places.mean(axis=1), quads.mean(axis=1)
    affine = marker_maps(places[0], quads)
    squares_apart = centres[None] - centres[:, None]
    distance = np.linalg.norm(squares_apart, axis=2)
    first, second = np.nonzero((distance > 0.5) & (distance < NEIGHBOUR_SQUARES))
    expected = centres_px[first] + np.einsum("njk,nk->nj", affine[first], squares_apart[first, second])
    cell = np.sqrt(np.abs(np.linalg.det(affine)))
    error = np.linalg.norm(expected - centres_px[second], axis=1) / cell[first]
    agree = error < PREDICTION_ERROR * distance[first, second] + 0.1
    matrix = coo_array((agree.astype(float), (first, second)), shape=(len(places),) * 2).tocsr()
    return matrix.multiply(matrix.T)


def linked_tags(grey: Grey, target: AprilGrid) -> list[tuple[IntArray, FloatArray]]:
    """Return places (n, 2) of corners on separate grids, and their approximate pixels (n, 2).

    The places are those of `corner_grids`, with tags beginning at odd x and even y.
    """
    points = saddle_points(grey)
    found = []
    for members, places in corner_grids(points, alternating=True):
        aligned = _aligned_with_tags(places, points.pixels[members], target)
        if aligned is None:
            continue
        # Lines of corners on a print whose first tag begins at (1, 0).
        on_print = target.line_mm(aligned - np.array([1, 0])) / target.pitch_mm
        parts = smooth_parts(on_print, points.pixels[members], target.longest_step)
        found += [(aligned[part], points.pixels[members[part]]) for part in parts]
    return found


def _aligned_with_tags(places: IntArray, pixels: FloatArray, target: AprilGrid) -> IntArray | None:
    """Shift the places so that tags begin at odd x and even y; None unless widths alternate as on the print."""
    order = {(x, y): number for number, (x, y) in enumerate(places.tolist())}
    ratios = []
    for axis, wide in ((0, 1), (1, 0)):
        step = np.eye(2, dtype=np.int64)[axis]
        sides: tuple[list[float], list[float]] = ([], [])
        for (x, y), number in order.items():
            following = order.get((x + int(step[0]), y + int(step[1])))
            if following is not None:
                length = float(np.linalg.norm(pixels[following] - pixels[number]))
                sides[((x, y)[axis] + wide) % 2].append(np.log(max(length, 1e-6)))
        if sides[0] and sides[1]:
            ratios.append(float(np.median(sides[0]) - np.median(sides[1])))
    if not ratios or abs(np.mean(ratios)) < MIN_LOG_RATIO * -np.log(target.spacing):
        return None
    return places if np.mean(ratios) > 0 else places + 1
