"""The parameterisation of a calibration: which parameters a model leaves free."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mirrorcam.optics.calibration.solver.residuals import Board, global_names
from mirrorcam.optics.geometry.camera import INTRINSIC_NAMES


@dataclass(frozen=True)
class Model:
    """Parameters that a fit may change besides the board's poses, which are always free.

    Attributes
    ----------
    intrinsics
        Free intrinsics, of `INTRINSIC_NAMES`; none in the paper's calibration.
    thickness
        One correction, in mm, to the thickness of all plates of second-surface mirrors. Their refractive index is held:
        only t (1 - tan' / tan) is observable, in which thickness and index are nearly one number.
    curvature
        Three numbers per mirror, the curvature of its reflecting surface.
    board
        The corners as drawn and the modes by which they may differ; every mode is free.
    mirrors
        The virtual centres; where they are held, a fit only finds the board's poses.
    """

    intrinsics: tuple[str, ...]
    thickness: bool
    curvature: bool
    board: Board
    mirrors: bool = True

    def __post_init__(self) -> None:
        unknown = [name for name in self.intrinsics if name not in INTRINSIC_NAMES]
        if unknown:
            raise ValueError(f"unknown intrinsics {', '.join(unknown)}, expected some of {', '.join(INTRINSIC_NAMES)}")

    def parameters(self, mirrors: int) -> tuple[str, ...]:
        """Names of the free globals of a layout with `mirrors` mirrors, in the order of `global_names`."""
        names = np.array(global_names(mirrors, len(self.board.modes)))
        return tuple(names[self.free(mirrors)].tolist())

    def free(self, mirrors: int) -> NDArray[np.int64]:
        """Indices (g,) of the free globals among `global_names`, increasing."""

        def is_free(name: str) -> bool:
            if name.startswith("mirror "):
                return self.curvature if "curvature" in name else self.mirrors
            return name in self.intrinsics or (self.thickness if name == "sheet_mm" else name.startswith("board "))

        names = global_names(mirrors, len(self.board.modes))
        return np.array([place for place, name in enumerate(names) if is_free(name)], dtype=np.int64)
