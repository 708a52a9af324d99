"""What was detected in one picture."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.detection.seen_grid import SeenGrid
from mirrorcam.optics.calibration.solver.observations import Observations


@dataclass(frozen=True)
class DetectedFrame:
    """Corners in the views of one picture, and boards that belong to none of them.

    Attributes
    ----------
    corners
        The corners, as frame 0.
    unassigned_px
        Middles (k, 2) of boards in no mirror of the layout.
    grids
        Checkerboards, or parts of them, each with the mirror that shows it, whether it could be numbered or not; none
        where all of them could.

    Raises
    ------
    ValueError
        Where a middle is not finite, or not two numbers.
    """

    corners: Observations
    unassigned_px: FloatArray = field(default_factory=lambda: np.empty((0, 2)))
    grids: tuple[tuple[int, SeenGrid], ...] = ()

    def __post_init__(self) -> None:
        middles = np.array(self.unassigned_px, dtype=np.float64)
        if middles.ndim != 2 or middles.shape[1] != 2 or not np.isfinite(middles).all():
            raise ValueError(f"unassigned_px has shape {middles.shape}, expected (k, 2) of finite numbers")
        middles.flags.writeable = False
        object.__setattr__(self, "unassigned_px", middles)
