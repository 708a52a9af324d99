"""What every lens model offers: distorted coordinates, their derivatives, and where they are defined."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from typing import ClassVar, NamedTuple, Self

import numpy as np

from mirrorcam.core.values import FloatArray


class Linearized(NamedTuple):
    """Distorted coordinates (n,) and their derivatives: `xy` is that of distorted x by y."""

    x: FloatArray
    y: FloatArray
    xx: FloatArray
    xy: FloatArray
    yx: FloatArray
    yy: FloatArray


@dataclass(frozen=True)
class Lens(ABC):
    """A lens model with its coefficients (k,).

    It takes the coordinates (x/z, y/z) of a ray, called normalized, to distorted ones, which focal lengths and the
    principal point take to pixels.
    """

    coefficients: FloatArray

    NAMES: ClassVar[tuple[str, ...]] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """Names (k,) of the coefficients."""
        return self.NAMES

    @abstractmethod
    def distorted(self, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Distorted coordinates of normalized ones (...), also beyond `valid_radius`."""

    @abstractmethod
    def linearized(self, x: FloatArray, y: FloatArray, focal: tuple[float, float], out: FloatArray) -> Linearized:
        """Distorted coordinates of normalized ones (n,), and their derivatives.

        Those by the coefficients, times the focal lengths along x and y, are written to `out` (n, 2, k), which is zero.
        """

    @property
    def is_identity(self) -> bool:
        """Whether distorted coordinates are the normalized ones."""
        return not self.coefficients.any()

    @property
    @abstractmethod
    def valid_radius(self) -> float:
        """Normalized radius up to which the distorted radius grows (infinite where it never folds)."""

    @abstractmethod
    def flipped(self, axis: int) -> Self:
        """The lens of pictures whose left and right (0), or top and bottom (1), are exchanged."""

    def disturbed(self, change: FloatArray) -> Self:
        """The lens with other k1, k2, p1, p2, k3, which is how far lenses of one kind differ."""
        coefficients = self.coefficients.copy()
        coefficients[:5] += change
        return replace(self, coefficients=coefficients)

    @property
    def prior_sigmas(self) -> FloatArray:
        """Standard deviations (k,) around zero that a fit may assume of the coefficients; infinite: nothing."""
        return np.full(len(self.coefficients), np.inf)

    def undistorted_roughly(self, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Normalized coordinates (n,) near those of distorted ones, from where Newton's method converges."""
        if not np.isfinite(self.valid_radius):
            return x, y
        radius = np.sqrt(x * x + y * y)
        factor = np.minimum(1.0, 0.95 * self.valid_radius / np.maximum(radius, 1e-12))
        return x * factor, y * factor
