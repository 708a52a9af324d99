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
"""Number of cells across a picture; corners in one cell count as the same position."""
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
    """The sharpest frame of each of up to `max_frames` equally long segments of a video of unknown length.

    Frames are added one at a time. Whenever there are twice as many segments, pairs of them are merged.
    """

    def __init__(self, max_frames: int) -> None:
        self._max_frames, self._length, self._count = max_frames, 1, 0
        self._best: list[SharpFrame] = []

    def add(self, frame: SharpFrame) -> None:
        """Add the next frame."""
        if self._count % self._length == 0:
            self._best.append(frame)
        elif frame.sharpness > self._best[-1].sharpness:
            self._best[-1] = frame
        self._count += 1
        if len(self._best) == 2 * self._max_frames and self._count % self._length == 0:
            self._best = [
                max(pair, key=lambda frame: frame.sharpness)
                for pair in zip(self._best[::2], self._best[1::2], strict=True)
            ]
            self._length *= 2

    def chosen(self) -> list[SharpFrame]:
        """Return the sharpest frame of each segment, by number, after merging segments down to `max_frames`."""
        if len(self._best) <= self._max_frames:
            return list(self._best)
        segments = np.arange(len(self._best)) * self._max_frames // len(self._best)
        return [
            max((self._best[k] for k in np.flatnonzero(segments == segment)), key=lambda frame: frame.sharpness)
            for segment in range(self._max_frames)
        ]


def most_informative(
    boards: Sequence[Sequence[Corners]], corners_in_board_mm: FloatArray, *, width_px: int, max_frames: int
) -> list[int]:
    """Choose at most `max_frames` frames whose boards cover the picture and differ in pose; return their numbers.

    A frame's features are the picture cells that each board covers (together weighted as much as its pose) and its
    poses. Its value is the sum of 1 / (1 + n) over its features, each of which n chosen frames have. Frames are chosen
    greedily by value.

    Parameters
    ----------
    boards
        Boards found in each frame, each in one of its numberings.
    corners_in_board_mm
        The board's corners (c, 3) in the board frame as drawn, mm.
    width_px
        Width of the pictures, px.
    max_frames
        Maximum number of frames; fewer are chosen if fewer show a board.
    """
    features = [dict(_features(frame, corners_in_board_mm, width_px / CELLS_ACROSS)) for frame in boards]
    counts: dict[Hashable, int] = {}
    candidates = [number for number, frame_features in enumerate(features) if frame_features]
    chosen: list[int] = []

    def value(number: int) -> float:
        return sum(weight / (1 + counts.get(item, 0)) for item, weight in features[number].items())

    while candidates and len(chosen) < max_frames:
        best = max(candidates, key=value)
        candidates.remove(best)
        chosen.append(best)
        for item in features[best]:
            counts[item] = counts.get(item, 0) + 1
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
        nominal = corners_in_board_mm[board.ids, :2]
        homogeneous = np.column_stack([nominal, np.ones(len(nominal))])
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
