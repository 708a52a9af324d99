"""ChArUco boards in one image, as many as there are: markers, found once, are grouped by the boards they belong to."""

from __future__ import annotations

import cv2
import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from mirrorcam.optics.base.values import FloatArray
from mirrorcam.optics.calibration.detection.board_growing import (
    BoolArray,
    corner_places,
    grow,
    same_board,
    warp_through,
)
from mirrorcam.optics.calibration.detection.checkerboard import Grey
from mirrorcam.optics.calibration.solver.observations import Corners, IntArray
from mirrorcam.optics.geometry.targets import Charuco

WHITE_PART = 0.995  # of the pixels that are at most as bright as white is taken to be
WINDOWS_PX = (15, 31, 7)  # sides of the neighbourhood that a pixel is compared with, tried in turn
LEAST_PERIMETER = 0.01  # of a marker, in sides of the picture
NEAR = 2.3  # squares between the middles of markers that tell of each other
FORETOLD = 0.12  # squares by which a marker may be off where another one foretells it, per square between them
FEWEST_MARKERS = 2
SAME_PLACE = 0.3  # squares between a marker and where a board has it, for it to be the board's


def find_boards(grey: Grey, target: Charuco, *, mirrored: bool, most: int) -> list[Corners]:
    """Up to `most` boards in a picture, those with most corners first; `mirrored` where it shows them through a mirror.

    A mirrored marker is no marker, so the picture is flipped for the search of markers and what is found flipped back.
    """
    ids, quads = find_markers(grey, target, mirrored=mirrored)
    places = marker_places(target)[ids]
    picture = np.asarray(grey, dtype=np.float32)
    found: list[Corners] = []
    taken = np.zeros(len(ids), dtype=bool)
    waiting = groups(places, quads)
    while waiting:
        members = waiting.pop(0)
        members = members[~taken[members]]
        if len(members) < FEWEST_MARKERS:
            continue
        at, seen = places[members].reshape(-1, 2), quads[members].reshape(-1, 2)
        board = grow(picture, at, seen, target, mirrored=mirrored)
        if not len(board) or any(same_board(board, other) for other in found):
            continue
        found.append(board)
        shown = _shown(board, places, quads, target)
        taken |= shown
        # A group that was two boards', which seemed to go on in each other, has given one of them.
        rest = members[~shown[members]]
        if FEWEST_MARKERS <= len(rest) < len(members):
            waiting = [rest[part] for part in groups(places[rest], quads[rest])] + waiting
    return sorted(found, key=len, reverse=True)[:most]


def _shown(board: Corners, places: FloatArray, quads: FloatArray, target: Charuco) -> BoolArray:
    """Which markers (n, 4, 2) at places (n, 4, 2) are where a board that was found has them."""
    warp = warp_through(corner_places(target)[board.ids], board.pixels)
    if warp is None:
        return np.zeros(len(places), dtype=bool)
    middles = places.mean(axis=1)
    cells, _ = warp.shapes(middles)
    off = np.linalg.norm(warp.at(middles) - quads.mean(axis=1), axis=1)
    return np.asarray(off < SAME_PLACE * np.sqrt(np.abs(np.linalg.det(cells))))


def marker_places(target: Charuco) -> FloatArray:
    """Corners (markers, 4, 2) of the markers in squares from the top left of the print, in the detector's order."""
    return np.array(target.opencv.getObjPoints())[:, :, :2] / target.square_mm


def find_markers(grey: Grey, target: Charuco, *, mirrored: bool) -> tuple[IntArray, FloatArray]:
    """Ids (n,) and corners (n, 4, 2) of markers of the target, each as often as it is found.

    Not all need to be found, as boards are grown from a few; where there is none, smaller and larger neighbourhoods are
    tried, in which a pixel counts as black.
    """
    image = cv2.flip(grey, 1) if mirrored else grey
    white = float(np.quantile(image[::4, ::4], WHITE_PART))
    bright = cv2.convertScaleAbs(image, alpha=255.0 / max(white, 16.0))
    parameters = cv2.aruco.DetectorParameters()
    parameters.minMarkerPerimeterRate = LEAST_PERIMETER
    for window_px in WINDOWS_PX:
        parameters.adaptiveThreshWinSizeMin = parameters.adaptiveThreshWinSizeMax = window_px
        detector = cv2.aruco.ArucoDetector(target.opencv.getDictionary(), parameters)
        quads, ids, _ = detector.detectMarkers(bright)
        names = np.empty(0, dtype=np.int64) if ids is None else np.asarray(ids, dtype=np.int64).ravel()
        known = names < len(target.opencv.getIds())
        if known.sum() >= FEWEST_MARKERS:
            break
    corners = np.array(quads, dtype=np.float64).reshape(-1, 4, 2)
    if mirrored:
        corners[..., 0] = grey.shape[1] - 1 - corners[..., 0]
    return names[known], corners[known]


def groups(places: FloatArray, quads: FloatArray) -> list[IntArray]:
    """Markers (n, 4, 2) at places (n, 4, 2) on the print, grouped by boards: those that foretell each other's place.

    The affine map of each marker says where its neighbours on the print should be; two that agree on that are of one
    board. A marker that was read wrongly agrees with none.
    """
    if not len(places):
        return []
    middles, centres = places.mean(axis=1), quads.mean(axis=1)
    # Least squares of the four corners: px per square.
    sides = places[0] - middles[0]
    affine = np.einsum("nij,ik->njk", quads - centres[:, None], sides @ np.linalg.inv(sides.T @ sides))
    squares_apart = middles[None] - middles[:, None]
    distance = np.linalg.norm(squares_apart, axis=2)
    first, second = np.nonzero((distance > 0.5) & (distance < NEAR))
    expected = centres[first] + np.einsum("njk,nk->nj", affine[first], squares_apart[first, second])
    cell = np.sqrt(np.abs(np.linalg.det(affine)))
    off = np.linalg.norm(expected - centres[second], axis=1) / cell[first]
    agree = off < FORETOLD * distance[first, second] + 0.1
    matrix = coo_array((agree.astype(float), (first, second)), shape=(len(places),) * 2).tocsr()
    mutual = matrix.multiply(matrix.T)
    count, labels = connected_components(mutual, directed=False)
    members = [np.flatnonzero(labels == label) for label in range(count)]
    return [m for m in sorted(members, key=len, reverse=True) if len(m) >= FEWEST_MARKERS]
