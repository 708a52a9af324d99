"""Previews of a layout: the same for the same arguments, for layouts of all kinds, and of both subjects."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.core.values import InputError
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.targets import default_board
from mirrorcam.optics.geometry.transforms import transform
from mirrorcam.render_scenes.preview.arranged import view_from_board
from mirrorcam.render_scenes.preview.preview_frame import binned_sensor, preview_frame
from mirrorcam.render_scenes.settings import SENSORS, SensorModel


def test_a_preview_is_a_picture_of_the_width_asked_for_the_same_each_time(fold_90_layout: Layout) -> None:
    first, again, other = (preview_frame(fold_90_layout, width_px=320, seed=seed) for seed in (0, 0, 1))
    assert first.picture.shape == (180, 320, 3)
    assert first.picture.dtype == np.uint8
    assert first.layout.camera == fold_90_layout.camera.binned(320 / 1920)
    np.testing.assert_array_equal(first.picture, again.picture)
    assert (first.picture != other.picture).mean() > 0.5
    assert first.picture.mean() > 20
    # No larger than the sensor.
    assert preview_frame(first.layout, width_px=4000).picture.shape == (180, 320, 3)


def test_the_print_of_a_board_is_where_the_layout_projects_it(fold_90_layout: Layout) -> None:
    board = default_board()
    frame = preview_frame(fold_90_layout, "board", width_px=960, sensor=SENSORS["ideal"])
    pose = view_from_board(frame.layout, board)
    # Middles of squares: the top left one is black, and the others take turns; markers lie within the white ones.
    columns, rows = np.meshgrid(np.arange(board.cols), np.arange(board.rows))
    black = (columns + rows) % 2 == 0
    middles = np.stack([(columns + 0.5) * board.square_mm, (rows + 0.5) * board.square_mm, 0.0 * rows], axis=-1)
    seen = 0
    for mirror in range(9):
        px = frame.layout.project(transform(pose, middles) @ frame.layout.view_from_rig, mirror)
        place = np.nan_to_num(np.rint(px), nan=-1).astype(int)
        height, width = frame.picture.shape[:2]
        on = (place >= 0).all(axis=-1) & (place[..., 0] < width) & (place[..., 1] < height) & black
        at = place[on]
        shown = frame.light.mirror[at[:, 1], at[:, 0]] == mirror
        grey = frame.light.radiance[at[shown, 1], at[shown, 0], 0]
        seen += len(grey)
        assert len(grey) == 0 or np.median(grey) < 0.06
    assert seen > 300


def test_objects_may_be_those_of_another_layout(fold_90_layout: Layout) -> None:
    few = fold_90_layout.replaced(
        rows=1, cols=3, mirrors=fold_90_layout.mirrors[3:6], spec=None, metrics={}, verdict={}
    )
    full = preview_frame(fold_90_layout, width_px=320).light
    own = preview_frame(few, width_px=320).light
    same = preview_frame(few, width_px=320, arranged_for=fold_90_layout).light
    # Pixels of the glossy ball in the middle row of mirrors.
    ball = ((full.thing == 4) & (full.mirror >= 3) & (full.mirror < 6)).sum()
    assert (same.thing == 4).sum() == pytest.approx(ball, rel=0.05)
    assert (own.thing == 4).sum() != pytest.approx(ball, rel=0.05)


def test_what_is_not_offered_is_refused(fold_90_layout: Layout) -> None:
    with pytest.raises(InputError, match=r"^subject is 'cat', expected tabletop or board$"):
        preview_frame(fold_90_layout, "cat")  # type: ignore[arg-type]
    with pytest.raises(InputError, match=r"^width of 8 px, expected 64 to 4096$"):
        preview_frame(fold_90_layout, width_px=8)


def test_a_binned_sensor_has_the_noise_of_the_mean_of_its_pixels() -> None:
    model = SensorModel(full_well_electrons=1000.0, read_noise_grey=2.0, prnu_percent=1.0, lens_blur_px=1.2)
    small = binned_sensor(model, 0.5)
    assert (small.full_well_electrons, small.read_noise_grey) == (4000.0, 1.0)
    assert (small.prnu_percent, small.lens_blur_px) == (0.5, 0.6)
    assert binned_sensor(SENSORS["webcam"], 1.0).bayer is False
