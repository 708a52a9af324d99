"""The map from a printed board to a picture: a homography with a smooth polynomial correction."""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.detection.corner_patches import ExpectedCorners
from mirrorcam.optics.geometry.boards import CalibrationBoard

MIN_POINTS, MIN_CORRECTED = 4, 24  # for a warp, and for a warp with a polynomial
CUBIC, SEPTIC = 3, 7  # degrees of the polynomial
EXPONENTS = [np.tril_indices(degree + 1) for degree in range(SEPTIC + 1)]  # per term: total degree, and degree in y
# Few points determine no term of a high degree, so terms have expected sizes at the border of the points: cubic terms
# at least this size, px, terms of each higher degree this fraction of the degree below, and lower terms any size.
MIN_CUBIC_PX, DECREASE, ANY_PX = 1.0, 0.5, 100.0
NOISE_PX = 0.02  # of the points, for weighing them against the expected sizes
OUTLIER_CELLS = 0.12  # distance of a corner from the map through the others


@dataclass(frozen=True)
class BoardWarp:
    """The map from points on a board, in squares from its top left, to pixels: a homography plus a smooth polynomial.

    The polynomial models lens distortion, a bent board or mirror, and a rolling shutter. Its argument is the pixel to
    which the homography maps a point: there, a lens distorts by few terms of a low degree, and also an oblique board.

    Attributes
    ----------
    homography
        Maps squares to pixels, (3, 3).
    centre, half_extent
        Centre (2,) and half extent, in px, that normalise the polynomial's argument.
    polynomial
        Coefficients (n, 2), px, by increasing degree.
    """

    homography: FloatArray
    centre: FloatArray
    half_extent: float
    polynomial: FloatArray

    @classmethod
    def fit(cls, print_xy: FloatArray, pixels: FloatArray, *, degree: int = CUBIC) -> BoardWarp | None:
        """Fit the warp of points (n, 2), in squares, to pixels (n, 2) with outliers; None for too few points.

        A cubic may be extrapolated by a square or two. A septic is for interpolation: over an entire board, the second
        derivatives of a cubic are wrong by a tenth, which shifts corners by 0.001 px.
        """
        if len(print_xy) < MIN_POINTS:
            return None
        outlier_px = max(OUTLIER_CELLS * typical_cell_px(print_xy, pixels), 1.0)
        homography = _homography(print_xy, pixels, outlier_px)
        if homography is None:
            return None
        mapped = _projected(homography, print_xy)
        centre = mapped.mean(axis=0)
        warp = cls(homography, centre, max(float(np.abs(mapped - centre).max()), 1.0), np.zeros((1, 2)))
        return warp._corrected(mapped, pixels, outlier_px, degree) if len(mapped) >= MIN_CORRECTED else warp

    def _corrected(self, mapped: FloatArray, pixels: FloatArray, outlier_px: float, degree: int) -> BoardWarp:
        """Return the warp with a polynomial from pixels (n, 2) of the homography to the right ones (n, 2).

        It is fitted with Cauchy weights, because some outliers remain.
        """
        residual = pixels - mapped
        terms = self._terms(mapped, degree)
        weights = 1.0 / (1.0 + (np.linalg.norm(residual, axis=1) / outlier_px) ** 2)
        total, _ = EXPONENTS[degree]
        polynomial, cubic_px = np.zeros((terms.shape[1], 2)), MIN_CUBIC_PX
        for _ in range(3):
            size_px = np.where(total < CUBIC, ANY_PX, cubic_px * DECREASE ** (total - CUBIC))
            ridge = np.diag((NOISE_PX / size_px) ** 2)
            weighted = terms * weights[:, None]
            polynomial = np.linalg.solve(terms.T @ weighted + ridge, weighted.T @ residual)
            cubic_px = max(float(np.sqrt(np.mean(polynomial[total == CUBIC] ** 2))), MIN_CUBIC_PX)
            deviation = np.linalg.norm(residual - terms @ polynomial, axis=1)
            scale = max(3.0 * 1.4826 * float(np.partition(deviation, len(deviation) // 2)[len(deviation) // 2]), 0.02)
            weights = 1.0 / (1.0 + (deviation / scale) ** 2)
        return replace(self, polynomial=polynomial)

    def _terms(self, mapped: FloatArray, degree: int) -> FloatArray:
        """Monomials (n, m) of normalised pixels (n, 2) up to a degree: 1, x, y, x^2, x y, y^2, ..."""
        powers = np.ones((degree + 1, len(mapped), 2))
        powers[1:] = (mapped - self.centre) / self.half_extent
        np.cumprod(powers, axis=0, out=powers)
        total, y = EXPONENTS[degree]
        return np.asarray((powers[total - y, :, 0] * powers[y, :, 1]).T)

    def map(self, print_xy: FloatArray) -> FloatArray:
        """Return pixels (n, 2) of points (n, 2) on the board; NaN behind the camera."""
        mapped = _projected(self.homography, print_xy)
        return mapped + self._terms(mapped, self._degree) @ self.polynomial

    @property
    def _degree(self) -> int:
        return round((np.sqrt(8.0 * len(self.polynomial) + 1.0) - 3.0) / 2.0)

    def derivatives(self, print_xy: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return derivatives (n, 2, 2) of pixels with respect to x and y, and half the second derivatives (n, 2, 3)."""
        step = 0.25
        offsets = [(0, 0), (1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (-1, -1), (1, -1), (-1, 1)]
        samples = print_xy + step * np.array(offsets)[:, None]
        middle, east, west, south, north, *diagonal = self.map(samples.reshape(-1, 2)).reshape(samples.shape)
        mixed = diagonal[0] + diagonal[1] - diagonal[2] - diagonal[3]
        cells = np.stack([east - west, south - north], axis=2) / (2.0 * step)
        second_derivatives = np.stack([east + west - 2.0 * middle, mixed / 2.0, south + north - 2.0 * middle], axis=2)
        return cells, second_derivatives / (2.0 * step**2)

    def expected(self, print_xy: FloatArray, pixels: FloatArray) -> ExpectedCorners:
        """Return corners at points (n, 2) on the board and expected pixels (n, 2), with the warp's derivatives."""
        cells, second_derivatives = self.derivatives(print_xy)
        return ExpectedCorners(print_xy, pixels, cells, second_derivatives)


def _projected(homography: FloatArray, print_xy: FloatArray) -> FloatArray:
    """Map points (n, 2) by a homography to pixels (n, 2); NaN behind the camera."""
    lifted = np.column_stack([print_xy, np.ones(len(print_xy))]) @ homography.T
    return np.asarray(lifted[:, :2] / np.where(lifted[:, 2:] > 1e-9, lifted[:, 2:], np.nan))


def _homography(print_xy: FloatArray, pixels: FloatArray, outlier_px: float) -> FloatArray | None:
    """Fit a homography (3, 3) to all points if it fits each within `outlier_px`, otherwise robustly to most of them."""
    exact, _ = cv2.findHomography(print_xy, pixels, 0)
    if exact is not None:
        lifted = np.column_stack([print_xy, np.ones(len(print_xy))]) @ exact.T
        if (np.abs(lifted[:, :2] - pixels * lifted[:, 2:]) < outlier_px * np.abs(lifted[:, 2:])).all():
            return np.asarray(exact)
    robust, _ = cv2.findHomography(print_xy, pixels, cv2.RANSAC, outlier_px, None, 2000, 0.9999)
    return None if robust is None else np.asarray(robust)


def corner_print_xy(board: CalibrationBoard) -> FloatArray:
    """Coordinates (n, 2) of the corners on the print, in squares (pitches) from its top left, ordered by id."""
    return board.corners_in_board_mm[:, :2] / board.pitch_mm


def typical_cell_px(print_xy: FloatArray, pixels: FloatArray) -> float:
    """Pixels per square, approximately: the ratio of mean distances from the centroids."""
    spread = np.linalg.norm(pixels - pixels.mean(axis=0), axis=1).mean()
    return float(spread / max(np.linalg.norm(print_xy - print_xy.mean(axis=0), axis=1).mean(), 1e-9))
