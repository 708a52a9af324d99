"""Readout time of a rolling shutter, from the board's motion during readouts and between consecutive frames."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.solver.residuals import Estimate

MIN_FRAMES = 5
MIN_SIGMAS = 10.0
"""Minimum significance: pictures that are no consecutive frames of a video have motions without a relation to it."""
CLIP = 3.0
"""Ratio to the typical deviation beyond which a frame's motion is left out."""


@dataclass(frozen=True)
class Readout:
    """Readout time of a frame from its first row to its last, in frame periods, and its standard deviation."""

    periods: float
    sigma: float


def readout(estimate: Estimate, numbers: Sequence[int], size_mm: float) -> Readout | None:
    """Compare the motions during readouts with the differences between the poses before and after each frame.

    Parameters
    ----------
    estimate
        An estimate with motions.
    numbers
        Numbers of its first frames in their recording; others are left out.
    size_mm
        Length by which rotations are multiplied, of the order of the board's size.

    Returns
    -------
    Readout or None
        None unless motions and differences agree: the pictures are no consecutive frames, or the board rests.
    """
    middle = [f for f in range(1, len(numbers) - 1) if numbers[f + 1] - numbers[f - 1] == 2]
    moved = [f for f in middle if estimate.motion[f].any()]
    if len(moved) < MIN_FRAMES:
        return None
    poses = estimate.rig_from_board
    before, after = poses[np.subtract(moved, 1)], poses[np.add(moved, 1)]
    turn = Rotation.from_matrix(after[:, :3, :3] @ before[:, :3, :3].transpose(0, 2, 1)).as_rotvec() / 2.0
    velocity = np.concatenate([size_mm * turn, (after[:, :3, 3] - before[:, :3, 3]) / 2.0], axis=1)
    motion = estimate.motion[moved] * [*[size_mm] * 3, *[1.0] * 3]
    used = np.ones(len(moved), dtype=bool)
    for _ in range(3):
        periods = _slope(velocity[used], motion[used])
        deviation = np.linalg.norm(motion - periods * velocity, axis=1)
        used = deviation <= CLIP * max(float(np.median(deviation)), 1e-9)
    squares = float(np.sum(velocity[used] ** 2))
    sigma = float(np.sqrt(np.sum(deviation[used] ** 2) / max(motion[used].size - 1, 1) / max(squares, 1e-12)))
    return Readout(periods, sigma) if 0.0 < periods <= 1.0 and periods > MIN_SIGMAS * sigma else None


def _slope(x: FloatArray, y: FloatArray) -> float:
    return float(np.sum(x * y) / max(float(np.sum(x**2)), 1e-12))
