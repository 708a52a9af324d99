"""An AprilGrid whose gaps and modules are whole numbers of texels of the small renderer."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.boards import AprilGrid

GRID = AprilGrid(cols=6, rows=4, tag_mm=25.0, spacing=0.2)


@dataclass(frozen=True)
class Sheet:
    """A print of `GRID`, with its lengths in units of the pitch."""

    square_mm: float = GRID.pitch_mm

    @property
    def corners_in_board_mm(self) -> FloatArray:
        return GRID.corners_in_board_mm

    @property
    def size_mm(self) -> tuple[float, float]:
        return GRID.size_mm

    def image(self, px_per_square: int, /) -> NDArray[np.uint8]:
        px_per_tag = px_per_square / GRID.pitch_mm * GRID.tag_mm
        assert px_per_tag % 10 == 0
        return GRID.image(round(px_per_tag))
