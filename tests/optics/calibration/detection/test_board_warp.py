"""The map from a board to a picture: exact for homographies, robust, and with true derivatives."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.detection.board_warp import (
    CUBIC,
    SEPTIC,
    BoardWarp,
    corner_print_xy,
    typical_cell_px,
)
from mirrorcam.optics.geometry.boards import Charuco

PLACES = corner_print_xy(Charuco(cols=10, rows=7, square_mm=24.0, marker_mm=16.0))
HOMOGRAPHY = np.array([[30.0, 3.0, 200.0], [-2.0, 28.0, 150.0], [0.002, -0.004, 1.0]])


def projected(places: FloatArray) -> FloatArray:
    lifted = np.column_stack([places, np.ones(len(places))]) @ HOMOGRAPHY.T
    return lifted[:, :2] / lifted[:, 2:]


def curved(places: FloatArray) -> FloatArray:
    """A homography behind a lens with barrel distortion."""
    pixels = projected(places)
    off = pixels - [320.0, 240.0]
    return pixels - 4e-7 * np.sum(off**2, axis=1, keepdims=True) * off


def strongly_curved(places: FloatArray) -> FloatArray:
    """A homography behind a lens whose distortion has a term of the fifth degree."""
    pixels = projected(places)
    off = (pixels - [480.0, 360.0]) / 500.0
    radius2 = np.sum(off**2, axis=1, keepdims=True)
    return pixels + 500.0 * off * radius2 * (0.05 - 0.08 * radius2)


def test_places_count_squares_from_the_top_left_of_the_print() -> None:
    assert PLACES[0].tolist() == [1.0, 1.0]
    assert PLACES[-1].tolist() == [9.0, 6.0]
    assert len(PLACES) == 9 * 6


@pytest.mark.parametrize("count", [4, 12, 54])
def test_a_homography_is_reproduced(count: int) -> None:
    some = np.random.default_rng(count).choice(54, count, replace=False) if count > 4 else np.array([0, 8, 45, 53])
    warp = BoardWarp.fit(PLACES[some], projected(PLACES[some]))
    assert warp is not None
    np.testing.assert_allclose(warp.map(PLACES), projected(PLACES), atol=0.01)


def test_fewer_than_four_points_have_no_warp() -> None:
    assert BoardWarp.fit(PLACES[:3], projected(PLACES[:3])) is None


def test_the_cubic_fits_a_lens_and_ignores_outliers() -> None:
    pixels = curved(PLACES)
    pixels[[5, 30]] += [9.0, -7.0]
    warp = BoardWarp.fit(PLACES, pixels)
    assert warp is not None
    rest = np.linalg.norm(warp.map(PLACES) - curved(PLACES), axis=1)
    assert rest.max() < 0.1
    plain = replace(warp, polynomial=np.zeros((10, 2)))
    assert np.linalg.norm(plain.map(PLACES) - curved(PLACES), axis=1).max() > 3.0 * rest.max()


def test_derivatives_are_finite_differences() -> None:
    warp = BoardWarp.fit(PLACES, curved(PLACES))
    assert warp is not None
    cells, bends = warp.derivatives(PLACES)
    h = 1e-4
    for k, step in enumerate(np.eye(2) * h):
        expected = (warp.map(PLACES + step) - warp.map(PLACES - step)) / (2.0 * h)
        np.testing.assert_allclose(cells[:, :, k], expected, atol=0.01)
    right = np.array([0.05, 0.0])
    second = (warp.map(PLACES + right) + warp.map(PLACES - right) - 2.0 * warp.map(PLACES)) / 0.05**2
    np.testing.assert_allclose(2.0 * bends[:, :, 0], second, atol=0.01)
    np.testing.assert_array_equal(warp.expected(PLACES, curved(PLACES)).cells, cells)


@pytest.mark.parametrize("cols, rows, limit", [(20, 14, 0.001), (10, 7, 0.005)])
def test_a_septic_has_the_second_derivatives_of_a_strong_lens(cols: int, rows: int, limit: float) -> None:
    """On boards of the same size with noise, against the derivatives of the true map; a cubic's differ."""
    square = 10.0 / cols
    large = corner_print_xy(Charuco(cols=cols, rows=rows, square_mm=12.0, marker_mm=8.4))
    noise = np.random.default_rng(0).normal(0.0, 0.005, (len(large), 2))

    def pixels(places: FloatArray) -> FloatArray:
        return strongly_curved(square * places)

    errors = {}
    for degree in (CUBIC, SEPTIC):
        warp = BoardWarp.fit(large, pixels(large) + noise, degree=degree)
        assert warp is not None
        off = warp.derivatives(large)[1][:, :, [0, 2]]
        for column, step in enumerate(0.01 * np.eye(2)):
            true = pixels(large + step) + pixels(large - step) - 2.0 * pixels(large)
            off[:, :, column] -= true / (2.0 * 0.01**2)
        errors[degree] = np.sqrt(np.mean(off**2))
    assert errors[SEPTIC] < limit
    assert errors[CUBIC] > 4.0 * errors[SEPTIC]


@pytest.mark.parametrize("count", [24, 40])
def test_few_points_determine_a_lens(count: int) -> None:
    """Points with noise in one part of a board."""
    some = np.argsort(np.linalg.norm(PLACES - [3.0, 3.0], axis=1))[:count]
    noise = np.random.default_rng(count).normal(0.0, 0.005, (count, 2))
    warp = BoardWarp.fit(PLACES[some], strongly_curved(PLACES[some]) + noise, degree=SEPTIC)
    assert warp is not None
    assert np.abs(warp.map(PLACES[some]) - strongly_curved(PLACES[some])).max() < 0.025


def test_points_behind_the_camera_have_no_pixel() -> None:
    warp = BoardWarp(HOMOGRAPHY, np.zeros(2), 1.0, np.zeros((10, 2)))
    assert np.isnan(warp.map(np.array([[0.0, 300.0]]))).all()


def test_the_typical_cell_is_the_scale_of_a_similarity() -> None:
    turn = np.array([[0.6, -0.8], [0.8, 0.6]])
    assert typical_cell_px(PLACES, 17.0 * PLACES @ turn.T + 5.0) == pytest.approx(17.0)
