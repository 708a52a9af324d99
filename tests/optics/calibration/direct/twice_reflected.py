"""Corners seen in two mirrors in sequence: a reference implementation, independent of the calibration."""

from __future__ import annotations

import numpy as np

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.solver.residuals import Board, Estimate
from mirrorcam.optics.geometry.mirror import reflect
from mirrorcam.optics.geometry.plate import rise_mm
from mirrorcam.optics.geometry.transforms import transform

PATH_STEPS = 20


def twice_reflected(estimate: Estimate, board: Board, frame: int, path: tuple[int, int]) -> FloatArray:
    """Return pixels (c, 2) of the board's corners in mirror path[1], as seen in mirror path[0].

    For a given angle of incidence, a plate is a first-surface mirror raised by t (1 - tan' / tan); rays and incidences
    are found jointly by fixed-point iteration. Vignetting by the outlines is ignored.
    """
    points = transform(estimate.rig_from_board[frame], board.shaped(estimate.shape))
    image = points
    for mirror in path[::-1]:
        image = reflect(image, estimate.virtual_centres_in_rig_mm[mirror])
    for _ in range(PATH_STEPS):
        direction = image / np.linalg.norm(image, axis=1, keepdims=True)
        raised = []
        for mirror in path:
            centre = estimate.virtual_centres_in_rig_mm[mirror]
            length = float(np.linalg.norm(centre))
            unit = centre / length
            along = np.abs(direction @ unit)
            tangent = np.sqrt(np.maximum(1.0 - along**2, 0.0)) / along
            rise = rise_mm(tangent, estimate.thickness_mm[mirror], estimate.refractive_index[mirror])
            raised.append(centre * (1.0 - 2.0 * rise / length)[:, None])
            direction = direction - 2.0 * (direction @ unit)[:, None] * unit
        image = points
        for centres in raised[::-1]:
            image = reflect(image, centres)
    return estimate.camera.project(image)


def on_first_mirror(estimate: Estimate, pixels: FloatArray, path: tuple[int, int]) -> FloatArray:
    """Mask (n,) of viewing rays of pixels (n, 2) that meet mirror path[0] before the plane of path[1]."""
    rays = estimate.camera.unproject(pixels)
    distance = [c @ c / 2.0 / (rays @ c) for c in estimate.virtual_centres_in_rig_mm[list(path)]]
    first, second = (np.where(d > 0.0, d, np.inf) for d in distance)
    return np.asarray(first < second)
