"""Test whether pictures are upside down, where they do not fit the layout as they are."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mirrorcam.core.values import InputError
from mirrorcam.optics.calibration.detection.assignment import assign
from mirrorcam.optics.calibration.diagnostics.screening import screen
from mirrorcam.optics.calibration.solver.levenberg_marquardt import UndeterminedError
from mirrorcam.optics.calibration.solver.observations import Corners, Observations
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.targets import Checkerboard, Target


def fits_upside_down(seen: Sequence[Observations], layout: Layout, target: Target) -> bool:
    """Return whether the corners of frames with mirrors agree once the pictures are turned by 180 degrees.

    Parameters
    ----------
    seen
        Observations of each frame with mirrors, as frame 0.
    layout
        The nominal layout.
    target
        The board.
    """
    try:
        screen([_turned(frame, layout, target) for frame in seen], [], layout, target.corners_in_board_mm)
    except (InputError, UndeterminedError):
        return False
    return True


def _turned(frame: Observations, layout: Layout, target: Target) -> Observations:
    """A frame's boards as the turned picture shows them, assigned to mirrors anew."""
    last = np.array([layout.camera.width_px, layout.camera.height_px]) - 1.0
    boards = []
    for view in np.unique(frame.view):
        rows = frame.view == view
        ids, pixels = frame.corner[rows], last - frame.pixels[rows]
        numberings = [Corners(ids, pixels)]
        if isinstance(target, Checkerboard) and target.looks_same_upside_down:
            numberings.append(Corners(len(target.corners_in_board_mm) - 1 - ids, pixels))
        boards.append(tuple(numberings))
    found = assign(boards, layout, target)
    return Observations.join(
        [Observations.of_view(0, mirror, corners.ids, corners.pixels, corners.sigma_px) for mirror, corners in found]
    )
