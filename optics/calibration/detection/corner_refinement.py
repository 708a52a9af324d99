"""Where a corner is, to a hundredth of a pixel, and whether it is there: the print is known, so it is looked for.

Around each corner the picture is compared with what is printed there, markers and all, as this lens blurs it. A finder
that looks at two crossing edges alone must stop where a marker begins, and is pulled by it before.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from mirrorcam.optics.base.values import FloatArray
from mirrorcam.optics.geometry.targets import DICTIONARIES, Checkerboard, Target

Grey = NDArray[np.uint8]
Image = NDArray[np.float32]

PX_PER_SQUARE = 40  # of the print that pictures are compared with
HALF = 0.5  # cells from a corner that are compared
MOST_PX = 14.0  # and at most this: of large cells, what lies further tells little more
SAMPLES = 17  # along each side
ITERATIONS = 5
SETTLED_PX = 2e-3
PRINTED = 0.7  # (white - black) / (white + black) of a print as it is seen: stray light adds to black
OUTLIER_SIGMAS = 4.0  # of the noise around a corner, from where a pixel counts for nothing
LEAST_SIGMA = 0.04  # of the contrast, below which the print itself is not even
BLUR_STEP = 2.0**0.25
SHARPEST, SOFTEST = 0.008, 0.35  # blurs of the print, sigma in cells


@dataclass(frozen=True)
class RefinedCorners:
    """Corners (n) as they were found.

    Attributes:
        pixels: where they are (n, 2).
        sigma_px: standard deviation (n,) that the noise around leads to, along the worse axis.
        contrast: white less black, in grey levels (n,).
        explained: part (n,) of the variance around the corner that is print.
        blur_cells: sigma (n,) of the blur, in cells.
        copies: how strong copies of the print are (n, k), times what was expected, (n, 0) where that was not asked.
    """

    pixels: FloatArray
    sigma_px: FloatArray
    contrast: FloatArray
    explained: FloatArray
    blur_cells: FloatArray
    copies: FloatArray

    def where(self, mask: NDArray[np.bool_]) -> RefinedCorners:
        """Those of a boolean mask (n,)."""
        return RefinedCorners(*(getattr(self, field.name)[mask] for field in fields(self)))


@dataclass(frozen=True)
class GhostImages:
    """Faint copies (k) of what is printed around each corner (n): shifted by (n, k, 2) px, parts (n, k) as bright."""

    offsets_px: FloatArray
    parts: FloatArray

    @classmethod
    def none(cls, count: int) -> GhostImages:
        return cls(np.zeros((count, 0, 2)), np.zeros((count, 0)))


def sample(image: Image, at: FloatArray) -> FloatArray:
    """Values (n, m) of an image at pixels (n, m, 2), bilinear; beyond the border, those of the border."""
    found = np.empty(at.shape[:-1], dtype=np.float32)
    x, y = np.ascontiguousarray(np.moveaxis(at, -1, 0), dtype=np.float32)
    for start in range(0, len(at), 2**14):  # cv2.remap takes maps of less than 2^15 rows
        part = slice(start, start + 2**14)
        found[part] = cv2.remap(image, x[part], y[part], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(found, dtype=np.float64)


@dataclass(frozen=True)
class _Print:
    """A print of values -1 (black) to 1 (white), blurred, and its derivatives per square, as images."""

    value: Image
    right: Image
    down: Image
    laplacian: Image


def _ink(target: Target) -> FloatArray:
    """What part of each pixel (rows * p, cols * p) of a print is black.

    Not `target.image`, which rounds markers to whole pixels: a corner is found to a two thousandth of a square.
    """
    ink = 1.0 - Checkerboard(cols=target.cols, rows=target.rows, square_mm=1.0).image(PX_PER_SQUARE) / 255.0
    if isinstance(target, Checkerboard):
        return ink
    dictionary, modules = target.opencv.getDictionary(), DICTIONARIES[target.dictionary][1]
    side = PX_PER_SQUARE * target.marker_mm / target.square_mm
    edges = PX_PER_SQUARE / 2.0 + side * (np.arange(modules + 1) / modules - 0.5)
    pixels = np.arange(PX_PER_SQUARE)
    begin, end = np.maximum(edges[:-1, None], pixels), np.minimum(edges[1:, None], pixels + 1)
    covers = np.maximum(end - begin, 0.0)
    white = ((row, col) for row in range(target.rows) for col in range(target.cols) if (row + col) % 2)
    for number, (row, col) in enumerate(white):
        black = dictionary.generateImageMarker(number, modules, borderBits=1) == 0
        square = np.s_[row * PX_PER_SQUARE : (row + 1) * PX_PER_SQUARE, col * PX_PER_SQUARE : (col + 1) * PX_PER_SQUARE]
        ink[square] = covers.T @ black @ covers
    return ink


@lru_cache(maxsize=24)
def _print(target: Target, step: int) -> _Print:
    blur_px = BLUR_STEP**step * PX_PER_SQUARE
    padded = np.pad(1.0 - 2.0 * _ink(target), PX_PER_SQUARE, constant_values=1.0).astype(np.float32)
    value = np.asarray(cv2.GaussianBlur(padded, (0, 0), blur_px), dtype=np.float32)
    down, right = (np.asarray(d, dtype=np.float32) * PX_PER_SQUARE for d in np.gradient(value))
    laplacian = np.asarray(cv2.Laplacian(value, cv2.CV_32F, ksize=1), dtype=np.float32) * PX_PER_SQUARE**2
    return _Print(value, right, down, laplacian)


def _step(blur_cells: float) -> int:
    return round(float(np.log(np.clip(blur_cells, SHARPEST, SOFTEST)) / np.log(BLUR_STEP)))


def refine(
    picture: Image,
    places: FloatArray,
    pixels: FloatArray,
    cells: FloatArray,
    bends: FloatArray,
    target: Target,
    blur_cells: float,
    copies: GhostImages | None = None,
    *,
    fit_strengths: bool = False,
) -> RefinedCorners:
    """Corners at places (n, 2) on the print, in squares, found from pixels (n, 2) that are wrong by a few px at most.

    `cells` (n, 2, 2) are the derivatives of pixels by squares (columns: right, down) and `bends` (n, 2, 3) half the
    second ones (xx, xy + yx, yy). Gauss-Newton for the shift, together with all that light, ink and lens may add: an
    even or sloping brightness, contrast, edges that have crept towards black or white (ink that spreads, a camera's
    gamma), more or less blur. Pixels that are not explained, of a glare or past a mirror's edge, lose their weight.
    The `copies` are part of what is looked for, or where they are `free` as strong as each corner has them.
    Pixels are NaN where the search runs away.
    """
    count = len(places)
    u, v = (axis.ravel() for axis in np.meshgrid(*[np.linspace(-1.0, 1.0, SAMPLES)] * 2))
    side_px = np.sqrt(np.abs(np.linalg.det(cells)))
    half = np.minimum(HALF, MOST_PX / np.maximum(side_px, 1e-6))
    on_print = half[:, None, None] * np.stack([u, v], axis=1)
    x, y = on_print[..., 0], on_print[..., 1]
    offsets = on_print @ cells.transpose(0, 2, 1) + np.stack([x * x, x * y, y * y], axis=2) @ bends.transpose(0, 2, 1)

    blurred = _print(target, _step(blur_cells))
    at = (places[:, None] + on_print + 1.0) * PX_PER_SQUARE - 0.5
    value, laplacian = sample(blurred.value, at), sample(blurred.laplacian, at)
    by_square = np.stack([sample(blurred.right, at), sample(blurred.down, at)], axis=2)
    squares_per_px = np.linalg.inv(np.where(side_px[:, None, None] > 1e-6, cells, np.eye(2)))
    copies = GhostImages.none(count) if copies is None else copies
    shifts = copies.offsets_px @ squares_per_px.transpose(0, 2, 1) * PX_PER_SQUARE
    beside = [
        part[:, None] * sample(blurred.value, at - shift[:, None])
        for shift, part in zip(np.moveaxis(shifts, 1, 0), copies.parts.T, strict=True)
    ]
    if not fit_strengths:
        value, beside = sum(beside, value), []
    by_px = by_square @ squares_per_px
    steep = np.linalg.norm(by_px, axis=2)
    # Light that fades to one side dims what is printed: of black it takes little. Taken off both alike, the fading of
    # a lens towards the rim would pull all corners inwards.
    level = 1.0 + PRINTED * value
    looks = [np.ones_like(value), level * u, level * v, value, steep, laplacian, by_px[..., 0], by_px[..., 1]]
    terms = np.stack([*looks, *beside], axis=2)
    scale = np.maximum(np.sqrt((terms**2).mean(axis=1)), 1e-9)
    terms /= scale[:, None]
    # What is near the corner counts most: where it is must not hang on what its cells look like further out.
    near = np.exp(-(u * u + v * v) / 1.2)

    found = np.array(pixels, dtype=np.float64)
    explained, contrast = np.zeros(count), np.zeros(count)
    sigma_px, blur = np.full(count, np.inf), np.full(count, blur_cells)
    strength = np.zeros((count, len(beside)))
    weights = np.tile(near, (count, 1))
    moving = np.arange(count)
    for iteration in range(ITERATIONS):
        seen = sample(picture, found[moving, None] + offsets[moving])
        columns, weight = terms[moving], weights[moving]
        weighted = columns * weight[:, :, None]
        normal = weighted.transpose(0, 2, 1) @ columns + 1e-6 * np.eye(columns.shape[2])
        inverse = np.linalg.inv(normal)
        numbers = (inverse @ (weighted.transpose(0, 2, 1) @ seen[:, :, None]))[:, :, 0]
        rest = seen - (columns @ numbers[:, :, None])[:, :, 0]
        numbers = numbers / scale[moving]
        b = numbers[:, 3]
        with np.errstate(divide="ignore", invalid="ignore"):
            move = -numbers[:, 6:8] / b[:, None]
        limit = 0.15 * side_px[moving]
        length = np.linalg.norm(move, axis=1)
        move *= np.minimum(1.0, limit / np.maximum(length, 1e-12))[:, None]
        found[moving] += move
        # Noise by the median, so that a part that is covered does not hide itself.
        noise = 1.4826 * np.median(np.abs(rest), axis=1)
        tolerance = OUTLIER_SIGMAS * np.maximum(noise, LEAST_SIGMA * np.abs(b))
        weights[moving] = near * np.clip(1.0 - (rest / np.maximum(tolerance, 1e-9)[:, None]) ** 2, 0.0, None) ** 2
        mean = (seen * near).sum(axis=1, keepdims=True) / near.sum()
        explained[moving] = 1.0 - (near * rest**2).sum(axis=1) / np.maximum(
            (near * (seen - mean) ** 2).sum(axis=1), 1e-9
        )
        contrast[moving] = 2.0 * b
        spread = inverse[:, 6:8, 6:8] / (scale[moving, 6:8, None] * scale[moving, None, 6:8])
        with np.errstate(divide="ignore", invalid="ignore"):
            strength[moving] = numbers[:, 8:] / b[:, None]
            sigma_px[moving] = np.sqrt(np.linalg.eigvalsh(spread)[:, 1]) * noise / np.abs(b)
            blur[moving] = blur_cells * np.sqrt(np.clip(1.0 + 2.0 * numbers[:, 5] / (b * blur_cells**2), 0.25, 4.0))
        still = (length > SETTLED_PX) & (b > 0)
        moving = moving[still] if iteration else moving[b > 0]
        if not len(moving):
            break
    found[~(contrast > 0)] = np.nan
    return RefinedCorners(found, sigma_px, contrast, explained, blur, strength)
