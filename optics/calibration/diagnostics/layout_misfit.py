"""Tests of whether frames fit the nominal layout: they may be upside down, or show more mirrors than the layout has."""

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
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.targets import Checkerboard, Target

ALARM_FRAMES = 0.2  # fraction of the frames that show a board
UNEVEN = 0.25  # scatter of boards about a grid along an axis, relative to its spacing there


def fits_upside_down(seen: Sequence[Observations], layout: Layout, target: Target) -> bool:
    """Return whether the corners of mirrored frames are consistent once the pictures are rotated by 180 degrees.

    Parameters
    ----------
    seen
        Observations of each mirrored frame, as frame 0.
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
    """Return a frame's boards as in the rotated picture, reassigned to mirrors."""
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


@dataclass(frozen=True)
class UnknownMirrors:
    """Boards that no mirror of a layout explains.

    Attributes
    ----------
    frames
        Number of frames that show any.
    alarms
        Alarms about the layout, if there are many such frames.
    notes
        Notes on single frames otherwise.
    question
        Question about the grid of mirrors that the frames seem to show, if it is not the layout's; else empty.
    """

    frames: int = 0
    alarms: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    question: str = ""

    @property
    def metrics(self) -> dict[str, Metric]:
        """The number of frames with unknown mirrors, if there are any."""
        return {"frames_with_unknown_mirrors": Metric(value=self.frames, unit="1")} if self.frames else {}

    def explained(self, refusal: str) -> InputError:
        """Return the error for a refusal, replaced by the alarm, its probable cause, if there is one."""
        if self.alarms:
            return InputError(self.alarms[0])
        return InputError(f"{refusal}; {self.question}" if self.question else refusal)


def unknown_mirrors(layout: Layout, frames: Sequence[DetectedFrame]) -> UnknownMirrors:
    """Examine the boards that were assigned to no mirror.

    A board counts if it lies in no sub-image of the layout, or in one that already shows another board. If a fifth of
    the frames have one, the layout is probably for another device.

    Parameters
    ----------
    layout
        The nominal layout.
    frames
        Detections in each mirrored frame.
    """
    regions = regions_px(layout)
    surplus = {number: _surplus_px(frame, regions) for number, frame in enumerate(frames)}
    places = [f"frame {number} at pixel ({at[0, 0]:.0f}, {at[0, 1]:.0f})" for number, at in surplus.items() if len(at)]
    shown = sum(len(frame.corners) > 0 or len(frame.unassigned_px) > 0 for frame in frames)
    grid = grid_shown([_middles_px(frame) for frame in frames])
    own = f"the layout has {layout.arrangement.text} mirrors"
    other = "" if grid is None or grid == (layout.rows, layout.cols) else f"{grid[0]} x {grid[1]}"
    question = other and f"do the frames show {other} mirrors? {own}"
    if not places or len(places) < max(ALARM_FRAMES * shown, min(2, shown)):
        notes = tuple(f"{place}: a board that belongs to no mirror of the layout" for place in places)
        return UnknownMirrors(len(places), notes=notes, question=question)
    seen = f"the frames seem to show {other}, " if other else ""
    side = _side(np.concatenate(list(surplus.values())), regions)
    alarm = (
        f"boards in {len(places)} of {shown} frames belong to no mirror of the layout, as in {places[0]}{side}: "
        f"{seen}{own}; calibrate with the layout of this device"
    )
    return UnknownMirrors(len(places), alarms=(alarm,), question=question)


def _side(places_px: FloatArray, regions: Sequence[shapely.Polygon]) -> str:
    """Describe the side of all sub-images on which most of the places (k, 2) lie; empty if there is none."""
    left, top, right, bottom = shapely.union_all(regions).bounds
    x, y = places_px.T
    beyond = {"left of": x < left, "right of": x > right, "above": y < top, "below": y > bottom}
    words = max(beyond, key=lambda side: int(beyond[side].sum()))
    return f", {words} all its mirrors" if beyond[words].mean() > 0.5 else ""


def grid_shown(middles_px: Sequence[FloatArray]) -> tuple[int, int] | None:
    """Return the rows and columns of the views that frames show, from board middles (k, 2) per frame; None if unclear.

    Most of the frames with the largest number of boards must agree; if there are several frames, at least two must have
    that number.
    """
    counts = np.array([len(middles) for middles in middles_px])
    often = min(2, len(counts))
    numbers = [count for count in np.unique(counts).tolist() if count > 1 and (counts == count).sum() >= often]
    if not numbers:
        return None
    grids = [_grid(middles) for middles in middles_px if len(middles) == numbers[-1]]
    grid, times = Counter(grids).most_common(1)[0]
    return grid if 2 * times > len(grids) else None


def _grid(middles_px: FloatArray) -> tuple[int, int] | None:
    """Return the rows and columns of a grid of points (k, 2); None if they form none."""
    count = len(middles_px)
    best, least = None, UNEVEN
    for rows in (number for number in range(1, count + 1) if count % number == 0):
        order = np.argsort(middles_px[:, 1], kind="stable").reshape(rows, -1)
        grid = np.array([row[np.argsort(row[:, 0], kind="stable")] for row in middles_px[order]])
        across, down = grid[..., 0].mean(axis=0), grid[..., 1].mean(axis=1)
        steps_across, steps_down = np.diff(across), np.diff(down)
        # For a single row or column, the scatter across it is relative to the spacing along it.
        uneven = max(
            float((grid[..., axis] - middles).std()) / max(float(min(steps if len(steps) else others)), 1e-9)
            for axis, middles, steps, others in (
                (0, across, steps_across, steps_down),
                (1, down[:, None], steps_down, steps_across),
            )
        )
        if uneven < least:
            best, least = (rows, count // rows), uneven
    return best


def _surplus_px(frame: DetectedFrame, regions: Sequence[shapely.Polygon]) -> FloatArray:
    """Middles (k, 2) of the unassigned boards for which there is no mirror."""
    shown = set(frame.corners.view.tolist())
    empty = [region for mirror, region in enumerate(regions) if mirror not in shown]
    places = frame.unassigned_px
    waiting = np.any([shapely.contains_xy(region, *places.T) for region in empty], axis=0)
    return places[~waiting] if empty else places


def _middles_px(frame: DetectedFrame) -> FloatArray:
    """Middles (k, 2) of all boards in a frame."""
    seen = frame.corners
    of_views = [seen.pixels[seen.view == view].mean(axis=0) for view in np.unique(seen.view)]
    return np.array([*of_views, *frame.unassigned_px]).reshape(-1, 2)
