"""Advice names a picture or a view only where the corners in question lie there."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.optics.calibration.diagnostics.calibration_result import Calibration
from mirrorcam.optics.calibration.diagnostics.residual_places import advice_on_cells, advice_on_corners
from mirrorcam.optics.calibration.diagnostics.view_statistics import CellMeans, ViewFigures, view_figures
from tests.optics.calibration.sound_calibration import sound_calibration


@pytest.fixture(scope="module")
def calibration() -> Calibration:
    return sound_calibration()


@pytest.fixture(scope="module")
def views(calibration: Calibration) -> tuple[ViewFigures, ...]:
    return view_figures(calibration)


def test_pictures_and_views_are_named_where_most_corners_lie(
    calibration: Calibration, views: tuple[ViewFigures, ...]
) -> None:
    seen = calibration.observations
    total = len(np.unique(seen.frame))
    assert f"in 1 picture of {total}" in advice_on_corners(calibration, views, seen.frame == 3)
    assert f"in 2 pictures of {total}" in advice_on_corners(calibration, views, np.isin(seen.frame, (3, 5)))
    in_view = (seen.view == 2) & (seen.corner % 3 == 0)
    assert advice_on_corners(calibration, views, in_view).startswith(f"100% of these corners are in {views[2].called}")
    everywhere = np.arange(len(seen)) % 7 == 0
    assert "spread over pictures and views" in advice_on_corners(calibration, views, everywhere)


def test_cells_name_the_views_that_have_them(views: tuple[ViewFigures, ...]) -> None:
    def cells(systematic: bool) -> CellMeans:
        return CellMeans(np.zeros((40, 2)), np.zeros((40, 2)), np.full(40, systematic))

    in_one = advice_on_cells([cells(place == 1) for place in range(len(views))], views)
    assert in_one == f"See the red arrows of {views[1].called}: a mirror there may be bent, or have moved."
    in_all = advice_on_cells([cells(True) for _ in views], views)
    assert "in most views: the board may be bent, or the lens beyond its model" in in_all
