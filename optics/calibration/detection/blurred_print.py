"""Image of a board's print with a lens's blur, and its derivatives."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.boards import AprilGrid, CalibrationBoard, Charuco, Checkerboard

Image = NDArray[np.float32]
Floats = NDArray[np.floating[Any]]

UNUSED_MAP: Any = None  # cv2.remap's second map, not needed because the first one holds x and y
PX_PER_SQUARE = 40
PX_PER_PITCH = range(32, 61)  # candidates for an AprilGrid
BLUR_STEP = 2.0**0.125
LOCAL = Checkerboard(cols=6, rows=6, square_mm=1.0)
FIRST, SECOND = np.array([[-0.5, 0.0, 0.5]]), np.array([[1.0, -2.0, 1.0]])
THIRD = np.array([[-0.5, 1.0, 0.0, -1.0, 0.5]])
"""Central differences along x."""
MIN_BLUR, MAX_BLUR = 0.008, 0.35  # sigma in cells


def sample(image: Image, pixels: Floats) -> Image:
    """Sample an image (h, w, ...) at pixels (n, m, 2), bilinearly; returns (n, m, ...). Border pixels are repeated.

    OpenCV is exact for one, three and four channels, and rounds positions to 1/32 of a pixel for others.
    """
    sampled = np.empty((*pixels.shape[:-1], *image.shape[2:]), dtype=np.float32)
    pixels = np.ascontiguousarray(pixels, dtype=np.float32)
    for start in range(0, len(pixels), 2**14):  # cv2.remap takes maps of less than 2^15 rows
        rows = slice(start, start + 2**14)
        cv2.remap(image, pixels[rows], UNUSED_MAP, cv2.INTER_LINEAR, sampled[rows], borderMode=cv2.BORDER_REPLICATE)
    return sampled


def shifted(points: Image, offsets: FloatArray) -> Image:
    """Shift each row of points (n, m, 2) by its vector (n, 2), as complex numbers, which is several times faster."""
    shift = np.ascontiguousarray(offsets, dtype=np.float32).view(np.complex64)
    return np.asarray((points.view(np.complex64)[..., 0] + shift).view(np.float32).reshape(points.shape))


@dataclass(frozen=True)
class BlurredPrint:
    """A print of values from -1 (black) to 1 (white), blurred, as images.

    `derivatives` (h, w, 4), per square, are d/dx, d/dy, d2/dx2 and d2/dy2, x right and y down; `mixed` (h, w) is
    d2/dxdy. `sigma` is the blur in cells.
    """

    value: Image
    derivatives: Image
    mixed: Image
    sigma: float


@dataclass(frozen=True)
class PrintSamples:
    """Samples (n, m) of a blurred print: values, first derivatives (n, 2, m) and second derivatives (n, 3, m).

    Derivatives are per square, ordered x, y and xx, xy, yy.
    """

    value: Image
    first: Image
    second: Image


def _ink(board: CalibrationBoard) -> FloatArray:
    """Black fraction of each pixel of a print's image, with `px_per_pitch` pixels per pitch.

    `board.image` rounds markers to entire pixels, which is too coarse: corners are located to 1/2000 of a square.
    """
    if isinstance(board, AprilGrid):
        tag, gap = (px_per_pitch(board) * side / board.pitch_mm for side in (board.tag_mm, board.gap_mm))
        right, down = (coverage(board.cell_edges(tags, tag=tag, gap=gap)) for tags in (board.cols, board.rows))
        return np.asarray(down.T @ board.black @ right)
    black = board.black if isinstance(board, Charuco) else board.image(1) == 0
    ink = np.kron(black, np.ones((PX_PER_SQUARE, PX_PER_SQUARE)))
    if isinstance(board, Checkerboard):
        return ink
    modules = board.markers.shape[1]
    side = PX_PER_SQUARE * board.marker_mm / board.square_mm
    edges = PX_PER_SQUARE / 2.0 + side * (np.arange(modules + 1) / modules - 0.5)
    cover = coverage(edges, PX_PER_SQUARE)
    for white, (row, col) in zip(board.markers, board.marker_squares.tolist(), strict=True):
        square = np.s_[row * PX_PER_SQUARE : (row + 1) * PX_PER_SQUARE, col * PX_PER_SQUARE : (col + 1) * PX_PER_SQUARE]
        ink[square] += cover.T @ (1.0 - white - ink[square][0, 0]) @ cover
    return ink


def px_per_pitch(board: CalibrationBoard) -> int:
    """Choose the pixels per pitch of a print's image, similar for all prints, so that corners lie between pixels.

    Otherwise, the interpolation of samples would bias corners by 1/5000 of a pitch.
    """
    if not isinstance(board, AprilGrid):
        return PX_PER_SQUARE

    def rounding_error(px: int) -> float:
        tag = px * board.tag_mm / board.pitch_mm
        return round(abs(tag - round(tag)), 6)

    return min(PX_PER_PITCH, key=lambda px: (rounding_error(px), abs(px - PX_PER_SQUARE)))


def image_px_of_print(board: CalibrationBoard, print_xy: Floats) -> Floats:
    """Convert points on a print, in pitches, to pixels of its image, which has a margin of one pitch."""
    return (print_xy + 1.0) * px_per_pitch(board) - 0.5


def coverage(edges: FloatArray, count: int | None = None) -> FloatArray:
    """Fractions (c, p) of pixels that cells between edges (c + 1,) cover; by default, pixels up to the last edge."""
    pixels = np.arange(np.ceil(edges[-1] - 1e-6) if count is None else count)
    begin, end = np.maximum(edges[:-1, None], pixels), np.minimum(edges[1:, None], pixels + 1)
    return np.maximum(end - begin, 0.0)


def blurred_print(board: CalibrationBoard, blur_cells: float) -> BlurredPrint:
    """Return a board's print blurred by the sigma, in cells, that is nearest to `blur_cells` in a geometric series."""
    return _blurred(board, int(_step(np.array(blur_cells))))


def sample_blurred(board: CalibrationBoard, print_xy: Floats, blur: FloatArray) -> PrintSamples:
    """Sample a print under an anisotropic blur given by covariances.

    The blur is the isotropic blur of equal area plus a heat-equation term: half the second derivatives times the rest
    of the covariance.

    Parameters
    ----------
    board
        The print.
    print_xy
        Sample points (n, m, 2), in squares from the print's top left.
    blur
        Covariances (n, 2, 2) of the blur around each of n corners, in cells.
    """
    count, samples = print_xy.shape[:2]
    value, derivatives = np.empty((count, samples), dtype=np.float32), np.empty((count, 5, samples), dtype=np.float32)
    remaining = blur.copy()
    for rows, step, pixels in _by_step(board, print_xy, blur):
        blurred = _blurred(board, step)
        value[rows] = sample(blurred.value, pixels)
        derivatives[rows, :4] = sample(blurred.derivatives, pixels).transpose(0, 2, 1)
        derivatives[rows, 4] = sample(blurred.mixed, pixels)
        remaining[rows] -= blurred.sigma**2 * np.eye(2)
    first, second = derivatives[:, :2], derivatives[:, [2, 4, 3]]
    spread = np.stack([remaining[:, 0, 0] / 2.0, remaining[:, 0, 1], remaining[:, 1, 1] / 2.0], axis=1)
    value += (spread.astype(np.float32)[:, None] @ second)[:, 0]
    return PrintSamples(value, first, second)


def third_derivatives(board: CalibrationBoard, print_xy: Floats, blur: FloatArray) -> Image:
    """Third derivatives (n, 4, m) of a blurred print at points (n, m, 2): xxx, xxy, xyy and yyy, per square.

    `blur` (n, 2, 2) is as in `sample_blurred`; its shape is neglected.
    """
    derivatives = np.empty((*print_xy.shape[:2], 4), dtype=np.float32)
    for rows, step, pixels in _by_step(board, print_xy, blur):
        derivatives[rows] = sample(_third(board, step), pixels)
    return derivatives.transpose(0, 2, 1)


def _by_step(
    board: CalibrationBoard, print_xy: Floats, blur: FloatArray
) -> Iterator[tuple[NDArray[np.int64], int, Floats]]:
    """Group corners by the step of the isotropic blur of equal area: their indices, the step, their image's pixels."""
    pixels, steps = image_px_of_print(board, print_xy), _step(np.linalg.det(blur) ** 0.25)
    for step in np.unique(steps).tolist():
        rows = np.flatnonzero(steps == step)
        yield rows, step, pixels[rows]


def _step(blur_cells: FloatArray) -> NDArray[np.int64]:
    return np.rint(np.log(np.clip(blur_cells, MIN_BLUR, MAX_BLUR)) / np.log(BLUR_STEP)).astype(np.int64)


def local_print(board: CalibrationBoard, print_xy: FloatArray) -> tuple[CalibrationBoard, FloatArray]:
    """Return a print that equals a board around its corners at `print_xy` (n, 2), and these corners' points on it.

    All plain checkerboards look the same around inner corners, so a small one represents them.
    """
    if isinstance(board, Checkerboard):
        return LOCAL, 2.0 + (print_xy + np.array([board.inverted, 0.0])) % 2.0
    return board, print_xy


@lru_cache(maxsize=48)
def _blurred(board: CalibrationBoard, step: int) -> BlurredPrint:
    scale = px_per_pitch(board)
    blur_px = BLUR_STEP**step * scale
    padded = np.pad(1.0 - 2.0 * _ink(board), scale, constant_values=1.0).astype(np.float32)
    value = np.asarray(cv2.GaussianBlur(padded, (0, 0), blur_px), dtype=np.float32)
    first, second = FIRST * scale, SECOND * scale**2
    *derivatives, mixed = (_filtered(value, kernel) for kernel in (first, first.T, second, second.T, first.T @ first))
    return BlurredPrint(value, np.stack(derivatives, axis=2), mixed, BLUR_STEP**step)


@lru_cache(maxsize=16)
def _third(board: CalibrationBoard, step: int) -> Image:
    """Images (h, w, 4) of the third derivatives xxx, xxy, xyy and yyy, per square."""
    kernels = THIRD, FIRST.T @ SECOND, SECOND.T @ FIRST, THIRD.T
    scale = px_per_pitch(board) ** 3
    return np.stack([_filtered(_blurred(board, step).value, kernel * scale) for kernel in kernels], axis=2)


def _filtered(image: Image, kernel: FloatArray) -> Image:
    return np.asarray(cv2.filter2D(image, -1, kernel, borderType=cv2.BORDER_REPLICATE), dtype=np.float32)
