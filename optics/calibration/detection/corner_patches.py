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
    blurred_print,
    in_print_px,
    local_print,
    moved,
    px_per_pitch,
    sample,
    sample_blurred,
)
from mirrorcam.optics.geometry.targets import AprilGrid, Target

HALF_CELLS = 0.5  # half side of the compared patch, in cells
HALF_GAPS = 0.76  # the same in gaps of an AprilGrid: patches across a gap would share most of their errors
MAX_HALF_PX = 14.0  # largest half side: in large cells, the outer part adds little
SAMPLES, FEW_SAMPLES = 17, 9  # along each side of the patch: for the fine and the rough refinement
MODULATION = 0.8  # (white - black) / (white + black), if a picture shows no print
MIN_MODULATION, MAX_MODULATION = 0.3, 0.95  # the latter for ink that reflects 1/40 as much as paper
NEAR_VARIANCE = 0.6  # of the Gaussian weight about a corner, in squared half sides of the patch
# Terms of a patch's model: level, two slopes, contrast, edge creep, blur, shift, motion blur, ghost images.
CONTRAST, BLUR, SHIFT, GHOSTS = 3, 5, slice(6, 8), slice(10, None)


@dataclass(frozen=True)
class ExpectedCorners:
    """Corners (n) at their expected pixels, with the local map from the print to the picture.

    Attributes
    ----------
    places
        Places on the print (n, 2), in squares from its top left.
    pixels
        Pixels (n, 2), wrong by a few px at most.
    cells
        Derivatives (n, 2, 2) of pixels by squares; columns: right, down.
    second_derivatives
        Half the second derivatives (n, 2, 3): xx, xy + yx, yy.
    """

    places: FloatArray
    pixels: FloatArray
    cells: FloatArray
    second_derivatives: FloatArray

    def where(self, mask: NDArray[np.bool_]) -> ExpectedCorners:
        """Select the corners of a boolean mask (n,)."""
        return ExpectedCorners(*(getattr(self, field.name)[mask] for field in fields(self)))

    @cached_property
    def squares_per_px(self) -> FloatArray:
        """Derivatives (n, 2, 2) of squares by pixels."""
        area = np.abs(np.linalg.det(self.cells))
        return np.asarray(np.linalg.inv(np.where(area[:, None, None] > 1e-12, self.cells, np.eye(2))))

    def skew_px(self, blur_px: FloatArray) -> FloatArray:
        """Bias (n, 2) of corners, px, from comparing with a print that is blurred before it is warped.

        A lens blurs the warped picture, with sigma `blur_px` (n,). Where cells vary in size within the blur, an edge
        blurred on the print is skewed in the picture: its profile erf(s + g s^2 / 2) fits erf(s) best with a shift of
        g sigma^2 / 4, because the squared slope has the variance sigma^2 / 2. Both edges of a corner shift along their
        normals, which gives the corner's bias.
        """
        squares_per_px = self.squares_per_px
        per_normal = squares_per_px @ squares_per_px.transpose(0, 2, 1)
        length = np.linalg.norm(squares_per_px, axis=2)
        per_px = per_normal / length[:, None]  # squares (n, 2, 2) per px along the normal of each edge, in columns
        x, y = per_px[:, 0], per_px[:, 1]
        second_derivative = squares_per_px @ (self.second_derivatives @ np.stack([x * x, x * y, y * y], axis=1))
        squares = -0.5 * blur_px[:, None] ** 2 * np.diagonal(second_derivative, axis1=1, axis2=2)
        return np.asarray((self.cells @ squares[..., None])[..., 0])


@dataclass(frozen=True)
class GhostImages:
    """Faint images (k) of the print around each corner (n): offsets (n, k, 2) px and relative strengths (n, k).

    Images of one `kind` (k,) of 0, 1, ... have the same cause, so one factor scales their strengths.
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

    def times(self, factors: FloatArray) -> GhostImages:
        """Scale the strengths by a factor for each kind."""
        return replace(self, strengths=self.strengths * factors[list(self.kind)])


@dataclass(frozen=True)
class Appearance:
    """Model of a print's appearance in a picture.

    Attributes
    ----------
    target
        The print.
    blur_px
        Assumed sigma of the lens's isotropic blur in the picture, px.
    ghosts
        Ghost images at every corner, if any.
    fit_strengths
        Whether to estimate the strength of each ghost image at each corner instead of keeping it fixed.
    fit_encoding
        Whether to estimate also how much stronger ghost images are on white than on black: equal if grey values are
        proportional to light.
    motion
        Whether to model motion blur.
    rough
        Whether some hundredths of a pixel suffice, which takes a fifth of the time.
    """

    target: Target
    blur_px: float
    ghosts: GhostImages | None = None
    fit_strengths: bool = False
    fit_encoding: bool = False
    motion: bool = True
    rough: bool = False


def half_cells(target: Target) -> float:
    """Half the side of the patches around a print's corners, in cells."""
    return min(HALF_CELLS, HALF_GAPS * (2.0 - target.longest_step)) if isinstance(target, AprilGrid) else HALF_CELLS


@dataclass(frozen=True)
class Patches:
    """Samples (m) around each corner (n): at `u`, `v` (m,) from -1 to 1, and at offsets `on_print` (n, m, 2) in
    squares.

    `offsets_px` (n, m, 2) are the offsets in the picture, and `side_px` (n,) the cell sizes. `near` (m,) are weights
    that decrease with distance, so that the outer parts of the cells do not affect the position. `half_cells` is half
    the patch's side.
    """

    u: Image
    v: Image
    near: Image
    on_print: Image
    offsets_px: Image
    side_px: FloatArray
    half_cells: float

    @classmethod
    def around(cls, expected: ExpectedCorners, samples: int = SAMPLES, half_cells: float = HALF_CELLS) -> Patches:
        u, v, near = _square(samples)
        side_px = np.sqrt(np.abs(np.linalg.det(expected.cells)))
        half = np.minimum(half_cells, MAX_HALF_PX / np.maximum(side_px, 1e-6))
        on_print = half.astype(np.float32)[:, None, None] * np.stack([u, v], axis=1)
        side = half[:, None, None]
        to_px = np.concatenate([expected.cells * side, expected.second_derivatives * side**2], axis=2).astype(
            np.float32
        )
        offsets = np.stack([u, v, u * u, u * v, v * v], axis=1) @ to_px.transpose(0, 2, 1)
        return cls(u, v, near, on_print, offsets, side_px, half_cells)

    @property
    def noise_gain(self) -> FloatArray:
        """Standard deviation (n,) of a smooth mean of samples, relative to independent samples.

        Interpolated samples less than two pixels apart share pixels: averaged over their positions relative to the
        pixels, the covariance of two samples is the cubic B-spline of their distance. Along either axis, samples `h` px
        apart thus have sum_k B(k h) / B(0) times the variance of independent samples.
        """
        half = np.minimum(self.half_cells * self.side_px, MAX_HALF_PX)
        samples = round(np.sqrt(len(self.u)))
        distances = np.maximum(2.0 * half / (samples - 1), 1e-6)[:, None] * np.arange(samples)
        beyond_one = np.clip(2.0 - distances, 0.0, None) ** 3 / 6.0
        share = np.where(distances < 1.0, 2.0 / 3.0 - distances**2 + distances**3 / 2.0, beyond_one)
        return np.asarray(2.0 * share.sum(axis=1) / share[:, 0] - 1.0)


@lru_cache(maxsize=2)
def _square(samples: int) -> tuple[Image, Image, Image]:
    """Samples on a square from -1 to 1, and their weights."""
    u, v = (axis.ravel() for axis in np.meshgrid(*[np.linspace(-1.0, 1.0, samples, dtype=np.float32)] * 2))
    return u, v, np.exp(-(u * u + v * v) / (2.0 * NEAR_VARIANCE))


@dataclass(frozen=True)
class LinearModel:
    """Terms (n, c, m), each divided by its `scale` (n, c), whose linear combination models the grey values."""

    terms: Image
    scale: Image

    @classmethod
    def of(cls, expected: ExpectedCorners, patches: Patches, appearance: Appearance, greys: Image) -> LinearModel:
        """Build the model at corners (n); `greys` (n, m) are the grey values at the expected positions."""
        local, places = local_print(appearance.target, expected.places)
        squares_per_px = expected.squares_per_px
        metric = squares_per_px @ squares_per_px.transpose(0, 2, 1)
        at = moved(patches.on_print, places)
        printed = sample_blurred(local, at, appearance.blur_px**2 * metric)
        value = printed.value
        xx, xy, yy = np.moveaxis(_second_by_px(squares_per_px).astype(np.float32) @ printed.second, 1, 0)
        ghosts = []
        if appearance.ghosts is not None:
            blur_cells = appearance.blur_px / float(np.median(patches.side_px))
            ghosts = _ghosts(local, blurred_print(local, blur_cells), at, squares_per_px, appearance.ghosts)
        if not appearance.fit_strengths:
            value, ghosts = sum(ghosts, value), []
        elif appearance.fit_encoding:
            ghosts = [*ghosts, value * sum(ghosts)]
        right, down = np.moveaxis(squares_per_px.transpose(0, 2, 1).astype(np.float32) @ printed.first, 1, 0)
        # A brightness gradient scales the print: it changes white more than black. Subtracting it equally from both
        # would let the lens's vignetting pull all corners inwards.
        level = 1.0 + _modulation(value, greys, patches.near) * value
        basis = [np.ones_like(value), level * patches.u, level * patches.v, value, np.hypot(right, down), xx + yy]
        # Motion blur acts along the motion and would shift corners of opposite polarity apart by a tenth of a pixel.
        motion = [xx - yy, xy] if appearance.motion else []
        terms = np.stack([*basis, right, down, *motion, *ghosts], axis=1)
        scale = np.maximum(np.sqrt(np.einsum("ncm,ncm->nc", terms, terms) / terms.shape[2]), 1e-9)
        terms /= scale[:, :, None]
        return cls(terms, scale)


def _second_by_px(squares_per_px: FloatArray) -> FloatArray:
    """Matrices (n, 3, 3) from second derivatives xx, xy, yy by squares to second derivatives by px."""
    (a, b), (c, d) = np.moveaxis(squares_per_px, 0, -1)
    return np.moveaxis(
        np.array([[a * a, 2.0 * a * c, c * c], [a * b, a * d + b * c, c * d], [b * b, 2.0 * b * d, d * d]]), 2, 0
    )


def _modulation(value: Image, greys: Image, near: Image) -> float:
    """(white - black) / (white + black) of a print of values (n, m) in a picture: the median over patches (n)."""
    weights = near / near.sum()
    mean, level = value @ weights, greys @ weights
    variance = (value * value) @ weights - mean**2
    contrast = ((value * greys) @ weights - mean * level) / np.maximum(variance, 1e-9)
    level = level - contrast * mean
    visible = (contrast > 0.0) & (level > 0.0)
    if not visible.any():
        return MODULATION
    return float(np.clip(np.median(contrast[visible] / level[visible]), MIN_MODULATION, MAX_MODULATION))


def _ghosts(
    target: Target, blurred: BlurredPrint, at: Image, squares_per_px: FloatArray, ghosts: GhostImages
) -> list[Image]:
    """Ghost images (n, m) of a print at places (n, m, 2) on it, summed for each kind."""
    shifts = px_per_pitch(target) * ghosts.offsets_px @ squares_per_px.transpose(0, 2, 1)
    in_print = in_print_px(target, at)
    images = [
        strength[:, None] * sample(blurred.value, moved(in_print, -shift))
        for shift, strength in zip(np.moveaxis(shifts, 1, 0), ghosts.strengths.T.astype(np.float32), strict=True)
    ]
    kinds = range(max(ghosts.kind, default=-1) + 1)
    return [
        sum(image for image, kind_of_image in zip(images, ghosts.kind, strict=True) if kind_of_image == kind)
        for kind in kinds
    ]
