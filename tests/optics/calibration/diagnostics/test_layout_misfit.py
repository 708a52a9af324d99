"""Upside-down pictures are distinguished from others that do not fit."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.corner_calibration import calibrate_corners
from mirrorcam.optics.calibration.detection.assignment import assign, unassigned_px
from mirrorcam.optics.calibration.detection.detections import DetectedFrame
from mirrorcam.optics.calibration.diagnostics.layout_misfit import fits_upside_down, observed_grid, unknown_mirrors
from mirrorcam.optics.calibration.diagnostics.requested_model import RequestedModel
from mirrorcam.optics.calibration.diagnostics.screening import screen
from mirrorcam.optics.calibration.diagnostics.verdict import check_solution
from mirrorcam.optics.calibration.diagnostics.view_statistics import view_figures
from mirrorcam.optics.calibration.solver.observations import Corners, Observations
from mirrorcam.optics.geometry.boards import Charuco, Checkerboard
from mirrorcam.optics.geometry.layout import Layout
from tests.optics.calibration.synthetic_corners import Views, as_built, direct_poses, mirrored_poses, views_of

MARKED = Charuco(cols=10, rows=7, square_mm=16.0, marker_mm=11.0)
PLAIN = Checkerboard(cols=9, rows=7, square_mm=6.0)
BOARD = Charuco(cols=10, rows=7, square_mm=20.0, marker_mm=14.0)


def shown(board: Checkerboard | Charuco, truth: Layout, nominal: Layout, *, upside_down: bool) -> list[Observations]:
    """Return the detections of frames, rotated by 180 degrees or not."""
    last = np.array([nominal.camera.width_px, nominal.camera.height_px]) - 1.0
    frames = []
    for seen in views_of(truth, board, mirrored_poses(board, 6, tilt_deg=25.0, seed=1), [], seed=1).mirrored:
        pixels = last - seen.pixels if upside_down else seen.pixels
        boards = [(Corners(seen.corner[seen.view == v], pixels[seen.view == v]),) for v in np.unique(seen.view)]
        rows = [Observations.of_view(0, mirror, c.ids, c.pixels) for mirror, c in assign(boards, nominal, board)]
        frames.append(Observations.join(rows))
    return frames


@pytest.mark.parametrize("board", [MARKED, PLAIN])
def test_upside_down_pictures_fit_after_rotation(board: Checkerboard | Charuco, fold_90_layout: Layout) -> None:
    truth = as_built(fold_90_layout, seed=1)
    seen = shown(board, truth, fold_90_layout, upside_down=True)
    with pytest.raises(InputError):
        screen(seen, [], fold_90_layout, board.corners_in_board_mm)
    assert fits_upside_down(seen, fold_90_layout, board)


def test_other_pictures_do_not(fold_90_layout: Layout) -> None:
    seen = shown(MARKED, as_built(fold_90_layout, seed=1), fold_90_layout, upside_down=False)
    assert not fits_upside_down(seen, fold_90_layout, MARKED)
    assert not fits_upside_down([Observations.empty()], fold_90_layout, MARKED)


@pytest.fixture(scope="module")
def views(fold_90_layout: Layout) -> Views:
    """Return the views of a device of 3 x 3 mirrors."""
    mirrored, direct = (poses(BOARD, 8, tilt_deg=25.0, seed=2) for poses in (mirrored_poses, direct_poses))
    return views_of(as_built(fold_90_layout, seed=1), BOARD, mirrored, direct, seed=1)


def part_of(layout: Layout, columns: set[int]) -> Layout:
    mirrors = tuple(mirror for number, mirror in enumerate(layout.mirrors) if number % layout.cols in columns)
    return layout.replaced(cols=len(columns), mirrors=mirrors)


def detected(seen: Observations, layout: Layout) -> DetectedFrame:
    boards = [(Corners(seen.corner[seen.view == v], seen.pixels[seen.view == v]),) for v in np.unique(seen.view)]
    assigned = assign(boards, layout, BOARD)
    rows = [Observations.of_view(0, mirror, corners.ids, corners.pixels) for mirror, corners in assigned]
    return DetectedFrame(Observations.join(rows), unassigned_px(boards, assigned, layout))


def test_the_layout_of_the_device_raises_no_alarm(views: Views, fold_90_layout: Layout) -> None:
    found = unknown_mirrors(fold_90_layout, [detected(seen, fold_90_layout) for seen in views.mirrored])
    assert (found.frames, found.alarms, found.notes, found.question, found.metrics) == (0, (), (), "", {})
    assert str(found.error_for("not sharp")) == "not sharp"


@pytest.mark.parametrize("columns", [{0, 1}, {0, 2}])
def test_a_layout_with_fewer_mirrors_is_an_alarm_in_verdict_and_metrics(
    columns: set[int], views: Views, fold_90_layout: Layout
) -> None:
    layout = part_of(fold_90_layout, columns)
    frames = [detected(seen, layout) for seen in views.mirrored]
    unknown = unknown_mirrors(layout, frames)
    corners = [frame.corners for frame in frames]
    joint = RequestedModel()
    found = calibrate_corners(corners, views.base, layout, BOARD.corners_in_board_mm, model=joint, unknown=unknown)
    assert found.diagnostics is not None
    (alarm,) = found.diagnostics.mismatches
    assert alarm.startswith("boards in 8 of 8 frames belong to no mirror of the layout, as in frame 0 at pixel (")
    assert "the frames seem to show 3 x 3, the layout has 3 x 2 mirrors" in alarm
    assert ("right of all its mirrors" in alarm) == (2 not in columns)
    assert len(alarm) <= 300
    assert found.metrics["frames_with_unknown_mirrors"].value == 8
    verdict = check_solution(found, view_figures(found))
    assert (verdict.state, verdict.reasons[0]) == ("stop", alarm)
    assert verdict.advice[0].startswith("Correct the board or layout")


def test_consequential_warnings_are_left_out(views: Views, fold_90_layout: Layout) -> None:
    layout = part_of(fold_90_layout, {0, 1})
    frames = [detected(seen, layout) for seen in views.mirrored]
    unknown = unknown_mirrors(layout, frames)
    none_in_first = [frame.corners.where(frame.corners.view > 0) for frame in frames]
    with pytest.raises(InputError, match="belong to no mirror of the layout"):
        calibrate_corners(none_in_first, views.base, layout, BOARD.corners_in_board_mm, unknown=unknown)


def test_a_layout_with_too_many_mirrors_is_questioned(views: Views, fold_90_layout: Layout) -> None:
    frames = [DetectedFrame(seen.where(seen.view % 3 < 2)) for seen in views.mirrored]
    unknown = unknown_mirrors(fold_90_layout, frames)
    assert unknown.alarms == ()
    corners = [frame.corners for frame in frames]
    with pytest.raises(InputError, match=r"mirror 0-2 shows 0 corners .* show 3 x 2 mirrors\? the layout has 3 x 3"):
        calibrate_corners(corners, views.base, fold_90_layout, BOARD.corners_in_board_mm, unknown=unknown)


def test_one_board_too_many_is_noted(views: Views, fold_90_layout: Layout) -> None:
    frames = [DetectedFrame(seen) for seen in views.mirrored]
    frames[3] = DetectedFrame(views.mirrored[3], np.array([[5.0, 6.0]]))
    found = unknown_mirrors(fold_90_layout, frames)
    assert found.notes == ("frame 3 at pixel (5, 6): a board that belongs to no mirror of the layout",)
    assert (found.frames, found.alarms) == (1, ())
    # A board at an unexpected place of its mirror does not belong to an unknown mirror.
    middle = fold_90_layout.outline_px(4).mean(axis=0)
    without = [seen.where(seen.view != 4) for seen in views.mirrored]
    misplaced = [DetectedFrame(seen, middle[None]) for seen in without]
    assert unknown_mirrors(fold_90_layout, misplaced).frames == 0


def grid_of(rows: int, cols: int, scatter: float) -> FloatArray:
    places = np.array([[100.0 * col, 80.0 * row] for row in range(rows) for col in range(cols)])
    return places + scatter * np.random.default_rng(rows + 7 * cols).standard_normal(places.shape)


@pytest.mark.parametrize(("rows", "cols"), [(2, 2), (2, 3), (3, 2), (1, 4), (5, 1), (3, 3), (3, 4), (7, 7)])
def test_the_grid_of_the_frames_is_recognised(rows: int, cols: int) -> None:
    fewer = grid_of(rows, cols, 5.0)[:-1]
    assert observed_grid([fewer, grid_of(rows, cols, 5.0), grid_of(rows, cols, 0.0)]) == (rows, cols)


def test_no_grid_is_made_up() -> None:
    random = np.random.default_rng(0)
    assert observed_grid([]) is None
    assert observed_grid([np.empty((0, 2)), np.ones((1, 2))]) is None
    assert observed_grid([100.0 * random.random((6, 2)) for _ in range(4)]) is None
    assert observed_grid([grid_of(2, 3, 0.0), grid_of(3, 2, 0.0)]) is None
