"""A board in one image, grown from a few places that are known on it to every corner that can be seen."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from mirrorcam.optics.base.values import FloatArray
from mirrorcam.optics.calibration.detection.corner_refinement import GhostImages, Image, RefinedCorners, refine
from mirrorcam.optics.calibration.solver.observations import Corners, IntArray
from mirrorcam.optics.geometry.targets import Target

BoolArray = NDArray[np.bool_]

REACH = 1.6  # squares from what is known that the board's shape is trusted to go on
MOST_MOVED = 0.25  # cells between where a corner is expected and where it is found
MOST_OFF = 0.12  # cells between a corner and a smooth surface through the others
ROUNDS = 15
TRIES = 2  # of a corner: where it is expected is known better once those around are found
NEIGHBOURS = 12
OUTLIER_SIGMAS = 6.0
LEAST_OUTLIER_PX = 0.1
LEAST_STEP_PX, MOST_STEP_PX = 0.2, 1.5  # between neighbours, off their smooth shape
FEWEST_PLACES = 4
SMALLEST_CELL_PX = 5.0
FIRST_BLUR_PX = 1.2  # sigma that the first corners are looked for with
LEAST_GREY = 6.0  # contrast of a corner in grey levels
LEAST_CONTRAST = 0.6  # of that of the corners around
LEAST_EXPLAINED = 0.8  # of the variance around a corner
MOST_SIGMA_PX = 0.3
MOST_UNSURE, MOST_UNLIKE = (
    2.5,
    3.0,
)  # times the board's median, of what is expected to be off and of what is unexplained
UNEXPLAINED = 0.01
NONE = Corners(np.empty(0, dtype=np.int64), np.empty((0, 2)))


@dataclass(frozen=True)
class Warp:
    """Where a board's points, in squares from its top left, appear: a projective map and a smooth cubic beyond it.

    The cubic is what a lens, a bent board or mirror and a rolling shutter add; of few places it is left out.
    """

    homography: FloatArray
    middle: FloatArray
    half: float
    cubic: FloatArray

    @classmethod
    def through(cls, places: FloatArray, pixels: FloatArray, off_px: float) -> Warp | None:
        """The warp of places (n, 2) in squares to pixels (n, 2), of which some may be wrong by more than `off_px`."""
        if len(places) < FEWEST_PLACES:
            return None
        homography, _ = cv2.findHomography(places, pixels, cv2.RANSAC, off_px, None, 2000, 0.9999)
        if homography is None:
            return None
        middle = places.mean(axis=0)
        half = max(float(np.abs(places - middle).max()), 1.0)
        warp = cls(np.asarray(homography), middle, half, np.zeros((10, 2)))
        if len(places) < 24:
            return warp
        # Robustly (Cauchy), for outliers that are still there.
        off = pixels - warp.at(places)
        terms = warp._terms(places)
        weights = 1.0 / (1.0 + (np.linalg.norm(off, axis=1) / off_px) ** 2)
        ridge = 1e-3 * np.eye(10)
        cubic = np.zeros((10, 2))
        for _ in range(3):
            weighted = terms * weights[:, None]
            cubic = np.linalg.solve(terms.T @ weighted + ridge, weighted.T @ off)
            rest = np.linalg.norm(off - terms @ cubic, axis=1)
            scale = max(3.0 * 1.4826 * float(np.median(rest)), 0.02)
            weights = 1.0 / (1.0 + (rest / scale) ** 2)
        return cls(warp.homography, middle, half, cubic)

    def _terms(self, places: FloatArray) -> FloatArray:
        x, y = ((places - self.middle) / self.half).T
        return np.stack([np.ones_like(x), x, y, x * x, x * y, y * y, x**3, x * x * y, x * y * y, y**3], axis=1)

    def at(self, places: FloatArray) -> FloatArray:
        """Pixels (n, 2) of places (n, 2); NaN where they would lie behind the camera."""
        lifted = np.column_stack([places, np.ones(len(places))]) @ self.homography.T
        depth = np.where(lifted[:, 2:] > 1e-9, lifted[:, 2:], np.nan)
        return lifted[:, :2] / depth + self._terms(places) @ self.cubic

    def shapes(self, places: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Derivatives (n, 2, 2) of pixels by squares (columns: right, down), and half the second ones (n, 2, 3)."""
        step = 0.25
        right, down = np.array([step, 0.0]), np.array([0.0, step])
        here, east, west = self.at(places), self.at(places + right), self.at(places - right)
        south, north = self.at(places + down), self.at(places - down)
        mixed = self.at(places + right + down) + self.at(places - right - down)
        mixed -= self.at(places + right - down) + self.at(places - right + down)
        cells = np.stack([east - west, south - north], axis=2) / (2.0 * step)
        bends = np.stack([east + west - 2.0 * here, mixed / 2.0, south + north - 2.0 * here], axis=2)
        return cells, bends / (2.0 * step**2)


def corner_places(target: Target) -> FloatArray:
    """The inner corners (n, 2) in squares from the top left of the print, in the order of their ids."""
    return target.corners_in_board_mm[:, :2] / target.square_mm


def grow(picture: Image, places: FloatArray, pixels: FloatArray, target: Target, *, mirrored: bool) -> Corners:
    """All corners of one board that can be seen, from pixels (n, 2) roughly known at places (n, 2) in squares.

    Corners are looked for up to `REACH` squares around what is known; those that are found tell where the next ones
    are. At last all are refined once more, with the shape that they have together, and those that do not lie on a
    smooth surface with the others are dropped. None where the places do not lie on a surface that is turned the right
    way round.
    """
    corners = corner_places(target)
    found = np.full((len(corners), 2), np.nan)
    tries = np.zeros(len(corners), dtype=np.int64)
    known_places, known_pixels = places, pixels
    warp, blur_cells = None, FIRST_BLUR_PX / max(_typical_cell(places, pixels), SMALLEST_CELL_PX)
    for _ in range(ROUNDS):
        warp = warp_through(known_places, known_pixels)
        if warp is None:
            break
        near = cKDTree(known_places).query(corners, distance_upper_bound=REACH)[0] < REACH
        new = np.flatnonzero(near & (tries < TRIES) & np.isnan(found[:, 0]))
        if not len(new):
            break
        tries[new] += 1
        ids, seen = _look(picture, warp, new, warp.at(corners[new]), target, blur_cells, mirrored=mirrored)
        found[ids] = seen.pixels
        if len(ids):
            blur_cells = float(np.median(seen.blur_cells))
        have = np.flatnonzero(np.isfinite(found[:, 0]))
        if len(have) >= 2 * FEWEST_PLACES:
            known_places, known_pixels = corners[have], found[have]
    have = np.flatnonzero(np.isfinite(found[:, 0]))
    have = have[smooth(corners[have], found[have])]
    warp = warp_through(corners[have], found[have])
    if warp is None:
        return NONE
    ids, seen = _look(picture, warp, have, found[have], target, blur_cells, mirrored=mirrored)
    good = _as_bright(corners[ids], seen.contrast) & _like_the_others(seen)
    ids, pixels = ids[good], seen.pixels[good]
    good = smooth(corners[ids], pixels)
    return Corners(ids[good].astype(np.int64), pixels[good])


def again(
    picture: Image,
    corners: Corners,
    target: Target,
    copies: GhostImages,
    *,
    fit_strengths: bool = False,
    blur_cells: float | None = None,
) -> RefinedCorners | None:
    """The corners of a board, refined with the shape that they have together, among copies of the print.

    None where they have no shape together.
    """
    places = corner_places(target)[corners.ids]
    warp = warp_through(places, corners.pixels)
    if warp is None:
        return None
    cells, bends = warp.shapes(places)
    if blur_cells is None:
        blur_cells = FIRST_BLUR_PX / max(_typical_cell(places, corners.pixels), SMALLEST_CELL_PX)
    return refine(
        picture, places, corners.pixels, cells, bends, target, blur_cells, copies, fit_strengths=fit_strengths
    )


def _look(
    picture: Image,
    warp: Warp,
    ids: IntArray,
    start: FloatArray,
    target: Target,
    blur_cells: float,
    *,
    mirrored: bool,
) -> tuple[IntArray, RefinedCorners]:
    """Of the corners with `ids`, expected at pixels `start` (n, 2), those that are there."""
    corners = corner_places(target)
    cells, bends = warp.shapes(corners[ids])
    fits = _fits(start, cells, np.array(picture.shape[::-1], dtype=np.float64), mirrored=mirrored)
    ids, start, cells, bends = ids[fits], start[fits], cells[fits], bends[fits]
    seen = refine(picture, corners[ids], start, cells, bends, target, blur_cells)
    moved = np.linalg.norm(seen.pixels - start, axis=1)
    good = (moved < MOST_MOVED * _short_side(cells)) & (seen.contrast > LEAST_GREY)
    good &= (seen.explained > LEAST_EXPLAINED) & (seen.sigma_px < MOST_SIGMA_PX)
    return ids[good], seen.where(good)


def warp_through(places: FloatArray, pixels: FloatArray) -> Warp | None:
    """The warp of places (n, 2) in squares to pixels (n, 2), of which some may be wrong; None of too few."""
    if len(places) < FEWEST_PLACES:
        return None
    return Warp.through(places, pixels, max(MOST_OFF * _typical_cell(places, pixels), 1.0))


def same_board(first: Corners, second: Corners) -> bool:
    """Whether two boards of one picture are one: corners that both show are, mostly, in the same place."""
    _, a, b = np.intersect1d(first.ids, second.ids, return_indices=True)
    return len(a) > 0 and bool(np.median(np.linalg.norm(first.pixels[a] - second.pixels[b], axis=1)) < 2.0)


def _typical_cell(places: FloatArray, pixels: FloatArray) -> float:
    """Pixels per square, about."""
    spread = np.linalg.norm(pixels - pixels.mean(axis=0), axis=1).mean()
    return float(spread / max(np.linalg.norm(places - places.mean(axis=0), axis=1).mean(), 1e-9))


def _short_side(cells: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.norm(cells, axis=1).min(axis=1))


def _fits(expected: FloatArray, cells: FloatArray, size: FloatArray, *, mirrored: bool) -> BoolArray:
    """Which corners (n, 2) lie well inside the picture, with cells (n, 2, 2) large enough and the right way round."""
    handed = np.linalg.det(np.nan_to_num(cells)) * (-1.0 if mirrored else 1.0)
    short = _short_side(np.nan_to_num(cells))
    margin = np.maximum(0.5 * np.nan_to_num(np.linalg.norm(cells, axis=1)).max(axis=1), 3.0)[:, None]
    inside = (expected > margin) & (expected < size - 1.0 - margin)
    return np.asarray(inside.all(axis=1) & (handed > 0) & (short >= SMALLEST_CELL_PX))


def _neighbours(places: FloatArray) -> IntArray:
    """The nearest others (n, k) of places (n, 2)."""
    count = min(NEIGHBOURS, len(places) - 1)
    return np.asarray(cKDTree(places).query(places, k=count + 1)[1][:, 1:], dtype=np.int64)


def _as_bright(places: FloatArray, contrast: FloatArray) -> BoolArray:
    """Which corners have about the contrast of those around: what half covers one takes it away."""
    if len(places) < 2:
        return np.zeros(len(places), dtype=bool)
    around = np.median(contrast[_neighbours(places)], axis=1)
    return np.asarray(contrast > LEAST_CONTRAST * around)


def _like_the_others(seen: RefinedCorners) -> BoolArray:
    """Which corners are about as certain and as well explained as most of the board: glare spoils the others."""
    if not len(seen.pixels):
        return np.zeros(0, dtype=bool)
    rest = 1.0 - seen.explained
    sure = seen.sigma_px < MOST_UNSURE * np.median(seen.sigma_px)
    return np.asarray(sure & (rest < MOST_UNLIKE * np.median(rest) + UNEXPLAINED))


def _of_one_piece(places: FloatArray, pixels: FloatArray) -> BoolArray:
    """The largest part of corners that hang together: neighbours whose distance is that of the board's smooth shape.

    Two mirrors may show a board as if it went on from one to the other, but for a step of a few pixels. A smooth shape
    through both is off by different amounts on both sides of it.
    """
    warp = warp_through(places, pixels)
    if warp is None:
        return np.zeros(len(places), dtype=bool)
    off = pixels - warp.at(places)
    first, second = cKDTree(places).query_pairs(1.1, output_type="ndarray").T
    step = np.linalg.norm(off[first] - off[second], axis=1)
    linked = step < max(OUTLIER_SIGMAS * 1.4826 * float(np.median(step)) if len(step) else 0.0, LEAST_STEP_PX)
    linked &= step < MOST_STEP_PX
    graph = coo_array((np.ones(int(linked.sum())), (first[linked], second[linked])), shape=(len(places),) * 2)
    labels = connected_components(graph, directed=False)[1]
    return np.asarray(labels == np.bincount(labels).argmax())


def smooth(places: FloatArray, pixels: FloatArray) -> BoolArray:
    """Which corners lie on a smooth surface with the others, of the largest part that hangs together."""
    keep = np.zeros(len(places), dtype=bool)
    if len(places) < 2 * FEWEST_PLACES:
        return keep
    keep = _of_one_piece(places, pixels)
    for _ in range(5):
        if keep.sum() < 2 * FEWEST_PLACES:
            return np.zeros(len(places), dtype=bool)
        warp = warp_through(places[keep], pixels[keep])
        if warp is None:
            return np.zeros(len(places), dtype=bool)
        off = np.linalg.norm(pixels - warp.at(places), axis=1)
        sigma = float(np.median(off[keep])) / 1.1774
        still = keep & (off < np.clip(OUTLIER_SIGMAS * sigma, LEAST_OUTLIER_PX, MOST_STEP_PX))
        if (still == keep).all():
            break
        keep = still
    return keep
