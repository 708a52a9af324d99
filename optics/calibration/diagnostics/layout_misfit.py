"""Tests of whether frames fit the nominal layout: they may be upside down, or show mirrors that the layout lacks."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely

from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray, Metric
from mirrorcam.optics.calibration.detection.assignment import assign, regions_px
from mirrorcam.optics.calibration.detection.detections import DetectedFrame
from mirrorcam.optics.calibration.diagnostics.screening import screen
from mirrorcam.optics.calibration.solver.levenberg_marquardt import UndeterminedError
from mirrorcam.optics.calibration.solver.observations import Corners, Observations
from mirrorcam.optics.geometry.boards import CalibrationBoard, Checkerboard
from mirrorcam.optics.geometry.layout import Layout

ALARM_FRAMES = 0.2  # minimum fraction of the frames with boards that raises an alarm
MAX_SCATTER = 0.25  # standard deviation of boards about a grid, relative to its spacing


def fits_upside_down(mirrored: Sequence[Observations], layout: Layout, board: CalibrationBoard) -> bool:
    """Return whether the corners of mirrored frames are consistent once the pictures are rotated by 180 degrees.

    Parameters
    ----------
    mirrored
        Observations of each mirrored frame, numbered as frame 0.
    layout
        The nominal layout.
    board
        The board.
    """
    try:
        screen([_rotated(frame, layout, board) for frame in mirrored], [], layout, board.corners_in_board_mm)
    except (InputError, UndeterminedError):
        return False
    return True


def _rotated(frame: Observations, layout: Layout, board: CalibrationBoard) -> Observations:
    """Return the corners of a frame rotated by 180 degrees, reassigned to mirrors."""
    last_px = np.array([layout.camera.width_px, layout.camera.height_px]) - 1.0
    boards = []
    for view in np.unique(frame.view):
        rows = frame.view == view
        ids, pixels = frame.corner[rows], last_px - frame.pixels[rows]
        numberings = [Corners(ids, pixels)]
        if isinstance(board, Checkerboard) and board.looks_same_upside_down:
            numberings.append(Corners(len(board.corners_in_board_mm) - 1 - ids, pixels))
        boards.append(tuple(numberings))
    assigned = assign(boards, layout, board)
    return Observations.join(
        [Observations.of_view(0, mirror, corners.ids, corners.pixels, corners.sigma_px) for mirror, corners in assigned]
    )


@dataclass(frozen=True)
class UnknownMirrors:
    """Boards that belong to no mirror of a layout.

    Attributes
    ----------
    frames
        Number of frames that show such a board.
    alarms
        Alarms about the layout, if many frames show such a board.
    notes
        Otherwise one note per frame.
    question
        Question to the user if the frames seem to show a different grid of mirrors from the layout's; else empty.
    """

    frames: int = 0
    alarms: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    question: str = ""

    @property
    def metrics(self) -> dict[str, Metric]:
        """The number of frames with unknown mirrors, if there are any."""
        return {"frames_with_unknown_mirrors": Metric(value=self.frames, unit="1")} if self.frames else {}

    def error_for(self, refusal: str) -> InputError:
        """Return the error to raise: the alarm, which is the probable cause, or else `refusal` with the question."""
        if self.alarms:
            return InputError(self.alarms[0])
        return InputError(f"{refusal}; {self.question}" if self.question else refusal)


def unknown_mirrors(layout: Layout, frames: Sequence[DetectedFrame]) -> UnknownMirrors:
    """Examine the boards that were assigned to no mirror.

    A board counts if it lies in no sub-image of the layout, or in one that already shows another board. If a fifth of
    the frames have one, the layout is probably that of a different device.

    Parameters
    ----------
    layout
        The nominal layout.
    frames
        Detections in each mirrored frame.
    """
    regions = regions_px(layout)
    surplus = {number: _surplus_px(frame, regions) for number, frame in enumerate(frames)}
    positions = [
        f"frame {number} at pixel ({px[0, 0]:.0f}, {px[0, 1]:.0f})" for number, px in surplus.items() if len(px)
    ]
    frames_with_boards = sum(len(frame.corners) > 0 or len(frame.unassigned_px) > 0 for frame in frames)
    grid = observed_grid([_centroids_px(frame) for frame in frames])
    layout_grid = f"the layout has {layout.arrangement.text} mirrors"
    other_grid = "" if grid is None or grid == (layout.rows, layout.cols) else f"{grid[0]} x {grid[1]}"
    question = f"do the frames show {other_grid} mirrors? {layout_grid}" if other_grid else ""
    if not positions or len(positions) < max(ALARM_FRAMES * frames_with_boards, min(2, frames_with_boards)):
        notes = tuple(f"{position}: a board that belongs to no mirror of the layout" for position in positions)
        return UnknownMirrors(len(positions), notes=notes, question=question)
    frames_show = f"the frames seem to show {other_grid}, " if other_grid else ""
    side = _side(np.concatenate(list(surplus.values())), regions)
    alarm = (
        f"boards in {len(positions)} of {frames_with_boards} frames belong to no mirror of the layout, as in "
        f"{positions[0]}{side}: {frames_show}{layout_grid}; calibrate with the layout of this device"
    )
    return UnknownMirrors(len(positions), alarms=(alarm,), question=question)


def _side(points_px: FloatArray, regions: Sequence[shapely.Polygon]) -> str:
    """Describe on which side of all sub-images most of the points (k, 2) lie; empty if on none."""
    left, top, right, bottom = shapely.union_all(regions).bounds
    x, y = points_px.T
    outside = {"left of": x < left, "right of": x > right, "above": y < top, "below": y > bottom}
    most_outside = max(outside, key=lambda name: int(outside[name].sum()))
    return f", {most_outside} all its mirrors" if outside[most_outside].mean() > 0.5 else ""


def observed_grid(centroids_px: Sequence[FloatArray]) -> tuple[int, int] | None:
    """Return the rows and columns of views in the frames, from each frame's board centroids (k, 2); None if unclear.

    A majority of the frames with the largest number of boards must agree; among several frames, at least two must have
    this number.
    """
    counts = np.array([len(centroids) for centroids in centroids_px])
    min_frames = min(2, len(counts))
    board_counts = [
        count for count in np.unique(counts).tolist() if count > 1 and (counts == count).sum() >= min_frames
    ]
    if not board_counts:
        return None
    grids = [_grid(centroids) for centroids in centroids_px if len(centroids) == board_counts[-1]]
    grid, agreeing = Counter(grids).most_common(1)[0]
    return grid if 2 * agreeing > len(grids) else None


def _grid(points_px: FloatArray) -> tuple[int, int] | None:
    """Return the rows and columns of a grid of points (k, 2); None if they form none."""
    count = len(points_px)
    best, min_scatter = None, MAX_SCATTER
    for rows in (number for number in range(1, count + 1) if count % number == 0):
        order = np.argsort(points_px[:, 1], kind="stable").reshape(rows, -1)
        grid = np.array([row[np.argsort(row[:, 0], kind="stable")] for row in points_px[order]])
        column_x, row_y = grid[..., 0].mean(axis=0), grid[..., 1].mean(axis=1)
        column_steps, row_steps = np.diff(column_x), np.diff(row_y)
        # For a single row or column, the perpendicular scatter is relative to the spacing within it.
        scatter = max(
            float((grid[..., axis] - means).std()) / max(float(min(steps if len(steps) else other_steps)), 1e-9)
            for axis, means, steps, other_steps in (
                (0, column_x, column_steps, row_steps),
                (1, row_y[:, None], row_steps, column_steps),
            )
        )
        if scatter < min_scatter:
            best, min_scatter = (rows, count // rows), scatter
    return best


def _surplus_px(frame: DetectedFrame, regions: Sequence[shapely.Polygon]) -> FloatArray:
    """Centroids (k, 2) of the unassigned boards outside all mirrors that have no board assigned."""
    assigned = set(frame.corners.view.tolist())
    empty_regions = [region for mirror, region in enumerate(regions) if mirror not in assigned]
    centroids = frame.unassigned_px
    in_empty = np.any([shapely.contains_xy(region, *centroids.T) for region in empty_regions], axis=0)
    return centroids[~in_empty] if empty_regions else centroids


def _centroids_px(frame: DetectedFrame) -> FloatArray:
    """Centroids (k, 2) of all boards in a frame."""
    corners = frame.corners
    view_centroids = [corners.pixels[corners.view == view].mean(axis=0) for view in np.unique(corners.view)]
    return np.array([*view_centroids, *frame.unassigned_px]).reshape(-1, 2)
