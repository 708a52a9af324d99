"""Sub-pixel refinement of corners by comparison with the known print, and tests of whether a corner is there.

The picture around each corner is compared with what is printed there, markers included, blurred as this lens blurs it.
A refinement that uses only the two crossing edges has to stop short of a marker, and is biased by it.
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
SETTLED_PX, ROUGH_PX = 2e-3, 0.05
OUTLIER_SIGMAS = 4.0  # of the noise around a corner, from where a sample has no weight
MIN_SIGMA = 0.04  # of the contrast: a print is itself no more even than this
MAX_STEP_CELLS = 0.15  # per iteration


@dataclass(frozen=True)
class RefinedCorners:
    """Corners (n) as they were refined.

    Attributes
    ----------
    pixels
        Positions (n, 2); NaN where the search diverged.
    sigma_px
        Standard deviations (n,) per axis, the root mean square of both, by the noise around the corner.
    contrast
        White less black, in grey levels (n,).
    explained
        Fraction (n,) of the variance around the corner that the print explains.
    blur_px
        Sigma (n,) of the blur, px.
    ghost_strengths
        Estimated strengths (n, k) of the ghost images, relative to those expected; (n, 0) where they are not estimated.
        Where it is estimated, one more column is how much more they show on white than on black.
    """

    pixels: FloatArray
    sigma_px: FloatArray
    contrast: FloatArray
    explained: FloatArray
    blur_px: FloatArray
    ghost_strengths: FloatArray

    def where(self, mask: NDArray[np.bool_]) -> RefinedCorners:
        """The corners of a boolean mask (n,)."""
        return RefinedCorners(*(getattr(self, field.name)[mask] for field in fields(self)))


@dataclass(frozen=True)
class _Fit:
    """Weighted least squares of the grey values `seen` (n, m): coefficients (n, c), residuals (n, m), noise (n,).

    `variance` (n,) is that of the coefficients of the shift for noise of variance 1, which is independent between
    samples: the mean of both axes.
    """

    seen: Image
    rest: Image
    coefficients: FloatArray
    variance: FloatArray
    noise: FloatArray

    @classmethod
    def of(cls, seen: Image, terms: Image, scale: Image, weights: Image) -> _Fit:
        """That of terms (n, c, m), each divided by its scale (n, c)."""
        weighted = terms * weights[:, None]
        normal = np.asarray(weighted @ terms.transpose(0, 2, 1), dtype=np.float64) + 1e-6 * np.eye(terms.shape[1])
        shift = np.broadcast_to(np.eye(terms.shape[1])[:, SHIFT], (*scale.shape, 2))
        solved = np.linalg.solve(normal, np.concatenate([weighted @ seen[:, :, None], shift], axis=2))
        rest = seen - (solved[:, None, :, 0].astype(np.float32) @ terms)[:, 0]
        # Noise by the median, so that a part that is covered does not hide itself.
        half = rest.shape[1] // 2
        noise = np.asarray(1.4826 * np.partition(np.abs(rest), half, axis=1)[:, half], dtype=np.float64)
        # The weights are not inverse variances, so that the covariance is the inverse only for equal ones.
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
        """For noise that is independent between samples (n,)."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(np.sqrt(self.variance) * self.noise / np.abs(self.contrast))

    @property
    def ghost_strengths(self) -> FloatArray:
        with np.errstate(divide="ignore", invalid="ignore"):
            return self.coefficients[:, GHOSTS] / self.contrast[:, None]

    def blur_px(self, assumed: float) -> FloatArray:
        """Sigma of the blur (n,), where `assumed` was used: the Laplacian's coefficient is half the added variance."""
        with np.errstate(divide="ignore", invalid="ignore"):
            added = 2.0 * self.coefficients[:, BLUR] / (self.contrast * assumed**2)
            return np.asarray(assumed * np.sqrt(np.clip(1.0 + added, 0.25, 4.0)))

    def explained(self, near: Image) -> Image:
        off = self.seen - (self.seen @ near / near.sum())[:, None]
        return np.asarray(1.0 - self.rest**2 @ near / np.maximum(off**2 @ near, 1e-9))

    def weights(self, near: Image) -> Image:
        """Tukey's biweight (n, m): samples that the print does not explain, as of glare, lose their weight."""
        tolerance = OUTLIER_SIGMAS * np.maximum(self.noise, MIN_SIGMA * np.abs(self.contrast))
        off = self.rest / np.maximum(tolerance, 1e-9).astype(np.float32)[:, None]
        return np.asarray(near * np.maximum(1.0 - off**2, 0.0) ** 2)


def refine(picture: Image, expected: ExpectedCorners, appearance: Appearance) -> RefinedCorners:
    """Refine corners to where the print, as it appears in a picture, fits best.

    Gauss-Newton for the shift of each corner, together with everything that light, ink and lens may add: a constant or
    sloping brightness, contrast, edges that have crept towards black or white (ink that spreads, a camera's gamma), and
    more or less blur. Samples that are not explained, as of glare or past a mirror's edge, lose their weight.

    Parameters
    ----------
    picture
        Grey values (h, w).
    expected
        The corners (n) and where they are expected.
    appearance
        The print, its blur and its ghost images.

    Returns
    -------
    RefinedCorners
        As many corners (n), with pixels NaN where the search diverged.
    """
    samples = FEW_SAMPLES if appearance.rough else SAMPLES
    patches = Patches.around(expected, samples, half_cells(appearance.target))
    seen = sample(picture, moved(patches.offsets_px, expected.pixels))
    model = LinearModel.of(expected, patches, appearance, seen)
    count, near = len(expected.places), patches.near
    found = np.array(expected.pixels, dtype=np.float64)
    explained, contrast = np.zeros(count), np.zeros(count)
    sigma_px, blur = np.full(count, np.inf), np.full(count, appearance.blur_px)
    strengths = np.zeros((count, model.terms[:, GHOSTS].shape[1]))
    weights = np.tile(near, (count, 1))
    moving = np.arange(count)
    iterations, settled_px = (ROUGH_ITERATIONS, ROUGH_PX) if appearance.rough else (ITERATIONS, SETTLED_PX)
    if appearance.fit_strengths:
        iterations = STRENGTH_ITERATIONS
    for iteration in range(iterations):
        if iteration:
            seen = sample(picture, moved(patches.offsets_px[moving], found[moving]))
        fit = _Fit.of(seen, model.terms[moving], model.scale[moving], weights[moving])
        move = fit.shift_px
        length = np.linalg.norm(move, axis=1)
        move *= np.minimum(1.0, MAX_STEP_CELLS * patches.side_px[moving] / np.maximum(length, 1e-12))[:, None]
        found[moving] += move
        weights[moving] = fit.weights(near)
        explained[moving], contrast[moving] = fit.explained(near), 2.0 * fit.contrast
        strengths[moving], sigma_px[moving] = fit.ghost_strengths, fit.sigma_px
        blur[moving] = fit.blur_px(appearance.blur_px)
        seen_at_all = fit.contrast > 0
        moving = moving[seen_at_all & (length > settled_px)] if iteration else moving[seen_at_all]
        if not len(moving):
            break
    sigma_px *= patches.noise_gain
    found -= expected.skew_px(blur)
    found[~(contrast > 0)] = np.nan
    return RefinedCorners(found, sigma_px, contrast, explained, blur, strengths)
