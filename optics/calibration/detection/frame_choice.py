"""Choice of a video's frames for calibration: sharp ones, and among these those with the most new information."""

from __future__ import annotations

from collections.abc import Hashable, Iterator, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.detection.checkerboard import Grey
from mirrorcam.optics.calibration.solver.observations import Corners

CELLS_ACROSS = 16
"""Number of cells across a picture; corners in one cell count as the same place."""
ROTATION_BIN_DEG, FORESHORTENING_BIN, SIZE_BIN = 20.0, 0.12, 0.35
"""Bin sizes of board poses: direction, foreshortening, and logarithm of the size."""
MIN_CORNERS = 4


@dataclass(frozen=True, eq=False)
class SharpFrame:
    """A grey frame (h, w) of a video, its number from 0, and its sharpness: the mean squared Laplacian."""

    number: int
    picture: Grey
    sharpness: float

    @classmethod
    def of(cls, number: int, picture: Grey) -> SharpFrame:
        laplacian = cv2.Laplacian(picture, cv2.CV_32F)
        return cls(number, picture, float(np.mean(np.square(laplacian))))


class SharpestFrames:
    """The sharpest frame of each of up to `most` stretches of equal length of a video of unknown length.

    Frames are added one at a time. Whenever there are twice as many stretches, pairs of them are merged.
    """

    def __init__(self, most: int) -> None:
        self._most, self._length, self._count = most, 1, 0
        self._best: list[SharpFrame] = []

    def add(self, frame: SharpFrame) -> None:
        """Add the next frame."""
        if self._count % self._length == 0:
            self._best.append(frame)
        elif frame.sharpness > self._best[-1].sharpness:
            self._best[-1] = frame
        self._count += 1
        if len(self._best) == 2 * self._most and self._count % self._length == 0:
            self._best = [
                max(pair, key=lambda frame: frame.sharpness)
                for pair in zip(self._best[::2], self._best[1::2], strict=True)
            ]
            self._length *= 2

    def chosen(self) -> list[SharpFrame]:
        """Return at most `most` frames, by number: the sharpest of each stretch, after merging stretches as needed."""
        if len(self._best) <= self._most:
            return list(self._best)
        stretches = np.arange(len(self._best)) * self._most // len(self._best)
        return [
            max((self._best[k] for k in np.flatnonzero(stretches == stretch)), key=lambda frame: frame.sharpness)
            for stretch in range(self._most)
        ]


def most_informative(
    boards: Sequence[Sequence[Corners]], corners_in_board_mm: FloatArray, *, width_px: int, most: int
) -> list[int]:
    """Choose at most `most` frames whose boards cover the picture and differ in pose; return their numbers.

    A frame's value is the sum over its features, the picture cells that each board covers (together weighted as much as
    its pose) and its poses, of 1 / (1 + n), n chosen frames having the feature. Frames are chosen greedily by value.

    Parameters
    ----------
    boards
        Boards found in each frame, each in one of its numberings.
    corners_in_board_mm
        The board's corners (c, 3) in the board frame as drawn, mm.
    width_px
        Width of the pictures, px.
    most
        Largest number of frames; fewer are chosen if fewer show a board.
    """
    features = [dict(_features(frame, corners_in_board_mm, width_px / CELLS_ACROSS)) for frame in boards]
    seen: dict[Hashable, int] = {}
    candidates = [number for number, of_frame in enumerate(features) if of_frame]
    chosen: list[int] = []

    def value(number: int) -> float:
        return sum(share / (1 + seen.get(item, 0)) for item, share in features[number].items())

    while candidates and len(chosen) < most:
        best = max(candidates, key=value)
        candidates.remove(best)
        chosen.append(best)
        for item in features[best]:
            seen[item] = seen.get(item, 0) + 1
    return sorted(chosen)


def _features(
    boards: Sequence[Corners], corners_in_board_mm: FloatArray, cell_px: float
) -> Iterator[tuple[Hashable, float]]:
    """Yield a frame's features and their weights: cells with corners, and the poses of its boards."""
    for board in boards:
        if len(board) < MIN_CORNERS:
            continue
        cells = np.unique((board.pixels // cell_px).astype(np.int64), axis=0)
        yield from ((("corner", *cell), 1.0 / len(cells)) for cell in cells.tolist())
        drawn = corners_in_board_mm[board.ids, :2]
        homogeneous = np.column_stack([drawn, np.ones(len(drawn))])
        linear_map = np.linalg.lstsq(homogeneous, board.pixels, rcond=None)[0][:2]
        rotation, stretch, _ = np.linalg.svd(linear_map)
        x_axis = linear_map.T @ [1.0, 0.0]
        pose = (
            *(board.pixels.mean(axis=0) // (2.0 * cell_px)).astype(int).tolist(),
            int(np.degrees(np.arctan2(x_axis[1], x_axis[0])) // ROTATION_BIN_DEG),
            int(np.degrees(np.arctan2(rotation[1, 0], rotation[0, 0])) % 180.0 // (2.0 * ROTATION_BIN_DEG)),
            int(stretch[1] / max(stretch[0], 1e-9) // FORESHORTENING_BIN),
            int(np.log(max(stretch.prod(), 1e-9)) / 2.0 // SIZE_BIN),
        )
        yield ("pose", *pose), 1.0
