"""Sub-pixel refinement of corners by comparison with the known print, and measures of whether a corner is visible.

The picture around each corner is compared with its print, markers included, under the lens's blur. A refinement that
uses only the two crossing edges must stop short of a marker, and the marker biases it.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.detection.blurred_print import Image, moved, sample
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
OUTLIER_SIGMAS = 4.0  # noise levels around a corner beyond which a sample has no weight
MIN_SIGMA = 0.04  # of the contrast: prints are no more even than this
MAX_STEP_CELLS = 0.15  # per iteration


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
    explained
        Fraction (n,) of the variance around the corner that the print explains.
    blur_px
        Sigma (n,) of the blur, px.
    ghost_strengths
        Estimated strengths (n, k) of the ghost images, relative to the expected ones; (n, 0) if not estimated. With
        `fit_encoding`, a last column holds how much more they show on white than on black.
    """

    pixels: FloatArray
    sigma_px: FloatArray
    contrast: FloatArray
    explained: FloatArray
    blur_px: FloatArray
    ghost_strengths: FloatArray

    def where(self, mask: NDArray[np.bool_]) -> RefinedCorners:
        """Select the corners of a boolean mask (n,)."""
        return RefinedCorners(*(getattr(self, field.name)[mask] for field in fields(self)))


@dataclass(frozen=True)
class _Fit:
    """Weighted least-squares fit of grey values `seen` (n, m): coefficients (n, c), `residuals` (n, m), noise
    (n,).

    `variance` (n,) is the variance of the shift, averaged over both axes, for independent samples of unit variance.
    """

    seen: Image
    residuals: Image
    coefficients: FloatArray
    variance: FloatArray
    noise: FloatArray

    @classmethod
    def of(cls, seen: Image, terms: Image, scale: Image, weights: Image) -> _Fit:
        """Fit terms (n, c, m), each divided by its scale (n, c)."""
        weighted = terms * weights[:, None]
        normal = np.asarray(weighted @ terms.transpose(0, 2, 1), dtype=np.float64) + 1e-6 * np.eye(terms.shape[1])
        shift = np.broadcast_to(np.eye(terms.shape[1])[:, SHIFT], (*scale.shape, 2))
        solved = np.linalg.solve(normal, np.concatenate([weighted @ seen[:, :, None], shift], axis=2))
        rest = seen - (solved[:, None, :, 0].astype(np.float32) @ terms)[:, 0]
        # Noise by the median, so that a covered part does not hide itself.
        half = rest.shape[1] // 2
        noise = np.asarray(1.4826 * np.partition(np.abs(rest), half, axis=1)[:, half], dtype=np.float64)
        # The weights are not inverse variances, so the covariance is not the inverse of the normal matrix.
        shift = (solved[..., 1:].transpose(0, 2, 1) / scale[:, SHIFT, None]).astype(np.float32) @ weighted
        variance = np.asarray(np.einsum("nkm,nkm->n", shift, shift) / 2.0, dtype=np.float64)
        return cls(seen, rest, solved[..., 0] / scale, variance, noise)

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
        """Standard deviation (n,) if the noise is independent between samples."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(np.sqrt(self.variance) * self.noise / np.abs(self.contrast))

    @property
    def ghost_strengths(self) -> FloatArray:
        with np.errstate(divide="ignore", invalid="ignore"):
            return self.coefficients[:, GHOSTS] / self.contrast[:, None]

    def blur_px(self, assumed: float) -> FloatArray:
        """Sigma of the blur (n,), given the `assumed` one: the Laplacian's coefficient is half the added variance."""
        with np.errstate(divide="ignore", invalid="ignore"):
            added = 2.0 * self.coefficients[:, BLUR] / (self.contrast * assumed**2)
            return np.asarray(assumed * np.sqrt(np.clip(1.0 + added, 0.25, 4.0)))

    def explained(self, near: Image) -> Image:
        centred = self.seen - (self.seen @ near / near.sum())[:, None]
        return np.asarray(1.0 - self.residuals**2 @ near / np.maximum(centred**2 @ near, 1e-9))

    def weights(self, near: Image) -> Image:
        """Tukey's biweight (n, m): unexplained samples, as under glare, lose their weight."""
        tolerance = OUTLIER_SIGMAS * np.maximum(self.noise, MIN_SIGMA * np.abs(self.contrast))
        ratio = self.residuals / np.maximum(tolerance, 1e-9).astype(np.float32)[:, None]
        return np.asarray(near * np.maximum(1.0 - ratio**2, 0.0) ** 2)


def refine(picture: Image, expected: ExpectedCorners, appearance: Appearance) -> RefinedCorners:
    """Refine corners to the best fit of the print as it appears in a picture.

    Gauss-Newton steps estimate the shift of each corner jointly with the effects of light, ink and lens: a constant or
    sloping brightness, contrast, edges that have crept towards black or white (by ink spread or a camera's gamma), and
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
    patches = Patches.around(expected, samples, half_cells(appearance.target))
    greys = sample(picture, moved(patches.offsets_px, expected.pixels))
    model = LinearModel.of(expected, patches, appearance, greys)
    count, near = len(expected.places), patches.near
    pixels = np.array(expected.pixels, dtype=np.float64)
    explained, contrast = np.zeros(count), np.zeros(count)
    sigma_px, blur = np.full(count, np.inf), np.full(count, appearance.blur_px)
    strengths = np.zeros((count, model.terms[:, GHOSTS].shape[1]))
    weights = np.tile(near, (count, 1))
    moving = np.arange(count)
    iterations, converged_px = (ROUGH_ITERATIONS, ROUGH_PX) if appearance.rough else (ITERATIONS, CONVERGED_PX)
    if appearance.fit_strengths:
        iterations = STRENGTH_ITERATIONS
    for iteration in range(iterations):
        if iteration:
            greys = sample(picture, moved(patches.offsets_px[moving], pixels[moving]))
        fit = _Fit.of(greys, model.terms[moving], model.scale[moving], weights[moving])
        move = fit.shift_px
        length = np.linalg.norm(move, axis=1)
        move *= np.minimum(1.0, MAX_STEP_CELLS * patches.side_px[moving] / np.maximum(length, 1e-12))[:, None]
        pixels[moving] += move
        weights[moving] = fit.weights(near)
        explained[moving], contrast[moving] = fit.explained(near), 2.0 * fit.contrast
        strengths[moving], sigma_px[moving] = fit.ghost_strengths, fit.sigma_px
        blur[moving] = fit.blur_px(appearance.blur_px)
        visible = fit.contrast > 0
        moving = moving[visible & (length > converged_px)] if iteration else moving[visible]
        if not len(moving):
            break
    sigma_px *= patches.noise_gain
    pixels -= expected.skew_px(blur)
    pixels[~(contrast > 0)] = np.nan
    return RefinedCorners(pixels, sigma_px, contrast, explained, blur, strengths)
