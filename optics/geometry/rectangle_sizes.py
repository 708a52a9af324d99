"""Sizes of rectangular mirrors: any multiple of a step, as a glass cutter makes them, or those that a shop sells."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Self

import numpy as np

from mirrorcam.core.bounds import LENGTH_MM
from mirrorcam.core.values import FloatArray

FREE, RECTANGLES, STOCK = "free", "rectangles", "stock:"
SOLD_SIZES = "stock:25x15,30x20,40x30"
"""Sizes that shops sell, as a shape."""
MAX_STOCK_SIZES = 20
_SIZE = re.compile(r"(\d+(?:\.\d+)?)x(\d+(?:\.\d+)?)")


def canonical_shape(text: str) -> str:
    """The shape of mirrors as one text: free, rectangles, or stock: and sizes, each with its longer side first.

    Raises ValueError for anything else.
    """
    if text in (FREE, RECTANGLES):
        return text
    expected = f"expected {FREE}, {RECTANGLES}, or {STOCK} and sizes in mm such as {STOCK}25x15,30x20"
    if not text.startswith(STOCK):
        raise ValueError(f"shape is {text!r}, {expected}")
    sizes = set()
    for part in text.removeprefix(STOCK).split(","):
        match = _SIZE.fullmatch(part.strip())
        if match is None:
            raise ValueError(f"shape has the size {part!r}, {expected}")
        longer, shorter = sorted((float(side) for side in match.groups()), reverse=True)
        if not LENGTH_MM.min <= shorter <= longer <= LENGTH_MM.max:
            raise ValueError(f"shape has the size {part!r}, expected sides of {LENGTH_MM}")
        sizes.add((longer, shorter))
    if len(sizes) > MAX_STOCK_SIZES:
        raise ValueError(f"shape has {len(sizes)} sizes, expected at most {MAX_STOCK_SIZES}")
    return STOCK + ",".join(f"{longer:g}x{shorter:g}" for longer, shorter in sorted(sizes))


@dataclass(frozen=True)
class RectangleSizes:
    """The allowed sizes (width, height) of rectangular mirrors, mm.

    Attributes
    ----------
    step_mm : step of both sides, if any multiple is allowed.
    stock_mm : sizes (k, 2) that are sold, longer side first, for mirrors that lie on either side; (0, 2) if any
        multiple of the step is allowed.
    """

    step_mm: float
    stock_mm: FloatArray

    @classmethod
    def of(cls, shape: str, step_mm: float) -> Self | None:
        """The sizes of a canonical shape; None for free outlines."""
        if shape == FREE:
            return None
        parts = shape.removeprefix(STOCK).split(",") if shape.startswith(STOCK) else []
        return cls(step_mm, np.array([part.split("x") for part in parts], dtype=np.float64).reshape(-1, 2))

    @property
    def is_stock(self) -> bool:
        """Whether the sizes are those that are sold."""
        return len(self.stock_mm) > 0

    @property
    def options_mm(self) -> FloatArray:
        """Sizes (k, 2) that are sold, in both orientations, without doubles."""
        return np.unique(np.concatenate([self.stock_mm, self.stock_mm[:, ::-1]]), axis=0)

    def error_mm(self, size_mm: FloatArray) -> float:
        """Largest difference of a size (2,) from the nearest allowed size."""
        if self.is_stock:
            return float(np.abs(self.options_mm - size_mm).max(axis=1).min())
        return float(np.abs(size_mm - self.step_mm * np.maximum(np.round(size_mm / self.step_mm), 1.0)).max())
