"""The regions without corners that a verdict names, and the noise that it uses."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.optics.calibration.diagnostics.calibration_result import Calibration
from mirrorcam.optics.calibration.diagnostics.verdict import advice_on_cells, advice_on_corners, empty_region
from mirrorcam.optics.calibration.diagnostics.view_statistics import CellMeans, ViewFigures, view_figures
from tests.optics.calibration.sound_calibration import (
    rows_of,
    sound_calibration,
)


@pytest.fixture
def calibration() -> Calibration:
    return sound_calibration()


@pytest.mark.parametrize(("corner", "words"), [((0, 0), "at the top left"), ((1, 1), "at the bottom right")])
def test_the_empty_region_has_no_corners(calibration: Calibration, corner: tuple[int, int], words: str) -> None:
    seen, outline_px = calibration.observations, calibration.layout.outline_px(0)
    low, high = outline_px.min(axis=0), outline_px.max(axis=0)
    place = (seen.pixels - low) / (high - low)
    near = (np.abs(place - corner) < 0.45).all(axis=1)
    views = view_figures(rows_of(calibration, (seen.view != 0) | ~near))
    assert empty_region(views[0]) == words
    assert views[0].coverage < 0.9 * view_figures(calibration)[0].coverage


@pytest.fixture(scope="module")
def spotty_calibration() -> Calibration:
    return sound_calibration()


@pytest.fixture(scope="module")
def views(spotty_calibration: Calibration) -> tuple[ViewFigures, ...]:
    return view_figures(spotty_calibration)


def test_pictures_and_views_are_named_where_most_corners_lie(
    spotty_calibration: Calibration, views: tuple[ViewFigures, ...]
) -> None:
    seen = spotty_calibration.observations
    total = len(np.unique(seen.frame))
    assert f"in 1 picture of {total}" in advice_on_corners(spotty_calibration, views, seen.frame == 3)
    assert f"in 2 pictures of {total}" in advice_on_corners(spotty_calibration, views, np.isin(seen.frame, (3, 5)))
    in_view = (seen.view == 2) & (seen.corner % 3 == 0)
    assert advice_on_corners(spotty_calibration, views, in_view).startswith(
        f"100% of these corners are in {views[2].name_in_sentence}"
    )
    everywhere = np.arange(len(seen)) % 7 == 0
    assert "spread over pictures and views" in advice_on_corners(spotty_calibration, views, everywhere)


def test_cells_name_the_views_that_have_them(views: tuple[ViewFigures, ...]) -> None:
    def cells(systematic: bool) -> CellMeans:
        return CellMeans(np.zeros((40, 2)), np.zeros((40, 2)), np.full(40, systematic))

    in_one = advice_on_cells([cells(place == 1) for place in range(len(views))], views)
    assert in_one == f"See the red arrows of {views[1].name_in_sentence}: a mirror there may be bent or displaced."
    in_all = advice_on_cells([cells(True) for _ in views], views)
    assert "in most views: the board may be bent, or the lens beyond its model" in in_all
