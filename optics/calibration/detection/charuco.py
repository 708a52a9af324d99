"""Detection of ChArUco boards or AprilGrids in a picture, from grids of corners and the markers between them.

An AprilGrid is a checkerboard with columns and rows alternately as wide as a gap and a tag. The widths show which are
tags, so corners get coordinates on the print up to a shift by entire tags, and a smooth warp maps them to the picture.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import cv2
import numpy as np
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import connected_components

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.detection.blurred_print import Image
from mirrorcam.optics.calibration.detection.board_growing import (
    BoolArray,
    grow_board,
    same_board,
)
from mirrorcam.optics.calibration.detection.board_warp import BoardWarp, corner_print_xy
from mirrorcam.optics.calibration.detection.checkerboard import Grey, has_new_corners, linked_grids, smooth_parts
from mirrorcam.optics.calibration.detection.corner_grids import corner_grids, saddle_points
from mirrorcam.optics.calibration.detection.detections import NO_LIMITS, DetectedGrid
from mirrorcam.optics.calibration.detection.marker_numbering import Markers, module_greys, numbered_by_markers
from mirrorcam.optics.calibration.solver.observations import Corners, IntArray
from mirrorcam.optics.geometry import marker_dictionaries as dictionaries
from mirrorcam.optics.geometry.boards import TAG_BORDER, TAG_FAMILY, TAG_FAMILY_NAME, AprilGrid, Charuco

WHITE_QUANTILE = 0.995
WINDOWS_PX = (15, 31, 7)  # sides of the adaptive threshold's window, tried in turn
MIN_PERIMETER = 0.01  # of a marker, relative to the picture's longer side
NEIGHBOUR_SQUARES = 2.3  # squares between the centres of markers that predict each other
PREDICTION_ERROR = 0.12  # error of a marker's predicted position, per square between the two markers
MIN_MARKERS = 2
ROW_BY_ROW = [0, 1, 3, 2]  # of corners in clockwise order
MIN_MARKER_CONTRAST = 20.0  # of a marker's modules, of 255
MAX_BORDER_ERRORS, CORRECTION_RATE = 0.35, 0.6  # OpenCV's defaults, relative to its modules, and to correctable ones
MAX_OFFSET = 0.3  # of a marker from its expected position on the board that holds it, in squares
MIN_LOG_RATIO = 0.5  # of tag to gap in the picture, relative to the print
MIN_SIDES, MAX_SPREAD = 6, 0.2  # sides of each kind on a grid; spread of their ratios relative to the logarithmic ratio


def find_marked_boards(grey: Grey, board: Charuco | AprilGrid, *, mirrored: bool, max_boards: int) -> list[Corners]:
    """Find up to `max_boards` boards in a picture, those with most corners first.

    Grids of saddle points are numbered by the markers between them. If fewer than half of the boards are found this
    way, as happens if markers nearly touch the corners, boards are also grown from single markers.

    Parameters
    ----------
    grey
        Picture (h, w).
    board
        The board.
    mirrored
        Whether the boards appear in mirrors.
    max_boards
        Maximum number of boards to return.
    """
    picture = np.asarray(grey, dtype=np.float32)
    found: list[Corners] = []
    markers = _markers(board)
    for grid_xy, pixels in linked_grids(grey) if isinstance(board, Charuco) else linked_tags(grey, board):
        if not has_new_corners(pixels, found):
            continue
        grid = DetectedGrid(grid_xy, Corners(np.arange(len(grid_xy)), pixels), NO_LIMITS)
        numbered = numbered_by_markers(picture, grid.as_printed if mirrored else grid, markers)
        if numbered is None:
            continue
        detected = grow_board(picture, _print_xy(numbered.grid_xy, board), pixels, board, mirrored=mirrored)
        if len(detected) and not any(same_board(detected, other) for other in found):
            found.append(detected)
    if 2 * len(found) < max_boards:
        found = _from_markers(grey, board, found, mirrored=mirrored)
    return sorted(found, key=len, reverse=True)[:max_boards]


def _print_xy(grid_xy: IntArray, board: Charuco | AprilGrid) -> FloatArray:
    """Coordinates (n, 2) on the print, in pitches, of corners given by column and row (n, 2)."""
    if isinstance(board, AprilGrid):
        return board.line_mm(grid_xy) / board.pitch_mm
    return grid_xy.astype(np.float64) + 1.0


@lru_cache(maxsize=8)
def _markers(board: Charuco | AprilGrid) -> Markers:
    if isinstance(board, AprilGrid):
        numbers = board.tag_numbers
        tags = np.array([~board.tag(number)[1:-1, 1:-1] for number in numbers.ravel().tolist()])
        return Markers(tags, 2 * np.argwhere(numbers >= 0)[:, ::-1], 1.0, parity=0, every_other=True)
    return Markers(
        board.markers[:, 1:-1, 1:-1],
        board.marker_squares[:, ::-1] - 1,
        board.marker_mm / board.square_mm,
        parity=not board.inverted,
    )


def _from_markers(grey: Grey, board: Charuco | AprilGrid, boards: list[Corners], *, mirrored: bool) -> list[Corners]:
    """Return the known boards, and new ones grown from single markers that these do not contain."""
    ids, quads = find_markers(grey, board, mirrored=mirrored)
    print_quads = marker_corners(board)[ids]
    picture = np.asarray(grey, dtype=np.float32)
    found = list(boards)
    used = np.zeros(len(ids), dtype=bool)
    for detected in boards:
        used |= _on_board(detected, print_quads, quads, board)
    queue = groups(print_quads, quads)
    while queue:
        members = queue.pop(0)
        members = members[~used[members]]
        if len(members) < MIN_MARKERS:
            continue
        known_xy, known_pixels = print_quads[members].reshape(-1, 2), quads[members].reshape(-1, 2)
        detected = grow_board(picture, known_xy, known_pixels, board, mirrored=mirrored)
        if not len(detected) or any(same_board(detected, other) for other in found):
            continue
        found.append(detected)
        on_board = _on_board(detected, print_quads, quads, board)
        used |= on_board
        # A group may hold two boards that seem to continue each other; one of them is found now.
        remaining = members[~on_board[members]]
        if MIN_MARKERS <= len(remaining) < len(members):
            queue = [remaining[part] for part in groups(print_quads[remaining], quads[remaining])] + queue
    return found


def _on_board(detected: Corners, print_quads: FloatArray, quads: FloatArray, board: Charuco | AprilGrid) -> BoolArray:
    """Mask of the markers (n, 4, 2), with corners (n, 4, 2) on the print, that match a detected board."""
    warp = BoardWarp.fit(corner_print_xy(board)[detected.ids], detected.pixels)
    if warp is None:
        return np.zeros(len(print_quads), dtype=bool)
    centres = print_quads.mean(axis=1)
    cells, _ = warp.derivatives(centres)
    distance = np.linalg.norm(warp.map(centres) - quads.mean(axis=1), axis=1)
    return np.asarray(distance < MAX_OFFSET * np.sqrt(np.abs(np.linalg.det(cells))))


def marker_corners(board: Charuco | AprilGrid) -> FloatArray:
    """Corners (m, 4, 2) of the markers, in squares from the print's top left, in the detector's order."""
    if isinstance(board, AprilGrid):
        # OpenCV numbers a tag's corners from the top left of its own drawing, which the print shows rotated by 180 deg.
        numbers = board.tag_numbers.ravel().argsort()
        low = 2 * np.stack([numbers % board.cols, numbers // board.cols], axis=1)
        return board.line_mm(low[:, None] + np.array([[1, 1], [0, 1], [0, 0], [1, 0]])) / board.pitch_mm
    half = board.marker_mm / board.square_mm / 2.0
    centres = board.marker_squares[:, None, ::-1] + 0.5
    return np.asarray(centres + half * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]))


def find_markers(grey: Grey, board: Charuco | AprilGrid, *, mirrored: bool) -> tuple[IntArray, FloatArray]:
    """Return numbers (n,), from 0 and with repetitions, and corners (n, 4, 2) of the detected markers of the board.

    A few suffice to grow boards; if there are too few, other window sizes are tried.
    """
    inverted = isinstance(board, Charuco) and board.inverted
    bright, parameters = _prepared(np.asarray(255 - grey, dtype=np.uint8) if inverted else grey, mirrored=mirrored)
    parameters.markerBorderBits = TAG_BORDER if isinstance(board, AprilGrid) else 1
    dictionary, first, count = _dictionary(board)
    for window_px in WINDOWS_PX:
        parameters.adaptiveThreshWinSizeMin = parameters.adaptiveThreshWinSizeMax = window_px
        detector = cv2.aruco.ArucoDetector(dictionary, parameters)
        quads, ids, _ = detector.detectMarkers(bright)
        numbers = (np.empty(0, dtype=np.int64) if ids is None else np.asarray(ids, dtype=np.int64).ravel()) - first
        valid = (numbers >= 0) & (numbers < count)
        if valid.sum() >= MIN_MARKERS:
            break
    corners = np.array(quads, dtype=np.float64).reshape(-1, 4, 2)
    if mirrored:
        corners[..., 0] = grey.shape[1] - 1 - corners[..., 0]
    return numbers[valid], corners[valid]


def find_any_markers(grey: Grey, board: Charuco | AprilGrid, *, mirrored: bool) -> tuple[IntArray, FloatArray]:
    """Return ids (n,), with repetitions, and corners (n, 4, 2) of all markers of the family of a board.

    OpenCV finds the quadrilaterals; its comparison with the markers, one by one, would take seconds for a family.
    """
    if isinstance(board, AprilGrid):
        name, border = TAG_FAMILY_NAME, TAG_BORDER
    else:
        name, border = dictionaries.family(board.dictionary), 1
    inverted = isinstance(board, Charuco) and board.inverted
    source = np.asarray(255 - grey, dtype=np.uint8) if inverted else grey
    for window_px in WINDOWS_PX:
        picture, quads = _quads(source, window_px, mirrored=mirrored)
        ids, corners = _matching(picture, quads, name, border)
        if len(ids) >= MIN_MARKERS:
            break
    if mirrored:
        corners[..., 0] = grey.shape[1] - 1 - corners[..., 0]
    return ids, corners


def count_by_family(grey: Grey, families: Sequence[str], *, mirrored: bool) -> IntArray:
    """Count (f,) how many markers of each dictionary family a picture shows."""
    picture, quads = _quads(grey, WINDOWS_PX[0], mirrored=mirrored)
    return np.array([len(_matching(picture, quads, name, 1)[0]) for name in families])


def _quads(grey: Grey, window_px: int, *, mirrored: bool) -> tuple[Image, FloatArray]:
    """Return the picture, brightened and flipped if mirrored, and quadrilaterals (n, 4, 2) in it, clockwise."""
    bright, parameters = _prepared(grey, mirrored=mirrored)
    parameters.adaptiveThreshWinSizeMin = parameters.adaptiveThreshWinSizeMax = window_px
    detector = cv2.aruco.ArucoDetector(dictionaries.dictionary(dictionaries.FAMILIES[0], 1), parameters)
    identified, _, others = detector.detectMarkers(bright)
    return np.asarray(bright, dtype=np.float32), np.array([*identified, *others], dtype=np.float64).reshape(-1, 4, 2)


def _matching(picture: Image, quads: FloatArray, family: str, border: int) -> tuple[IntArray, FloatArray]:
    """Return ids (m,) and corners (m, 4, 2) of the quadrilaterals (n, 4, 2) with markers, by OpenCV's criteria.

    The corners start at the marker's top left; `border` is the width of its black border in modules.
    """
    white = dictionaries.white_modules(family)[:, 1:-1, 1:-1]
    inside, side = white.shape[1], white.shape[1] + 2 * border
    greys = module_greys(picture, quads[:, ROW_BY_ROW], side, (side + 2) / side).reshape(-1, side, side)
    darkest, brightest = greys.min(axis=(1, 2)), greys.max(axis=(1, 2))
    bright = greys > ((darkest + brightest) / 2.0)[:, None, None]
    inner = bright[:, border:-border, border:-border]
    border_errors = bright.sum(axis=(1, 2)) - inner.sum(axis=(1, 2))
    likely = (brightest - darkest > MIN_MARKER_CONTRAST) & (border_errors <= MAX_BORDER_ERRORS * inside**2)
    read, codes = (np.where(bits, 1.0, -1.0).astype(np.float32) for bits in (inner[likely], white))
    rotated = np.stack([np.rot90(read, turn, axes=(1, 2)).reshape(-1, inside**2) for turn in range(4)])
    agreement = (rotated @ codes.reshape(len(codes), -1).T).swapaxes(0, 1).reshape(len(read), 4 * len(codes))
    turns, ids = np.divmod(agreement.argmax(axis=1), len(codes))
    max_errors = int(CORRECTION_RATE * dictionaries.dictionary(family).maxCorrectionBits)
    valid = agreement.max(axis=1) >= inside**2 - 2 * max_errors
    order = (np.arange(4) + turns[valid, None]) % 4
    return ids[valid], np.take_along_axis(quads[likely][valid], order[..., None], axis=1)


def _prepared(grey: Grey, *, mirrored: bool) -> tuple[Grey, cv2.aruco.DetectorParameters]:
    """Return the picture, brightened and flipped if mirrored, and the marker detector's parameters."""
    image = cv2.flip(grey, 1) if mirrored else grey
    white = float(np.quantile(image[::4, ::4], WHITE_QUANTILE))
    parameters = cv2.aruco.DetectorParameters()
    parameters.minMarkerPerimeterRate = MIN_PERIMETER
    return np.asarray(cv2.convertScaleAbs(image, alpha=255.0 / max(white, 16.0)), dtype=np.uint8), parameters


def _dictionary(board: Charuco | AprilGrid) -> tuple[cv2.aruco.Dictionary, int, int]:
    """Return OpenCV's dictionary for a print's markers, the id of the first one, and their number."""
    if isinstance(board, AprilGrid):
        return TAG_FAMILY, 0, board.cols * board.rows
    return dictionaries.dictionary(board.dictionary), board.first_marker, len(board.markers)


def groups(print_quads: FloatArray, quads: FloatArray) -> list[IntArray]:
    """Group markers (n, 4, 2) with corners (n, 4, 2) on the print into boards whose markers predict each other."""
    if not len(print_quads):
        return []
    count, labels = connected_components(linked_markers(print_quads, quads), directed=False)
    members = [np.flatnonzero(labels == label) for label in range(count)]
    return [m for m in sorted(members, key=len, reverse=True) if len(m) >= MIN_MARKERS]


def marker_maps(print_quad: FloatArray, quads: FloatArray) -> FloatArray:
    """Linear maps (n, 2, 2), px per square, from a marker's corners (4, 2) on the print to detected ones (n, 4, 2)."""
    printed = print_quad - print_quad.mean(axis=0)
    detected = quads - quads.mean(axis=1, keepdims=True)
    return np.asarray(np.einsum("nij,ik->njk", detected, printed @ np.linalg.inv(printed.T @ printed)))


def linked_markers(print_quads: FloatArray, quads: FloatArray) -> csr_array:
    """Adjacency matrix (n, n) of markers (n, 4, 2), with corners (n, 4, 2) on the print, that predict each other.

    The affine map of each marker predicts the positions of its neighbours on the print; two markers that agree belong
    to one board. A misread marker agrees with none.
    """
    centres, centres_px = print_quads.mean(axis=1), quads.mean(axis=1)
    affine = marker_maps(print_quads[0], quads)
    offsets = centres[None] - centres[:, None]
    distance = np.linalg.norm(offsets, axis=2)
    first, second = np.nonzero((distance > 0.5) & (distance < NEIGHBOUR_SQUARES))
    expected = centres_px[first] + np.einsum("njk,nk->nj", affine[first], offsets[first, second])
    cell = np.sqrt(np.abs(np.linalg.det(affine)))
    error = np.linalg.norm(expected - centres_px[second], axis=1) / cell[first]
    agree = error < PREDICTION_ERROR * distance[first, second] + 0.1
    matrix = coo_array((agree.astype(float), (first, second)), shape=(len(print_quads),) * 2).tocsr()
    return matrix.multiply(matrix.T)


def linked_tags(grey: Grey, board: AprilGrid) -> list[tuple[IntArray, FloatArray]]:
    """Return grid coordinates (n, 2) of corners on separate grids, and their approximate pixels (n, 2).

    The coordinates are those of `corner_grids`, shifted so that tags begin at odd x and even y.
    """
    points = saddle_points(grey)
    found = []
    for members, grid_xy in corner_grids(points, alternating=True):
        aligned = _aligned_with_tags(grid_xy, points.pixels[members], board)
        if aligned is None:
            continue
        # Lines of corners on a print whose first tag begins at (1, 0).
        print_xy = board.line_mm(aligned - np.array([1, 0])) / board.pitch_mm
        parts = smooth_parts(print_xy, points.pixels[members], board.longest_step)
        found += [(aligned[part], points.pixels[members[part]]) for part in parts]
    return found


def _aligned_with_tags(grid_xy: IntArray, pixels: FloatArray, board: AprilGrid) -> IntArray | None:
    """Shift the coordinates so that tags begin at odd x and even y; None unless widths alternate as on the print."""
    index = {(x, y): number for number, (x, y) in enumerate(grid_xy.tolist())}
    ratios = []
    for axis, tag_parity in ((0, 1), (1, 0)):
        step = np.eye(2, dtype=np.int64)[axis]
        sides: tuple[list[float], list[float]] = ([], [])
        for (x, y), number in index.items():
            following = index.get((x + int(step[0]), y + int(step[1])))
            if following is not None:
                length = float(np.linalg.norm(pixels[following] - pixels[number]))
                sides[((x, y)[axis] + tag_parity) % 2].append(np.log(max(length, 1e-6)))
        if sides[0] and sides[1]:
            ratios.append(float(np.median(sides[0]) - np.median(sides[1])))
    if not ratios or abs(np.mean(ratios)) < MIN_LOG_RATIO * -np.log(board.spacing):
        return None
    return grid_xy if np.mean(ratios) > 0 else grid_xy + 1


def tag_spacing(grey: Grey) -> float | None:
    """Estimate the gap between the tags of an AprilGrid in a picture, in sides of a tag; None if it shows too few.

    Each side of a square is compared with the geometric mean of the sides before and after it on its line, so that
    perspective cancels. Tags have larger ratios than gaps; both deviate from 1 by the same factor.
    """
    points = saddle_points(grey)
    tags, gaps = [], []
    for members, grid_xy in corner_grids(points, alternating=True):
        index = {
            place: points.pixels[member] for place, member in zip(map(tuple, grid_xy.tolist()), members, strict=True)
        }
        for axis in range(2):
            by_parity: tuple[list[float], list[float]] = ([], [])
            for place in index:
                line = [tuple(np.add(place, step * np.eye(2, dtype=np.int64)[axis]).tolist()) for step in range(-1, 3)]
                if all(corner in index for corner in line):
                    sides = np.linalg.norm(np.diff([index[corner] for corner in line], axis=0), axis=1)
                    by_parity[place[axis] % 2].append(float(np.log(sides[1] / np.sqrt(sides[0] * sides[2]))))
            if min(map(len, by_parity)) >= MIN_SIDES:
                shorter, longer = sorted(by_parity, key=np.median)
                gaps += shorter
                tags += longer
    if min(len(tags), len(gaps)) < 2 * MIN_SIDES:
        return None
    spread = max(np.median(np.abs(np.array(ratios) - np.median(ratios))) for ratios in (tags, gaps))
    log_spacing = (np.median(gaps) - np.median(tags)) / 2.0
    return float(np.exp(log_spacing)) if spread < MAX_SPREAD * -log_spacing else None
