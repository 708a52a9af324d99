"""Given poses of a board, as a JSON file holds them."""

from __future__ import annotations

from typing import Annotated, Self

import numpy as np
from pydantic import model_validator

from mirrorcam.core.bounds import DEPTH_MM, PICTURES
from mirrorcam.core.values import FloatArray, Shaped, Value
from mirrorcam.render_scenes.settings import POSES_HZ


class PosesFile(Value):
    """Poses of the board: rig_from_board (n, 4, 4) in mm, and how many of them a motion passes in a second."""

    poses: Annotated[FloatArray, Shaped((None, 4, 4), largest=DEPTH_MM.most)]
    poses_hz: float = POSES_HZ.field(1.0)

    @model_validator(mode="after")
    def _check(self) -> Self:
        if not 1 <= len(self.poses) <= PICTURES.most:
            raise ValueError(f"{len(self.poses)} poses, expected 1 to {PICTURES.most}")
        for number, pose in enumerate(self.poses):
            turn = pose[:3, :3]
            if not np.allclose(turn @ turn.T, np.eye(3), rtol=0.0, atol=1e-6) or np.linalg.det(turn) < 0.0:
                raise ValueError(f"pose {number} turns by a matrix that is no rotation")
            if tuple(pose[3]) != (0.0, 0.0, 0.0, 1.0):
                raise ValueError(f"pose {number} has the last row {pose[3].tolist()}, expected 0, 0, 0, 1")
        return self
