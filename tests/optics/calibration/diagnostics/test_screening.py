"""Degenerate and wrong input gives a clear refusal or true error bounds. The truth is known, the corners exact."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np
import pytest

from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.corner_calibration import calibrate_corners
from mirrorcam.optics.calibration.diagnostics import consistency
from mirrorcam.optics.calibration.diagnostics.requested_model import RequestedModel
from mirrorcam.optics.calibration.diagnostics.screening import screen
from mirrorcam.optics.calibration.diagnostics.verdict import check_solution
from mirrorcam.optics.calibration.diagnostics.view_statistics import view_figures
from mirrorcam.optics.calibration.solver import initial_estimates
from mirrorcam.optics.calibration.solver.levenberg_marquardt import Solution, fit
from mirrorcam.optics.calibration.solver.observations import DIRECT, Observations
from mirrorcam.optics.calibration.solver.parameterisation import Model
from mirrorcam.optics.calibration.solver.residuals import Board
from mirrorcam.optics.geometry.boards import Charuco
from mirrorcam.optics.geometry.layout import Layout
from tests.nightly import a_few
from tests.optics.calibration.synthetic_corners import Views, as_built, direct_poses, mirrored_poses, views_of

BOARD = Charuco(cols=12, rows=8, square_mm=20.0, marker_mm=14.0)
CORNERS = BOARD.corners_in_board_mm
MIRRORED = mirrored_poses(BOARD, 6, tilt_deg=30.0, seed=1)
BASE = direct_poses(BOARD, 5, tilt_deg=35.0, seed=2)
PARALLEL = mirrored_poses(BOARD, 6, tilt_deg=0.0, seed=1)
BASE_PARALLEL = direct_poses(BOARD, 5, tilt_deg=0.0, seed=2)


@pytest.fixture(scope="module")
def truth(fold_90_layout: Layout) -> Layout:
    return as_built(fold_90_layout, seed=1)


@pytest.fixture(scope="module")
def good(truth: Layout) -> Views:
    return views_of(truth, BOARD, MIRRORED, BASE, seed=1)


def solved(
    seen: Sequence[Observations], base: Sequence[Observations], layout: Layout, corners: FloatArray = CORNERS
) -> tuple[Solution, tuple[str, ...]]:
    """Return the calibration from corners, and its notes."""
    screened = screen(seen, base, layout, corners)
    frames = [o for o in [*screened.mirrored, *screened.base] if len(o)]
    observations = Observations.join([o.with_frame_offset(place) for place, o in enumerate(frames)])
    camera = initial_estimates.base_camera(observations.where(observations.view == DIRECT), layout.camera, corners)
    start = initial_estimates.first_estimate(observations, camera, layout, corners)
    model = Model(camera.intrinsic_names, thickness=False, curvature=False, board=Board.rigid(corners))
    solution = fit(start, observations, model)
    solution = replace(solution, covariance=screened.inflation**2 * solution.covariance)
    used = sum(bool(len(o)) for o in screened.mirrored)
    return solution, (
        *screened.dropped,
        *screened.drift,
        *consistency.check_plausible(solution, layout, mirrored_frames=used),
    )


def nees(solution: Solution, truth: Layout) -> tuple[float, int]:
    """Return the squared error of camera and mirrors in the metric of their covariance, and its degrees of freedom."""
    camera = solution.estimate.camera
    errors = {
        **dict(zip(camera.intrinsic_names, camera.intrinsics - truth.camera.intrinsics, strict=True)),
        **{
            f"mirror {m} {axis}_mm": float(error)
            for m, row in enumerate(solution.estimate.virtual_centres_in_rig_mm - truth.virtual_centres_in_rig_mm)
            for axis, error in zip("xyz", row, strict=True)
        },
    }
    error = np.array([errors[name] for name in solution.parameters])
    scale = np.sqrt(np.diag(solution.covariance))
    correlation = solution.covariance / np.outer(scale, scale)
    return float(error / scale @ np.linalg.solve(correlation, error / scale)), len(error)


def exchanged(
    seen: Sequence[Observations], other: Sequence[Observations], frames: Iterable[int], mirrors: Iterable[int]
) -> list[Observations]:
    """Return frames in which some mirrors show another board at a different pose."""
    mixed = list(seen)
    for frame in frames:
        a, b = seen[frame], other[frame]
        mixed[frame] = Observations.join(
            [a.where(~np.isin(a.view, list(mirrors))), b.where(np.isin(b.view, list(mirrors)))]
        )
    return mixed


def with_focal(truth: Layout, factor: float) -> Layout:
    camera = truth.camera
    return truth.replaced(camera=camera.replaced(fx_px=factor * camera.fx_px, fy_px=factor * camera.fy_px))


def test_good_input_passes_untouched(good: Views, fold_90_layout: Layout) -> None:
    screened = screen(good.mirrored, good.base, fold_90_layout, CORNERS)
    assert (screened.dropped, screened.drift) == ((), ())
    assert screened.inflation == 1.0
    assert [len(o) for o in screened.mirrored] == [len(o) for o in good.mirrored]
    assert [len(o) for o in screened.base] == [len(o) for o in good.base]
    _, notes = solved(good.mirrored, good.base, fold_90_layout)
    assert notes == ()


@pytest.mark.parametrize(
    ("mirrored", "base", "note"),
    a_few(
        2,
        [
            pytest.param(MIRRORED[:1], BASE, "one picture through the mirrors", id="one pose"),
            pytest.param(MIRRORED[:1], [], "one picture through the mirrors", id="one pose, no base frames"),
            pytest.param(PARALLEL, BASE, "all boards are parallel", id="parallel before the mirrors"),
            pytest.param(PARALLEL, BASE_PARALLEL, "all boards are parallel", id="all parallel"),
            pytest.param(PARALLEL, [], "all boards are parallel", id="parallel, no base frames"),
            pytest.param(MIRRORED, BASE_PARALLEL, "", id="base frames parallel"),
            pytest.param(MIRRORED, [], "", id="no base frames"),
        ],
    ),
)
def test_few_or_parallel_poses_give_looser_bounds_that_are_true(
    mirrored: list[FloatArray], base: list[FloatArray], note: str, fold_90_layout: Layout
) -> None:
    """The squared error over many devices and noises matches the covariance within four of its own sigmas."""
    total, numbers = 0.0, 0
    for seed in range(4):
        truth = as_built(fold_90_layout, seed=seed)
        views = views_of(truth, BOARD, mirrored, base, seed=seed)
        solution, notes = solved(views.mirrored, views.base, fold_90_layout)
        assert any(n.startswith(note) for n in notes) if note else notes == ()
        squared, count = nees(solution, truth)
        total, numbers = total + squared, numbers + count
    assert total / numbers == pytest.approx(1.0, abs=4.0 * np.sqrt(2.0 / numbers))


def test_one_picture_given_several_times_counts_once(good: Views, fold_90_layout: Layout) -> None:
    once, _ = solved(good.mirrored[:1], good.base, fold_90_layout)
    often, notes = solved(good.mirrored[:1] * 4, good.base, fold_90_layout)
    assert notes[:3] == tuple(f"frame {n}: the same picture as frame 0, not used" for n in (1, 2, 3))
    np.testing.assert_allclose(often.covariance, once.covariance, rtol=1e-9)


def test_a_wrong_square_size_is_an_alarm_that_names_the_right_one(good: Views, fold_90_layout: Layout) -> None:
    found = calibrate_corners(good.mirrored, good.base, fold_90_layout, 1.05 * CORNERS, model=RequestedModel())
    square_mm = float(CORNERS[0, 0])
    assert found.diagnostics is not None
    (alarm,) = found.diagnostics.mismatches
    assert found.diagnostics.alarms[0] == alarm
    assert float(alarm.removeprefix("the board's squares look like ").split()[0]) == pytest.approx(square_mm, rel=0.03)
    assert f"board says square_mm = {1.05 * square_mm:g}" in alarm
    assert check_solution(found, view_figures(found)).advice[0].startswith("Correct the board or layout")


def test_swapped_rows_and_columns_are_refused(good: Views, fold_90_layout: Layout) -> None:
    swapped = Charuco(cols=BOARD.rows, rows=BOARD.cols, square_mm=BOARD.square_mm, marker_mm=BOARD.marker_mm)
    with pytest.raises(InputError, match="are rows, columns and markers"):
        screen(good.mirrored, good.base, fold_90_layout, swapped.corners_in_board_mm)


def test_base_frames_of_another_camera_are_refused(good: Views, truth: Layout, fold_90_layout: Layout) -> None:
    for factor in (1.01, 1.3):
        other = views_of(with_focal(truth, factor), BOARD, [], BASE, seed=5)
        with pytest.raises(
            InputError, match=r"show a focal length of 1[34]\d\d\.\d px, frames without 1[37]\d\d\.\d px"
        ):
            screen(good.mirrored, other.base, fold_90_layout, CORNERS)


@pytest.mark.slow
def test_a_small_change_of_focus_widens_the_bounds_until_they_are_true(
    good: Views, truth: Layout, fold_90_layout: Layout
) -> None:
    drifted = views_of(with_focal(truth, 1.002), BOARD, [], BASE, seed=5)
    screened = screen(good.mirrored, drifted.base, fold_90_layout, CORNERS)
    assert screened.inflation > 3.0
    solution, notes = solved(good.mirrored, drifted.base, fold_90_layout)
    assert any("disagree about the camera" in note for note in notes)
    squared, count = nees(solution, truth)
    narrow, _ = nees(replace(solution, covariance=solution.covariance / screened.inflation**2), truth)
    assert narrow > 1.5 * count
    assert squared < 1.4 * count


def test_mirrors_unlike_the_layout_are_not_taken_for_another_camera(fold_90_layout: Layout) -> None:
    """A plate or a bend that the layout leaves out biases the intrinsics; model selection deals with it."""
    truth = as_built(fold_90_layout, seed=1)
    bent = tuple(mirror.replaced(curvature_per_m=[0.1, 0.05, 0.0]) for mirror in truth.mirrors)
    second_surface = tuple(mirror.replaced(surface="second", thickness_mm=2.0) for mirror in truth.mirrors)
    for mirrors in (bent, second_surface):
        views = views_of(truth.replaced(mirrors=mirrors), BOARD, MIRRORED, BASE, seed=1)
        screened = screen(views.mirrored, views.base, fold_90_layout, CORNERS)
        assert (screened.dropped, screened.drift) == ((), ())
        assert screened.inflation == 1.0


def test_all_pictures_of_another_camera_calibrate_that_camera_and_say_so(truth: Layout, fold_90_layout: Layout) -> None:
    zoomed = with_focal(truth, 1.15)
    for base in (BASE, []):
        views = views_of(zoomed, BOARD, MIRRORED, base, seed=3)
        solution, notes = solved(views.mirrored, views.base, fold_90_layout)
        assert any("+15% from the layout's" in note for note in notes)
        squared, count = nees(solution, zoomed)
        assert squared / count == pytest.approx(1.0, abs=4.0 * np.sqrt(2.0 / count))


def second_board(truth: Layout) -> list[Observations]:
    return views_of(truth, BOARD, mirrored_poses(BOARD, 6, tilt_deg=30.0, seed=77), [], seed=9).mirrored


def test_a_view_of_another_board_is_left_out(good: Views, truth: Layout, fold_90_layout: Layout) -> None:
    mixed = exchanged(good.mirrored, second_board(truth), [3], [2])
    solution, notes = solved(mixed, good.base, fold_90_layout)
    assert len(notes) == 1
    assert notes[0].startswith("frame 3, mirror 0-2: shows the board elsewhere")
    squared, count = nees(solution, truth)
    assert squared < 2.0 * count


def test_a_frame_of_two_boards_is_left_out(good: Views, truth: Layout, fold_90_layout: Layout) -> None:
    mixed = exchanged(good.mirrored, second_board(truth), [3], [4, 5, 6, 7, 8])
    solution, notes = solved(mixed, good.base, fold_90_layout)
    assert any(note.startswith("frame 3") for note in notes)
    squared, count = nees(solution, truth)
    assert squared < 2.0 * count


def test_two_boards_throughout_are_refused(good: Views, truth: Layout, fold_90_layout: Layout) -> None:
    other = second_board(truth)
    with pytest.raises(InputError, match="views disagree with others of their frames"):
        screen(exchanged(good.mirrored, other, range(6), [5, 6, 7, 8]), good.base, fold_90_layout, CORNERS)
    with pytest.raises(InputError, match=r"mirror 1-1 disagrees with .* in 6 of 6 frames"):
        screen(exchanged(good.mirrored, other, range(6), [4]), good.base, fold_90_layout, CORNERS)


def test_corners_of_two_boards_within_views_are_refused_or_left_out(
    good: Views, truth: Layout, fold_90_layout: Layout
) -> None:
    random = np.random.default_rng(0)

    def mingled(a: Observations, b: Observations, share: float) -> Observations:
        pixels = a.pixels.copy()
        for row in np.flatnonzero(random.random(len(a)) < share):
            same = np.flatnonzero((b.view == a.view[row]) & (b.corner == a.corner[row]))
            pixels[row] = b.pixels[same[0]] if len(same) else pixels[row]
        return Observations(a.frame, a.view, a.corner, pixels)

    other = second_board(truth)
    with pytest.raises(InputError, match="where a flat board of this drawing has none"):
        screen(
            [mingled(a, b, 0.4) for a, b in zip(good.mirrored, other, strict=True)], good.base, fold_90_layout, CORNERS
        )
    seen = [mingled(good.mirrored[0], other[0], 0.2), *good.mirrored[1:]]
    solution, notes = solved(seen, good.base, fold_90_layout)
    assert all("frame 0, mirror" in note for note in notes)
    assert notes
    squared, count = nees(solution, truth)
    assert squared < 2.0 * count


def test_a_mirror_that_hardly_sees_the_board_is_named(good: Views, fold_90_layout: Layout) -> None:
    unseen = [o.where(o.view != 8) for o in good.mirrored]
    with pytest.raises(InputError, match="mirror 2-2 shows 0 corners in 6 frames, expected 20"):
        screen(unseen, good.base, fold_90_layout, CORNERS)
    blank = [Observations.empty()] * 3
    with pytest.raises(InputError, match="no corner of the board found in any of 3 frames"):
        screen(blank, good.base, fold_90_layout, CORNERS)
