"""Corners that the pupil sees partly, and what is said of the pupil."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.optics.calibration import whole_pupil
from mirrorcam.optics.calibration.detection.pupil_blur import NEARNESS_SIGMA, SeenPupil
from mirrorcam.optics.calibration.solver.observations import DIRECT, Observations
from mirrorcam.optics.calibration.whole_pupil import MARGIN_PX, Pictures, estimated_pupil, wholly_served
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.pupil import PINHOLE, Pupil
from mirrorcam.optics.geometry.targets import default_board
from tests.optics.calibration.detection.test_pupil_blur import traced

PUPIL = Pupil(1.8, 500.0)


def with_pupil(layout: Layout, pupil: Pupil) -> Layout:
    return layout.replaced(camera=layout.camera.with_pupil(pupil))


def grid_of(layout: Layout, index: int) -> Observations:
    """Corners every 7 px in a sub-image, as frame 0."""
    low, high = layout.outline_px(index).min(axis=0), layout.outline_px(index).max(axis=0)
    x, y = np.meshgrid(np.arange(low[0], high[0], 7.0), np.arange(low[1], high[1], 7.0))
    pixels = np.column_stack([x.ravel(), y.ravel()])
    shown = traced(layout.mirrors[index], layout.camera.normalized_from_pixels(pixels), Pupil(0.0, 500.0)) > 0.0
    return Observations.of_view(0, index, np.arange(int(shown.sum())), pixels[shown])


def test_the_whole_pupil_sees_every_corner_that_is_left_and_some_around_it(default_layout: Layout) -> None:
    layout = with_pupil(default_layout, PUPIL)
    corners = grid_of(layout, 4)
    kept, notes = wholly_served(layout, corners)
    left_out = int((~kept).sum())
    assert notes == (
        f"{left_out} of {len(corners)} corners left out: near mirrors' edges, which the pupil sees partly",
    )
    mirror, camera = layout.mirrors[4], layout.camera
    around = 0.9 * MARGIN_PX * np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
    served = [traced(mirror, camera.normalized_from_pixels(corners.pixels + step), PUPIL) for step in around]
    assert np.min(served, axis=0)[kept].min() == 1.0
    farther = [traced(mirror, camera.normalized_from_pixels(corners.pixels + 2.0 * step), PUPIL) for step in around]
    assert np.min(farther, axis=0)[~kept].max() < 1.0
    assert 0.5 < kept.mean() < 0.95


def test_nothing_is_left_out_of_a_pinhole_or_the_bare_camera(default_layout: Layout) -> None:
    corners = grid_of(default_layout, 0)
    kept, notes = wholly_served(with_pupil(default_layout, PINHOLE), corners)
    assert kept.all()
    assert notes == ()
    direct = Observations.of_view(0, DIRECT, corners.corner, corners.pixels)
    assert wholly_served(with_pupil(default_layout, PUPIL), direct)[0].all()


def test_a_mirror_that_hardly_serves_a_whole_pupil_keeps_its_corners(default_layout: Layout) -> None:
    layout = with_pupil(default_layout, Pupil(40.0, 500.0))
    kept, notes = wholly_served(layout, grid_of(layout, 4))
    assert kept.all()
    assert notes == ("mirror 1-1: hardly any corner is seen by the whole pupil, all are used",)


def test_a_frame_keeps_its_corners_where_few_would_be_left(default_layout: Layout) -> None:
    layout = with_pupil(default_layout, PUPIL)
    corners = grid_of(layout, 4)
    kept, _ = wholly_served(layout, corners)
    edge = np.flatnonzero(~kept)[:8]
    alone = Observations.of_view(1, 4, corners.corner[edge], corners.pixels[edge])
    both, _ = wholly_served(layout, Observations.join([corners, alone]))
    assert (both[: len(kept)] == kept).all()
    assert both[len(kept) :].all()


@pytest.mark.parametrize(
    ("seen", "expected", "words"),
    [
        (None, (1.8, 500.0), "do not show the blur of enough mirrors' edges to tell the pupil: 1.8 mm wide"),
        (SeenPupil(0.01, 0.02, 0.002, 0.002, 20), (0.0, 500.0), "0.10 ± 0.07 mm wide, by the blur of 20 mirror edges"),
        (SeenPupil(4.0, 0.2, 0.001, 0.002, 20), (2.0, 500.0), "do not tell the distance in focus"),
        (SeenPupil(4.0, 0.2, 0.001, 0.0003, 20), (2.0, 1000.0), "in focus at 1000 mm (1.00 ± 0.30 per metre)"),
    ],
)
def test_what_frames_do_not_show_of_the_pupil_is_kept(
    default_layout: Layout,
    monkeypatch: pytest.MonkeyPatch,
    seen: SeenPupil | None,
    expected: tuple[float, float],
    words: str,
) -> None:
    monkeypatch.setattr(whole_pupil, "_seen", lambda layout, frames, target: seen)
    found = estimated_pupil(with_pupil(default_layout, PUPIL), [], default_board())
    assert (found.camera.aperture_mm, found.camera.focus_mm) == pytest.approx(expected)
    assert words in found.note
    assert ("aperture_sigma_mm" in found.metrics) == (seen is not None)
    assert ("focus_mm" in found.metrics) == (seen is not None and seen.nearness_sigma < NEARNESS_SIGMA / 4.0)


def test_pictures_that_are_not_at_hand_are_skipped() -> None:
    grey = np.zeros((4, 4), np.uint8)
    pictures = Pictures([None, grey, grey], default_board())
    poses = np.stack([np.eye(4), 2.0 * np.eye(4)])
    placed = pictures.placed([0, 2], poses)
    assert [frame.rig_from_board[0, 0] for frame in placed] == [2.0]
