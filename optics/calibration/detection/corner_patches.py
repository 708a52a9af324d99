"""Linear model of the picture around a corner: the print blurred by the lens, with effects of light, ink and lens."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.detection.blurred_print import (
    BlurredPrint,
    Image,
    PrintSamples,
    blurred_print,
    image_px_of_print,
    local_print,
    px_per_pitch,
    sample,
    sample_blurred,
    shifted,
    third_derivatives,
)
from mirrorcam.optics.geometry.boards import AprilGrid, CalibrationBoard

HALF_CELLS = 0.5  # half side of the compared patch, in cells
HALF_GAPS = 0.76  # the same, in gaps of an AprilGrid: larger patches across a gap would share most of their errors
MAX_HALF_PX = 14.0  # maximum half side: in large cells, the outer part adds little
SAMPLES, FEW_SAMPLES = 17, 9  # along each side of the patch: for the fine and the rough refinement
MODULATION = 0.8  # (white - black) / (white + black), assumed if a picture shows no print
MIN_MODULATION, MAX_MODULATION = 0.3, 0.95  # the latter for ink that reflects 1/40 as much as paper
# Variances of the Gaussian weight about a corner, in squared half sides of the patch: the rough refinement needs a wide
# range, but a camera's noise reduction and sharpening let what lies around a corner pull it.
WEIGHT_VARIANCE, ROUGH_WEIGHT_VARIANCE = 0.3, 0.6
# Terms of a patch's model: level, gradient, contrast, tone, blur, shift, motion blur, ghost images.
CONTRAST, BLUR, SHIFT, GHOSTS = 3, 5, slice(6, 8), slice(10, None)


@dataclass(frozen=True)
class ExpectedCorners:
    """Corners (n) at their expected pixels, with the local map from the print to the picture.

    Attributes
    ----------
    print_xy
        Coordinates (n, 2) on the print, in squares from its top left.
    pixels
        Pixels (n, 2), with errors of at most a few px.
    cells
        Derivatives (n, 2, 2) of pixels with respect to squares; columns: right, down.
    second_derivatives
        Half the second derivatives (n, 2, 3): xx, xy + yx, yy.
    """

    print_xy: FloatArray
    pixels: FloatArray
    cells: FloatArray
    second_derivatives: FloatArray

    def where(self, mask: NDArray[np.bool_]) -> ExpectedCorners:
        """Select the corners of a boolean mask (n,)."""
        return ExpectedCorners(*(getattr(self, field.name)[mask] for field in fields(self)))

    @cached_property
    def squares_per_px(self) -> FloatArray:
        """Derivatives (n, 2, 2) of squares with respect to pixels."""
        area = np.abs(np.linalg.det(self.cells))
        return np.asarray(np.linalg.inv(np.where(area[:, None, None] > 1e-12, self.cells, np.eye(2))))

    def skew_px(self, variance_px2: FloatArray) -> FloatArray:
        """Bias (n, 2) of corners, px, caused by comparing with a print that is blurred before it is warped.

        A lens blurs the warped picture, with a variance of `variance_px2` (n,). Where cells vary in size within the
        blur, an edge blurred on the print is skewed in the picture: its profile erf(s + g s^2 / 2) fits erf(s) best
        with a shift of g sigma^2 / 4, because the squared derivative of erf has the variance sigma^2 / 2. Both edges of
        a corner shift along their normals, which gives the corner's bias. Edges of markers nearby are not considered.
        """
        squares_per_px = self.squares_per_px
        per_normal = squares_per_px @ squares_per_px.transpose(0, 2, 1)
        length = np.linalg.norm(squares_per_px, axis=2)
        per_px = per_normal / length[:, None]  # squares (n, 2, 2) per px along the edges' normals, one column per edge
        x, y = per_px[:, 0], per_px[:, 1]
        second_derivative = squares_per_px @ (self.second_derivatives @ np.stack([x * x, x * y, y * y], axis=1))
        squares = -0.5 * variance_px2[:, None] * np.diagonal(second_derivative, axis1=1, axis2=2)
        return np.asarray((self.cells @ squares[..., None])[..., 0])


@dataclass(frozen=True)
class GhostImages:
    """Faint images (k) of the print around each corner (n): offsets (n, k, 2) px and relative strengths (n, k).

    `kind` (k,) numbers their causes from 0: one factor scales the strengths of all images of a kind.
    """

    offsets_px: FloatArray
    strengths: FloatArray
    kind: tuple[int, ...]

    def where(self, mask: NDArray[np.bool_]) -> GhostImages:
        """Select the ghost images of the corners of a boolean mask (n,)."""
        return replace(self, offsets_px=self.offsets_px[mask], strengths=self.strengths[mask])

    def of_kinds(self, mask: NDArray[np.bool_]) -> GhostImages:
        """Select the ghost images of some kinds, renumbered."""
        kept = [index for index, kind in enumerate(self.kind) if mask[kind]]
        numbers = np.cumsum(mask) - 1
        kind = tuple(int(numbers[self.kind[index]]) for index in kept)
        return GhostImages(self.offsets_px[:, kept], self.strengths[:, kept], kind)

    def scaled(self, factors: FloatArray) -> GhostImages:
        """Scale the strengths by a factor for each kind."""
        return replace(self, strengths=self.strengths * factors[list(self.kind)])


@dataclass(frozen=True)
class Appearance:
    """Model of a print's appearance in a picture.

    Attributes
    ----------
    board
        The print.
    blur_px
        Assumed sigma of the lens's isotropic blur in the picture, px.
    ghosts
        Ghost images at every corner, if any.
    fit_strengths
        Whether to estimate the strength of each ghost image at each corner instead of keeping it fixed.
    fit_encoding
        Whether to also estimate how much stronger ghost images are on white than on black; equal if grey values are
        proportional to light.
    motion
        Whether to model motion blur.
    rough
        Whether an accuracy of some hundredths of a pixel suffices, which takes a fifth of the time.
    """

    board: CalibrationBoard
    blur_px: float
    ghosts: GhostImages | None = None
    fit_strengths: bool = False
    fit_encoding: bool = False
    motion: bool = True
    rough: bool = False


def half_cells(board: CalibrationBoard) -> float:
    """Half the side of the patches around a print's corners, in cells."""
    return min(HALF_CELLS, HALF_GAPS * (2.0 - board.longest_step)) if isinstance(board, AprilGrid) else HALF_CELLS


@dataclass(frozen=True)
class Patches:
    """Samples (m) around each corner (n), at `u`, `v` (m,) from -1 to 1.

    `print_offsets` (n, m, 2) are the offsets on the print in squares, `offsets_px` (n, m, 2) those in the picture, and
    `side_px` (n,) the cell sizes. `centre_weights` (m,) decrease with distance, so that the outer parts of the cells do
    not affect the position. `half_cells` is half the patch's side.
    """

    u: Image
    v: Image
    centre_weights: Image
    print_offsets: Image
    offsets_px: Image
    side_px: FloatArray
    half_cells: float

    @classmethod
    def around(cls, expected: ExpectedCorners, samples: int = SAMPLES, half_cells: float = HALF_CELLS) -> Patches:
        u, v, centre_weights = _square(samples)
        side_px = np.sqrt(np.abs(np.linalg.det(expected.cells)))
        half = np.minimum(half_cells, MAX_HALF_PX / np.maximum(side_px, 1e-6))
        print_offsets = half.astype(np.float32)[:, None, None] * np.stack([u, v], axis=1)
        side = half[:, None, None]
        to_px = np.concatenate([expected.cells * side, expected.second_derivatives * side**2], axis=2).astype(
            np.float32
        )
        offsets = np.stack([u, v, u * u, u * v, v * v], axis=1) @ to_px.transpose(0, 2, 1)
        return cls(u, v, centre_weights, print_offsets, offsets, side_px, half_cells)

    @property
    def noise_gain(self) -> FloatArray:
        """Standard deviation (n,) of a smooth mean of samples, relative to independent samples.

        Interpolated samples share pixels. Averaged over positions relative to the pixels, the correlation of samples
        `d` px apart along either axis is sinc(0.82 d) exp(-d^2 / 8) within 0.02: the autocorrelation of Lanczos's
        kernel at half the pitch, followed by bilinear interpolation. Samples at the distances k h thus multiply the
        variance of independent samples by the sum of their correlations.
        """
        half = np.minimum(self.half_cells * self.side_px, MAX_HALF_PX)
        samples = round(np.sqrt(len(self.u)))
        distances = np.maximum(2.0 * half / (samples - 1), 1e-6)[:, None] * np.arange(samples)
        correlation = np.sinc(0.82 * distances) * np.exp(-(distances**2) / 8.0)
        return np.asarray(2.0 * correlation.sum(axis=1) - 1.0)


@lru_cache(maxsize=2)
def _square(samples: int) -> tuple[Image, Image, Image]:
    """Samples on a square from -1 to 1, and their weights."""
    u, v = (axis.ravel() for axis in np.meshgrid(*[np.linspace(-1.0, 1.0, samples, dtype=np.float32)] * 2))
    variance = ROUGH_WEIGHT_VARIANCE if samples == FEW_SAMPLES else WEIGHT_VARIANCE
    return u, v, np.exp(-(u * u + v * v) / (2.0 * variance))


@dataclass(frozen=True)
class LinearModel:
    """Terms (n, c, m), each divided by its `scale` (n, c), whose linear combination models the grey values."""

    terms: Image
    scale: Image

    @classmethod
    def of(cls, expected: ExpectedCorners, patches: Patches, appearance: Appearance, greys: Image) -> LinearModel:
        """Build the model at corners (n); `greys` (n, m) are the grey values at the expected positions."""
        local, print_xy = local_print(appearance.board, expected.print_xy)
        squares_per_px = expected.squares_per_px
        metric = squares_per_px @ squares_per_px.transpose(0, 2, 1)
        sample_xy = shifted(patches.print_offsets, print_xy)
        blur = appearance.blur_px**2 * metric
        printed = sample_blurred(local, sample_xy, blur)
        value = printed.value
        if not appearance.rough:
            third = third_derivatives(local, sample_xy, blur)
            value = value + _warped_first(printed, third, patches, squares_per_px @ expected.second_derivatives, blur)
        xx, xy, yy = np.moveaxis(_second_derivative_maps(squares_per_px).astype(np.float32) @ printed.second, 1, 0)
        ghosts = []
        if appearance.ghosts is not None:
            blur_cells = appearance.blur_px / float(np.median(patches.side_px))
            ghosts = _ghosts(local, blurred_print(local, blur_cells), sample_xy, squares_per_px, appearance.ghosts)
        if not appearance.fit_strengths:
            value, ghosts = sum(ghosts, value), []
        elif appearance.fit_encoding:
            ghosts = [*ghosts, value * sum(ghosts)]
        right, down = np.moveaxis(squares_per_px.transpose(0, 2, 1).astype(np.float32) @ printed.first, 1, 0)
        # A brightness gradient scales the print: it changes white more than black. Subtracting it equally from both
        # would let the lens's vignetting pull all corners inwards.
        level = 1.0 + _modulation(value, greys, patches.centre_weights) * value
        # Ink spread, and tone curves of cameras, widen black or white where the print's blurred value is between them.
        basis = [np.ones_like(value), level * patches.u, level * patches.v, value, value * value, xx + yy]
        # Motion blur acts along the motion and would shift corners of opposite polarity apart by a tenth of a pixel.
        motion = [xx - yy, xy] if appearance.motion else []
        terms = np.stack([*basis, right, down, *motion, *ghosts], axis=1)
        scale = np.maximum(np.sqrt(np.einsum("ncm,ncm->nc", terms, terms) / terms.shape[2]), 1e-9)
        terms /= scale[:, :, None]
        return cls(terms, scale)


def _warped_first(printed: PrintSamples, third: Image, patches: Patches, bend: FloatArray, blur: FloatArray) -> Image:
    """Difference (n, m) between a print that is warped, then blurred as by a lens, and one that is blurred first.

    With the print p, its blur B by the covariance S, and a warp z + r(z) with the quadratic r = z^T R z, the blur of
    p(z + r) is B(z + r) + 2 z^T R S grad dB + tr(R S) dB + tr(S R S hess dB) to first order in R, where d is the
    derivative along r's component, summed over both components.

    Parameters
    ----------
    printed, third
        The blurred print's samples, with all derivatives (n, 4, m) of the third order.
    patches
        The samples' offsets on the print.
    bend
        Half the second derivatives (n, 2, 3) of the picture with respect to the print, in squares: xx, xy + yx, yy.
    blur
        Covariances (n, 2, 2), in squares.
    """
    xx, xy, yy = np.moveaxis(-bend, 2, 0)
    quadratic = np.stack([xx, xy / 2.0, xy / 2.0, yy], axis=2).reshape(-1, 2, 2, 2)  # one matrix per component
    spread = quadratic @ blur[:, None]
    (xxx, xx_y, _, xyy), (yxx, yxy, _, yyy) = np.moveaxis((blur[:, None] @ spread).reshape(-1, 2, 4), 0, 2)
    by_third = np.stack([xxx, 2.0 * xx_y + yxx, xyy + 2.0 * yxy, yyy], axis=1)
    by_second = 2.0 * np.stack([spread[:, 0, :, 0], spread[:, 0, :, 1] + spread[:, 1, :, 0], spread[:, 1, :, 1]], 1)
    second = by_second.astype(np.float32) @ patches.print_offsets.transpose(0, 2, 1)
    first = np.trace(spread, axis1=2, axis2=3).astype(np.float32)[:, None] @ printed.first
    return np.asarray(
        first[:, 0]
        + np.einsum("nsm,nsm->nm", second, printed.second)
        + (by_third.astype(np.float32)[:, None] @ third)[:, 0]
    )


def _second_derivative_maps(squares_per_px: FloatArray) -> FloatArray:
    """Matrices (n, 3, 3) from second derivatives xx, xy, yy with respect to squares to those with respect to px."""
    (a, b), (c, d) = np.moveaxis(squares_per_px, 0, -1)
    return np.moveaxis(
        np.array([[a * a, 2.0 * a * c, c * c], [a * b, a * d + b * c, c * d], [b * b, 2.0 * b * d, d * d]]), 2, 0
    )


def _modulation(value: Image, greys: Image, centre_weights: Image) -> float:
    """(white - black) / (white + black) of a print with values (n, m) in a picture: the median over patches (n)."""
    weights = centre_weights / centre_weights.sum()
    mean, level = value @ weights, greys @ weights
    variance = (value * value) @ weights - mean**2
    contrast = ((value * greys) @ weights - mean * level) / np.maximum(variance, 1e-9)
    level = level - contrast * mean
    visible = (contrast > 0.0) & (level > 0.0)
    if not visible.any():
        return MODULATION
    return float(np.clip(np.median(contrast[visible] / level[visible]), MIN_MODULATION, MAX_MODULATION))


def _ghosts(
    board: CalibrationBoard, blurred: BlurredPrint, sample_xy: Image, squares_per_px: FloatArray, ghosts: GhostImages
) -> list[Image]:
    """Ghost images (n, m) of a print at points (n, m, 2) on it, summed for each kind."""
    shifts = px_per_pitch(board) * ghosts.offsets_px @ squares_per_px.transpose(0, 2, 1)
    print_px = image_px_of_print(board, sample_xy)
    images = [
        strength[:, None] * sample(blurred.value, shifted(print_px, -shift))
        for shift, strength in zip(np.moveaxis(shifts, 1, 0), ghosts.strengths.T.astype(np.float32), strict=True)
    ]
    kinds = range(max(ghosts.kind, default=-1) + 1)
    return [
        sum(image for image, kind_of_image in zip(images, ghosts.kind, strict=True) if kind_of_image == kind)
        for kind in kinds
    ]
