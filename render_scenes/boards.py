"""Calibration boards: their print, and their motion.

The print is a texture with a margin of white paper, positioned on the board. A board moves along smooth paths through
key poses; a rolling shutter reads each row at a different pose.
"""

from __future__ import annotations

from fractions import Fraction

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation, RotationSpline

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.boards import TAG_MODULES, AprilGrid, CalibrationBoard, Charuco, Checkerboard
from mirrorcam.optics.geometry.transforms import rigid
from mirrorcam.render_scenes.settings import RenderSettings

MARGIN_SQUARES = 1  # width of the white paper around the print, in squares or AprilGrid tags
_MAX_TEXELS_PER_SQUARE = 64
_MAX_TEXELS_PER_MODULE = 32


def print_on_paper(board: CalibrationBoard) -> NDArray[np.uint8]:
    """Return the print with its margin of white paper, 0 ink and 255 paper, at the lowest exact resolution.

    One texel per square is exact for a checkerboard. With markers, one texel per marker module is exact where a square
    is a whole number of modules; otherwise markers (never squares) are drawn at the nearest size that falls on texels.
    The gaps of an AprilGrid are whole numbers of texels to within 1/2000 of a module, and exactly for a spacing of two
    decimals.
    """
    if isinstance(board, AprilGrid):
        texels = _texels_per_tag(board)
        return np.pad(board.image(texels), MARGIN_SQUARES * texels, constant_values=255)
    if isinstance(board, Checkerboard):
        return np.pad(board.image(1), MARGIN_SQUARES, constant_values=255)
    texels, marker_mm = _marker_raster(board)
    image = board.replaced(marker_mm=marker_mm).image(texels)
    return np.pad(image, MARGIN_SQUARES * texels, constant_values=255)


def margin_mm(board: CalibrationBoard) -> float:
    """Return the width of the white margin around the printed squares."""
    return MARGIN_SQUARES * (board.tag_mm if isinstance(board, AprilGrid) else board.square_mm)


def _texels_per_tag(board: AprilGrid) -> int:
    gap_modules = Fraction(board.spacing * TAG_MODULES).limit_denominator(_MAX_TEXELS_PER_MODULE)
    return TAG_MODULES * gap_modules.denominator


def _marker_raster(board: Charuco) -> tuple[int, float]:
    """Texels per square, and the marker size, mm, with modules of whole texels that is nearest to the board's."""
    modules = board.markers.shape[1]
    candidates = [
        (texels, texels_per_module * modules * board.square_mm / texels)
        for texels in range(modules + 1, _MAX_TEXELS_PER_SQUARE + 1)
        for texels_per_module in range(1, (texels - 1) // modules + 1)
        if (texels - texels_per_module * modules) % 2 == 0  # else the marker would not be centred
    ]
    return min(candidates, key=lambda candidate: (round(abs(candidate[1] - board.marker_mm), 9), candidate[0]))


def printed_radiance(board: CalibrationBoard, settings: RenderSettings) -> FloatArray:
    """Radiance (rows, columns) of the texels of the print."""
    return np.asarray(settings.ink + (settings.paper - settings.ink) * (print_on_paper(board) / 255.0))


def board_from_texels(board: CalibrationBoard) -> FloatArray:
    """Return the affine map (3, 3) from texels (column, row, 1) of the print to (x, y, 1) on the board, mm."""
    margin = margin_mm(board)
    if isinstance(board, AprilGrid):
        texel_mm = board.tag_mm / _texels_per_tag(board)
    else:
        texels = print_on_paper(board).shape[1] // (board.cols + 2 * MARGIN_SQUARES)
        texel_mm = board.size_mm[0] / texels / board.cols
    return np.array([[texel_mm, 0.0, -margin], [0.0, texel_mm, -margin], [0.0, 0.0, 1.0]])


def rig_from_rectangle(board: CalibrationBoard, rig_from_board: FloatArray) -> FloatArray:
    """Return the affine map (4, 4) from Mitsuba's rectangle ([-1, 1]^2, emits along +z, v up) to a print in the rig."""
    width, height = board.size_mm
    margin = margin_mm(board)
    board_from_rectangle = np.diag([width / 2 + margin, -(height / 2 + margin), -1.0, 1.0])
    board_from_rectangle[:2, 3] = width / 2, height / 2
    return rig_from_board @ board_from_rectangle


def smooth_motion(keys: FloatArray, times: FloatArray) -> FloatArray:
    """Interpolate a smooth motion through key poses.

    Positions follow a clamped cubic spline, at rest at both ends; rotations follow SciPy's `RotationSpline`. Before the
    first and after the last key the board is at rest.

    Parameters
    ----------
    keys
        Rigid key poses (k, 4, 4), passed at times 0, 1, 2, ...
    times
        Times (n,).

    Returns
    -------
    FloatArray
        Poses (n, 4, 4).
    """
    clamped = np.clip(times, 0.0, len(keys) - 1.0)
    if len(keys) == 1:
        return np.repeat(keys, len(clamped), axis=0)
    knots = np.arange(len(keys), dtype=np.float64)
    rotations = RotationSpline(knots, Rotation.from_matrix(keys[:, :3, :3]))(clamped)
    return rigid(rotations.as_matrix(), CubicSpline(knots, keys[:, :3, 3], bc_type="clamped")(clamped))


def poses_at(poses: FloatArray, fractions: FloatArray) -> FloatArray:
    """Interpolate poses within the readout of one frame.

    Positions, and rotation vectors relative to the middle pose, follow parabolas (constant acceleration).

    Parameters
    ----------
    poses
        Poses (3, 4, 4) at the start, middle and end of the readout.
    fractions
        Fractions (n,) of the readout, 0 to 1.

    Returns
    -------
    FloatArray
        Poses (n, 4, 4).
    """
    middle = Rotation.from_matrix(poses[1, :3, :3])
    rotation_vectors = (middle.inv() * Rotation.from_matrix(poses[:, :3, :3])).as_rotvec()
    begin, end = (2.0 * fractions - 1.0) * (fractions - 1.0), fractions * (2.0 * fractions - 1.0)
    weights = np.stack([begin, 1.0 - begin - end, end], axis=-1)
    return rigid((middle * Rotation.from_rotvec(weights @ rotation_vectors)).as_matrix(), weights @ poses[:, :3, 3])
