"""The map from a printed board to a picture: a homography with a smooth polynomial correction."""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.detection.corner_patches import ExpectedCorners
from mirrorcam.optics.geometry.targets import Target

MIN_POINTS = 4
CUBIC, QUINTIC = 3, 5  # degrees of the correction
MIN_POINTS_OF_DEGREE = ((QUINTIC, 63), (CUBIC, 24))
EXPONENTS = [np.tril_indices(degree + 1) for degree in range(QUINTIC + 1)]  # of each term: total, and of y
OUTLIER_CELLS = 0.12  # distance of a corner from the map through the others


@dataclass(frozen=True)
class BoardWarp:
    """The map from board places, in squares from the top left, to pixels: a homography plus a smooth polynomial.

    The polynomial models lens distortion, a bent board or mirror, and a rolling shutter; it is omitted for few points.

    Attributes
    ----------
    homography
        (3, 3), pixels from squares.
    middle, half
        Centre (2,) and half extent, in squares, that normalise the polynomial's argument.
    polynomial
        Coefficients (n, 2), px, by increasing degree.
    """

    homography: FloatArray
    middle: FloatArray
    half: float
    polynomial: FloatArray

    @classmethod
    def through(cls, places: FloatArray, pixels: FloatArray, *, degree: int = CUBIC) -> BoardWarp | None:
        """Fit the warp of places (n, 2), in squares, to pixels (n, 2) with outliers; None for too few points.

        A cubic may be extrapolated by a square or two. A quintic is for interpolation: over an entire board, the second
        derivatives of a cubic are wrong by a tenth, which shifts corners by 0.001 px.
        """
        if len(places) < MIN_POINTS:
            return None
        off_px = max(OUTLIER_CELLS * typical_cell_px(places, pixels), 1.0)
        homography = _homography(places, pixels, off_px)
        if homography is None:
            return None
        middle = places.mean(axis=0)
        half = max(float(np.abs(places - middle).max()), 1.0)
        warp = cls(np.asarray(homography), middle, half, np.zeros((1, 2)))
        for most, points in MIN_POINTS_OF_DEGREE:
            if most <= degree and len(places) >= points:
                return warp._corrected(places, pixels, off_px, most)
        return warp

    def _corrected(self, places: FloatArray, pixels: FloatArray, off_px: float, degree: int) -> BoardWarp:
        """Return the warp with a polynomial fitted by Cauchy weights, because some outliers remain."""
        off = pixels - self.at(places)
        terms = self._terms(places, degree)
        weights = 1.0 / (1.0 + (np.linalg.norm(off, axis=1) / off_px) ** 2)
        ridge = 1e-3 * np.eye(terms.shape[1])
        polynomial = np.zeros((terms.shape[1], 2))
        for _ in range(3):
            weighted = terms * weights[:, None]
            polynomial = np.linalg.solve(terms.T @ weighted + ridge, weighted.T @ off)
            rest = np.linalg.norm(off - terms @ polynomial, axis=1)
            scale = max(3.0 * 1.4826 * float(np.partition(rest, len(rest) // 2)[len(rest) // 2]), 0.02)
            weights = 1.0 / (1.0 + (rest / scale) ** 2)
        return replace(self, polynomial=polynomial)

    def _terms(self, places: FloatArray, degree: int) -> FloatArray:
        """Powers (n, m) of normalised places up to a degree: 1, x, y, x^2, x y, y^2, ..."""
        powers = np.ones((degree + 1, len(places), 2))
        powers[1:] = (places - self.middle) / self.half
        np.cumprod(powers, axis=0, out=powers)
        total, y = EXPONENTS[degree]
        return np.asarray((powers[total - y, :, 0] * powers[y, :, 1]).T)

    def at(self, places: FloatArray) -> FloatArray:
        """Return pixels (n, 2) of places (n, 2); NaN behind the camera."""
        lifted = np.column_stack([places, np.ones(len(places))]) @ self.homography.T
        depth = np.where(lifted[:, 2:] > 1e-9, lifted[:, 2:], np.nan)
        return lifted[:, :2] / depth + self._terms(places, self._degree) @ self.polynomial

    @property
    def _degree(self) -> int:
        return round((np.sqrt(8.0 * len(self.polynomial) + 1.0) - 3.0) / 2.0)

    def shapes(self, places: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return derivatives (n, 2, 2) of pixels by squares (columns x, y), and half the second ones (n, 2, 3)."""
        step = 0.25
        around = [(0, 0), (1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (-1, -1), (1, -1), (-1, 1)]
        near = places + step * np.array(around)[:, None]
        here, east, west, south, north, *diagonal = self.at(near.reshape(-1, 2)).reshape(near.shape)
        mixed = diagonal[0] + diagonal[1] - diagonal[2] - diagonal[3]
        cells = np.stack([east - west, south - north], axis=2) / (2.0 * step)
        bends = np.stack([east + west - 2.0 * here, mixed / 2.0, south + north - 2.0 * here], axis=2)
        return cells, bends / (2.0 * step**2)

    def expected(self, places: FloatArray, pixels: FloatArray) -> ExpectedCorners:
        """Return corners at places (n, 2) and expected pixels (n, 2), with the warp's derivatives there."""
        cells, bends = self.shapes(places)
        return ExpectedCorners(places, pixels, cells, bends)


def _homography(places: FloatArray, pixels: FloatArray, off_px: float) -> FloatArray | None:
    """Fit a homography (3, 3) to all points if it fits each within `off_px`, otherwise to most of them."""
    fitted, _ = cv2.findHomography(places, pixels, 0)
    if fitted is not None:
        lifted = np.column_stack([places, np.ones(len(places))]) @ fitted.T
        if (np.abs(lifted[:, :2] - pixels * lifted[:, 2:]) < off_px * np.abs(lifted[:, 2:])).all():
            return np.asarray(fitted)
    most, _ = cv2.findHomography(places, pixels, cv2.RANSAC, off_px, None, 2000, 0.9999)
    return None if most is None else np.asarray(most)


def corner_places(target: Target) -> FloatArray:
    """Places (n, 2) of the corners on the print, in squares (pitches) from its top left, ordered by id."""
    return target.corners_in_board_mm[:, :2] / target.pitch_mm


def typical_cell_px(places: FloatArray, pixels: FloatArray) -> float:
    """Pixels per square, approximately: the ratio of mean distances from the centroids."""
    spread = np.linalg.norm(pixels - pixels.mean(axis=0), axis=1).mean()
    return float(spread / max(np.linalg.norm(places - places.mean(axis=0), axis=1).mean(), 1e-9))
