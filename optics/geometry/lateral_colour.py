"""Lateral colour: red and blue appear at a slightly different magnification than green."""

from __future__ import annotations

from typing import Annotated

import numpy as np

from mirrorcam.core.values import FloatArray, Shaped, Value

LUMA = np.array([0.299, 0.587, 0.114])
"""Weights of red, green and blue in grey pictures (ITU-R BT.601)."""
LARGEST_SHIFT = 0.05


class LateralColour(Value):
    """Displacements of red and blue in a camera's pictures.

    With the normalised coordinates n = (x, y) of a pixel p and the principal point c, a point that green shows at p is
    shown at p + (scale + radial (x^2 + y^2)) (p - c). The camera's lens is that of grey pictures.

    Attributes
    ----------
    red, blue : ndarray
        Scale and radial number (2,) of each colour against green.
    red_sigma, blue_sigma : ndarray
        Their standard deviations (2,).
    """

    red: Annotated[FloatArray, Shaped((2,), largest=LARGEST_SHIFT)]
    blue: Annotated[FloatArray, Shaped((2,), largest=LARGEST_SHIFT)]
    red_sigma: Annotated[FloatArray, Shaped((2,), largest=LARGEST_SHIFT)]
    blue_sigma: Annotated[FloatArray, Shaped((2,), largest=LARGEST_SHIFT)]

    def against_grey(self, squared_radius: FloatArray) -> FloatArray:
        """Relative displacements (3, ...) of red, green and blue against grey, at squared radii (...) of x and y."""
        powers = np.stack([np.ones_like(squared_radius), squared_radius], axis=-1)
        red, blue = powers @ self.red, powers @ self.blue
        green = -(LUMA[0] * red + LUMA[2] * blue)
        return np.stack([green + red, green, green + blue])
