"""Sub-pixel refinement of corners by comparison with the known print, and measures of a corner's visibility.

The picture around each corner is compared with its print, markers included, under the lens's blur. A refinement that
uses only the two crossing edges must stop short of a marker, and the marker biases it.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.detection.blurred_print import Image, sample, shifted
from mirrorcam.optics.calibration.detection.corner_patches import (
    BLUR,
    CONTRAST,
    FEW_SAMPLES,
    GHOSTS,
    SAMPLES,
    SHIFT,
    Appearance,
    ExpectedCorners,
    LinearModel,
    Patches,
    half_cells,
)

ITERATIONS, ROUGH_ITERATIONS, STRENGTH_ITERATIONS = 5, 3, 2
CONVERGED_PX, ROUGH_PX = 2e-3, 0.05
OUTLIER_SIGMAS = 4.0  # residual beyond which a sample has no weight, in standard deviations of the noise
MIN_SIGMA = 0.04  # of the noise, relative to the contrast: prints are not more uniform than this
MAX_STEP_CELLS = 0.15  # per iteration
MARGIN_PX = 8  # around the samples: for the interpolation, and for what corners move


@dataclass(frozen=True)
class _FinePicture:
    """A picture (h, w) around patches, interpolated to half the pixel pitch from the picture's pixel `origin`.

    Bilinear samples of the picture itself are blurred by their distance from the pixels' centres, which shifts corners
    by up to 5e-4 px, periodically from pixel to pixel.
    """

    doubled: Image
    origin: FloatArray

    @classmethod
    def around(cls, picture: Image, pixels: Image) -> _FinePicture:
        """Interpolate the part of a picture that has the samples at pixels (n, m, 2)."""
        valid = pixels[np.isfinite(pixels).all(axis=2)]
        size = np.array(picture.shape[1::-1])
        low, high = np.zeros(2, dtype=int), size
        if len(valid):
            low = np.clip(np.floor(valid.min(axis=0)).astype(int) - MARGIN_PX, 0, size - 1)
            high = np.clip(np.ceil(valid.max(axis=0)).astype(int) + MARGIN_PX, low + 1, size)
        part = np.ascontiguousarray(picture[low[1] : high[1], low[0] : high[0]])
        doubled: Any = cv2.resize(part, None, fx=2.0, fy=2.0, interpolation=cv2.INTER_LANCZOS4)
        return cls(doubled, low.astype(np.float64))

    def at(self, offsets_px: Image, pixels: FloatArray) -> Image:
        """Sample grey values (n, m) at offsets (n, m, 2) from pixels (n, 2)."""
        return sample(self.doubled, shifted(2.0 * offsets_px, 2.0 * (pixels - self.origin) + 0.5))


@dataclass(frozen=True)
class RefinedCorners:
    """Refined corners (n).

    Attributes
    ----------
    pixels
        Positions (n, 2); NaN where the search diverged.
    sigma_px
        Standard deviations (n,) per axis, the rms of both axes, from the noise around the corner.
    contrast
        White minus black (n,), in grey levels.
    explained_variance
        Fraction (n,) of the variance around the corner that the print explains.
    blur_px
        Sigma (n,) of the blur, px.
    ghost_strengths
        Estimated strengths (n, k) of the ghost images, relative to the expected ones; (n, 0) if not estimated. With
        `fit_encoding`, a last column holds how much stronger they are on white than on black.
    """

    pixels: FloatArray
    sigma_px: FloatArray
    contrast: FloatArray
    explained_variance: FloatArray
    blur_px: FloatArray
    ghost_strengths: FloatArray

    def where(self, mask: NDArray[np.bool_]) -> RefinedCorners:
        """Select the corners of a boolean mask (n,)."""
        return RefinedCorners(*(getattr(self, field.name)[mask] for field in fields(self)))


@dataclass(frozen=True)
class _Fit:
    """Weighted least-squares fit of grey values (n, m): coefficients (n, c), residuals (n, m) and noise (n,).

    `variance` (n,) is the variance of the shift, averaged over both axes, for independent samples of unit variance.
    """

    greys: Image
    residuals: Image
    coefficients: FloatArray
    variance: FloatArray
    noise: FloatArray

    @classmethod
    def of(cls, greys: Image, terms: Image, scale: Image, weights: Image) -> _Fit:
        """Fit terms (n, c, m), each divided by its scale (n, c)."""
        weighted = terms * weights[:, None]
        normal = np.asarray(weighted @ terms.transpose(0, 2, 1), dtype=np.float64) + 1e-6 * np.eye(terms.shape[1])
        shift = np.broadcast_to(np.eye(terms.shape[1])[:, SHIFT], (*scale.shape, 2))
        solved = np.linalg.solve(normal, np.concatenate([weighted @ greys[:, :, None], shift], axis=2))
        residuals = greys - (solved[:, None, :, 0].astype(np.float32) @ terms)[:, 0]
        # The noise is a median, so that an occluded part does not inflate it and thereby keep its weight.
        half = residuals.shape[1] // 2
        noise = np.asarray(1.4826 * np.partition(np.abs(residuals), half, axis=1)[:, half], dtype=np.float64)
        # The weights are not inverse variances, so the covariance is not the inverse of the normal matrix.
        shift = (solved[..., 1:].transpose(0, 2, 1) / scale[:, SHIFT, None]).astype(np.float32) @ weighted
        variance = np.asarray(np.einsum("nkm,nkm->n", shift, shift) / 2.0, dtype=np.float64)
        return cls(greys, residuals, solved[..., 0] / scale, variance, noise)

    @property
    def contrast(self) -> FloatArray:
        return self.coefficients[:, CONTRAST]

    @property
    def shift_px(self) -> FloatArray:
        """The Gauss-Newton step (n, 2)."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return -self.coefficients[:, SHIFT] / self.contrast[:, None]

    @property
    def sigma_px(self) -> FloatArray:
        """Standard deviation (n,) for noise that is independent between samples."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(np.sqrt(self.variance) * self.noise / np.abs(self.contrast))

    @property
    def ghost_strengths(self) -> FloatArray:
        with np.errstate(divide="ignore", invalid="ignore"):
            return self.coefficients[:, GHOSTS] / self.contrast[:, None]

    def blur_px(self, assumed: float) -> FloatArray:
        """Sigma (n,) of the blur, given the `assumed` one: the Laplacian's coefficient is half the added variance."""
        with np.errstate(divide="ignore", invalid="ignore"):
            added = 2.0 * self.coefficients[:, BLUR] / (self.contrast * assumed**2)
            return np.asarray(assumed * np.sqrt(np.clip(1.0 + added, 0.25, 4.0)))

    def explained_variance(self, centre_weights: Image) -> Image:
        centred = self.greys - (self.greys @ centre_weights / centre_weights.sum())[:, None]
        return np.asarray(1.0 - self.residuals**2 @ centre_weights / np.maximum(centred**2 @ centre_weights, 1e-9))

    def weights(self, centre_weights: Image) -> Image:
        """Tukey's biweight (n, m): unexplained samples, as under glare, lose their weight."""
        tolerance = OUTLIER_SIGMAS * np.maximum(self.noise, MIN_SIGMA * np.abs(self.contrast))
        ratio = self.residuals / np.maximum(tolerance, 1e-9).astype(np.float32)[:, None]
        return np.asarray(centre_weights * np.maximum(1.0 - ratio**2, 0.0) ** 2)


def colour_shifts(picture: Image, expected: ExpectedCorners, appearance: Appearance) -> FloatArray:
    """Measure where each colour shows corners, by one step of least squares.

    Parameters
    ----------
    picture
        Colours (h, w, c).
    expected
        The corners (n) at pixels that are right to a fraction of a pixel.
    appearance
        The print and its blur.

    Returns
    -------
    Shifts (c, n, 2) of the corners in each colour from these pixels, px; NaN where a colour shows none.
    """
    patches = Patches.around(expected, SAMPLES, half_cells(appearance.board))
    planes = [sample(np.asarray(plane), shifted(patches.offsets_px, expected.pixels)) for plane in cv2.split(picture)]
    model = LinearModel.of(expected, patches, appearance, np.mean(planes, axis=0))
    weights = np.tile(patches.centre_weights, (len(expected.print_xy), 1))
    fits = [_Fit.of(greys, model.terms, model.scale, weights) for greys in planes]
    return np.stack([np.where(fit.contrast[:, None] > 0.0, fit.shift_px, np.nan) for fit in fits])


def refine(picture: Image, expected: ExpectedCorners, appearance: Appearance) -> RefinedCorners:
    """Refine corners to the best fit of the print as it appears in a picture.

    Gauss-Newton steps estimate the shift of each corner jointly with the effects of light, ink and lens: a constant or
    linearly varying brightness, contrast, edges shifted towards black or white (by ink spread or a tone curve), and
    more or less blur. Unexplained samples, as under glare or beyond a mirror's edge, lose their weight.

    Parameters
    ----------
    picture
        Grey values (h, w).
    expected
        The corners (n) at their expected pixels.
    appearance
        The print, its blur and its ghost images.

    Returns
    -------
    RefinedCorners
        The corners (n,), with pixels NaN where the search diverged.
    """
    samples = FEW_SAMPLES if appearance.rough else SAMPLES
    patches = Patches.around(expected, samples, half_cells(appearance.board))
    fine = _FinePicture.around(picture, shifted(patches.offsets_px, expected.pixels))
    greys = fine.at(patches.offsets_px, expected.pixels)
    model = LinearModel.of(expected, patches, appearance, greys)
    count, centre_weights = len(expected.print_xy), patches.centre_weights
    pixels = np.array(expected.pixels, dtype=np.float64)
    explained_variance, contrast = np.zeros(count), np.zeros(count)
    sigma_px, blur = np.full(count, np.inf), np.full(count, appearance.blur_px)
    strengths = np.zeros((count, model.terms[:, GHOSTS].shape[1]))
    weights = np.tile(centre_weights, (count, 1))
    active = np.arange(count)
    iterations, converged_px = (ROUGH_ITERATIONS, ROUGH_PX) if appearance.rough else (ITERATIONS, CONVERGED_PX)
    if appearance.fit_strengths:
        iterations = STRENGTH_ITERATIONS
    for iteration in range(iterations):
        if iteration:
            greys = fine.at(patches.offsets_px[active], pixels[active])
        fit = _Fit.of(greys, model.terms[active], model.scale[active], weights[active])
        step = fit.shift_px
        length = np.linalg.norm(step, axis=1)
        step *= np.minimum(1.0, MAX_STEP_CELLS * patches.side_px[active] / np.maximum(length, 1e-12))[:, None]
        pixels[active] += step
        weights[active] = fit.weights(centre_weights)
        explained_variance[active], contrast[active] = fit.explained_variance(centre_weights), 2.0 * fit.contrast
        strengths[active], sigma_px[active] = fit.ghost_strengths, fit.sigma_px
        blur[active] = fit.blur_px(appearance.blur_px)
        visible = fit.contrast > 0
        active = active[visible & (length > converged_px)] if iteration else active[visible]
        if not len(active):
            break
    sigma_px *= patches.noise_gain
    # The model accounts for the assumed blur.
    pixels -= expected.skew_px(blur**2 - (0.0 if appearance.rough else appearance.blur_px**2))
    pixels[~(contrast > 0)] = np.nan
    return RefinedCorners(pixels, sigma_px, contrast, explained_variance, blur, strengths)
