"""Observations of frames: the bare camera's view of the target, or every sub-image of a mirror camera."""

from __future__ import annotations

import numpy as np

from optics.calibration.detection import markers
from optics.calibration.detection.assignment import assign
from optics.calibration.detection.corners import Corners, Grey, find_checkerboards, orderings, spread_out
from optics.calibration.detection.sheet import corner_places, grow
from optics.calibration.observations import DIRECT, Observations
from optics.layout import Layout
from optics.targets import Charuco, Checkerboard


def find_boards(grey: Grey, target: Checkerboard | Charuco, *, mirrored: bool, most: int) -> list[tuple[Corners, ...]]:
    """Up to `most` boards in a picture (h, w), the largest first, each in all of its possible numberings.

    `mirrored` where the picture shows them by way of mirrors. Boards whose corners are few or near one line are left
    out: they do not tell where they stand.
    """
    if isinstance(target, Charuco):
        found: list[tuple[Corners, ...]] = [
            (board,) for board in markers.find_boards(grey, target, mirrored=mirrored, most=most)
        ]
    else:
        picture, places = np.asarray(grey, dtype=np.float32), corner_places(target)
        found = [
            tuple(
                grow(picture, places, ordering, target, mirrored=mirrored)
                for ordering in orderings(grey, board, target, mirrored=mirrored)
            )
            for board in find_checkerboards(grey, target, most=most)
        ]
    return [board for board in found if board and all(len(spread_out(corners)) for corners in board)]


def direct_view(grey: Grey, target: Checkerboard | Charuco) -> Observations:
    """Corners that the bare camera sees, as frame 0; of several boards, those of the largest."""
    for numberings in find_boards(grey, target, mirrored=False, most=1):
        return Observations.of_view(0, DIRECT, numberings[0].ids, numberings[0].pixels)
    return Observations.none()


def sub_images(grey: Grey, layout: Layout, target: Checkerboard | Charuco) -> Observations:
    """Corners in every mirror of a frame (h, w), as frame 0; a view that shows no board adds no rows."""
    boards = find_boards(grey, target, mirrored=True, most=2 * len(layout.mirrors))
    return Observations.join([Observations.of_view(0, i, c.ids, c.pixels) for i, c in assign(boards, layout, target)])
