"""Lateral colour of a lens: where pictures of a board show its corners in red, green and blue."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from mirrorcam.core.images.pictures import read_image
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.detection.board_growing import expected_corners
from mirrorcam.optics.calibration.detection.board_warp import corner_print_xy
from mirrorcam.optics.calibration.detection.corner_patches import Appearance
from mirrorcam.optics.calibration.detection.corner_refinement import colour_shifts
from mirrorcam.optics.calibration.solver.observations import Observations
from mirrorcam.optics.geometry.boards import CalibrationBoard
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.lateral_colour import LateralColour

MAX_PICTURES = 8
"""Pictures that are measured: 4000 corners give each number to about 1e-6."""
MIN_CORNERS = 12
"""Corners of a view for a smooth map of its board."""
BLUR_PX = 1.0
OUTLIER_SIGMAS, ROUNDS = 4.0, 4
MIN_SIGNIFICANCE = 0.999
"""Confidence at which a colour counts as displaced."""

Picture = NDArray[np.uint8]


def estimated_lateral_colour(
    pictures: Iterable[tuple[Picture, Observations]], camera: Camera, board: CalibrationBoard
) -> LateralColour | None:
    """Estimate the displacements of red and blue against green.

    Parameters
    ----------
    pictures
        Pictures (h, w, 3) in RGB, each with the corners that it shows.
    camera
        The calibrated camera.
    board
        The board.

    Returns
    -------
    The displacements; a colour without a significant one has zeros. None if neither has, and for grey pictures.
    """
    pixels, red, blue = [np.empty((0, 2))], [np.empty((0, 2))], [np.empty((0, 2))]
    for picture, rows in pictures:
        if (picture[..., 0] == picture[..., 1]).all() and (picture[..., 1] == picture[..., 2]).all():
            continue
        for view in np.unique(rows.view):
            of_view = rows.where(rows.view == view)
            print_xy = corner_print_xy(board)[of_view.corner]
            expected = expected_corners(print_xy, of_view.pixels) if len(of_view) >= MIN_CORNERS else None
            if expected is None:
                continue
            shifts = colour_shifts(picture.astype(np.float32), expected, Appearance(board, BLUR_PX, motion=False))
            pixels.append(of_view.pixels)
            red.append(shifts[0] - shifts[1])
            blue.append(shifts[2] - shifts[1])
    offset = np.concatenate(pixels) - np.array([camera.cx_px, camera.cy_px])
    squared = np.square(offset / np.array([camera.fx_px, camera.fy_px])).sum(axis=1)
    columns = np.stack([offset, squared[:, None] * offset], axis=-1)
    (of_red, red_sigma), (of_blue, blue_sigma) = (_fitted(columns, np.concatenate(shift)) for shift in (red, blue))
    if not (of_red.any() or of_blue.any()):
        return None
    return LateralColour(red=of_red, blue=of_blue, red_sigma=red_sigma, blue_sigma=blue_sigma)


def _fitted(columns: FloatArray, shifts_px: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Fit displacements (n, 2) by columns (n, 2, k); return k numbers, zeros unless significant, and their sigmas."""
    used = np.isfinite(shifts_px).all(axis=1)
    count = columns.shape[2]
    numbers: FloatArray = np.zeros(count)
    covariance: FloatArray = np.zeros((count, count))
    for _ in range(ROUNDS):
        if used.sum() < MIN_CORNERS:
            return np.zeros(count), np.zeros(count)
        matrix, values = columns[used].reshape(-1, count), shifts_px[used].reshape(-1)
        numbers = np.asarray(np.linalg.lstsq(matrix, values, rcond=None)[0], dtype=np.float64)
        rest = shifts_px - columns @ numbers
        variance = np.mean(rest[used] ** 2)
        covariance = variance * np.linalg.inv(matrix.T @ matrix)
        size = np.linalg.norm(rest, axis=1)
        used = size < OUTLIER_SIGMAS * np.nanmedian(size)
    significant = numbers @ np.linalg.solve(covariance, numbers) > chi2.ppf(MIN_SIGNIFICANCE, count)
    return (numbers if significant else np.zeros(count)), np.sqrt(np.diag(covariance))


def colour_pictures(
    pictures: Sequence[tuple[Path, Observations]],
) -> Iterable[tuple[Picture, Observations]]:
    """Read some of the pictures, evenly spaced over all, in colour."""
    chosen = np.unique(np.linspace(0, len(pictures) - 1, MAX_PICTURES).round().astype(int)).tolist() if pictures else []
    return ((read_image(path), rows) for path, rows in (pictures[number] for number in chosen))
