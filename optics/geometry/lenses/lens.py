"""The interface of lens models: distorted coordinates, their derivatives, and where they are defined."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from typing import ClassVar, NamedTuple, Self

import numpy as np

from mirrorcam.core.values import FloatArray


class Linearized(NamedTuple):
    """Distorted coordinates (n,) and their derivatives; `xy` is d distorted x / d y."""

    x: FloatArray
    y: FloatArray
    xx: FloatArray
    xy: FloatArray
    yx: FloatArray
    yy: FloatArray


@dataclass(frozen=True)
class Lens(ABC):
    """A lens model with its coefficients (k,).

    It maps the normalized coordinates (x/z, y/z) of a ray to distorted ones, which focal lengths and the principal
    point map to pixels.
    """

    coefficients: FloatArray

    NAMES: ClassVar[tuple[str, ...]] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """Names (k,) of the coefficients."""
        return self.NAMES

    @abstractmethod
    def distorted(self, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Distort normalized coordinates (...), also beyond `valid_radius`."""

    @abstractmethod
    def linearized(self, x: FloatArray, y: FloatArray, focal: tuple[float, float], out: FloatArray) -> Linearized:
        """Distort normalized coordinates (n,), with derivatives.

        Derivatives with respect to the coefficients, times the focal lengths along x and y, are written to `out`
        (n, 2, k), which must be zero.
        """

    @property
    def is_identity(self) -> bool:
        """Whether the lens has no distortion."""
        return not self.coefficients.any()

    @property
    @abstractmethod
    def valid_radius(self) -> float:
        """Normalized radius up to which the distorted radius increases; infinite if it always does."""

    @abstractmethod
    def flipped(self, axis: int) -> Self:
        """The lens for pictures flipped left-right (axis 0) or top-bottom (axis 1)."""

    def perturbed(self, change: FloatArray) -> Self:
        """The lens with changed k1, k2, p1, p2, k3 (5,), as individual lenses of one type differ."""
        coefficients = self.coefficients.copy()
        coefficients[:5] += change
        return replace(self, coefficients=coefficients)

    @property
    def prior_sigmas(self) -> FloatArray:
        """Prior standard deviations (k,) of the coefficients around zero for fits; infinite without a prior."""
        return np.full(len(self.coefficients), np.inf)

    def undistorted_estimate(self, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Approximate normalized coordinates (n,) of distorted ones, from which Newton's method converges."""
        if not np.isfinite(self.valid_radius):
            return x, y
        radius = np.sqrt(x * x + y * y)
        factor = np.minimum(1.0, 0.95 * self.valid_radius / np.maximum(radius, 1e-12))
        return x * factor, y * factor
