"""The table of idealisations: displacements against projections by devices that were changed, and its marks."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks import idealised_corners as geometry
from benchmarks.idealisations import Row, cells
from benchmarks.idealised_corners import Effect, Setup
from benchmarks.idealised_pictures import psnr_db, without_tone
from mirrorcam.optics.calibration.solver.observations import DIRECT
from mirrorcam.render_scenes.sets.sensor_model import srgb
from mirrorcam.render_scenes.truth.light_rays import image_px


@pytest.fixture(scope="module")
def setup() -> Setup:
    return Setup(frames=2, base_frames=1)


def test_a_warmer_holder_has_its_mirrors_farther_away(setup: Setup) -> None:
    grown = [
        mirror.replaced(
            virtual_centre_in_rig_mm=1.01 * mirror.virtual_centre_in_rig_mm,
            outline_in_rig_mm=1.01 * mirror.outline_in_rig_mm,
        )
        for mirror in setup.built.mirrors
    ]
    camera = setup.built.camera
    expected = setup.corners_by(lambda _, view, at: image_px(camera, None if view == DIRECT else grown[view], at))
    np.testing.assert_allclose(geometry.warmer(setup, 0.01).pixels, expected.pixels, atol=1e-6)


def test_a_turned_camera_moves_corners_by_the_angle(setup: Setup) -> None:
    moved = geometry.turned_camera(setup, 0.01).pixels - setup.true.pixels
    near_axis = np.abs(setup.true.pixels - [959.5, 539.5]).max(axis=1) < 200.0
    assert np.abs(moved[near_axis, 1]) == pytest.approx(1360.38 * np.radians(0.01), rel=0.05)


def test_a_lens_off_its_model_moves_corners_by_its_rms(setup: Setup) -> None:
    assert setup.moved_px(geometry.other_lens(setup, 0.05)) == pytest.approx(0.05, rel=0.15)


def test_effects_of_no_size_move_nothing(setup: Setup) -> None:
    for seen in (
        geometry.walking_pupil(setup, 0.0),
        geometry.breathing(setup, 0.0),
        geometry.moving_board(setup, 0.0),
        geometry.bowed_board(setup, 0.0),
        geometry.printed_board(setup, 0.0, 0.0),
    ):
        assert setup.moved_px(seen) == pytest.approx(0.0, abs=1e-9)


def test_what_exceeds_a_tenth_of_the_claims_is_bold() -> None:
    row = Row("effect", "size", "no")
    bold = ("effect", "size", "0.3000", "**0.0002**", "**0.0021**", "**60**", "no")
    assert cells(row, Effect(0.3, 0.0002, 0.0021), 60.0) == bold
    plain = ("effect", "size", "0.3000", "0.0001", "0.0019", "62", "no")
    assert cells(row, Effect(0.3, 0.0001, 0.0019), 62.0) == plain


def test_an_error_of_a_hundredth_of_white_is_forty_decibels() -> None:
    assert psnr_db(1e-4) == pytest.approx(40.0)


def test_the_tone_curve_is_taken_back() -> None:
    levels = np.linspace(0.0, 1.0, 101)
    np.testing.assert_allclose(without_tone(srgb(levels)), levels, atol=1e-6)
