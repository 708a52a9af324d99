"""The picture of a tolerance study: bars as long as the shares of causes, whole, for any number of depths."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from mirrorcam.core.images.pictures import read_image
from mirrorcam.designs.tolerance_figure import COLOURS, tolerance_figure
from mirrorcam.optics.design.assess.monte_carlo import Study, study
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.tolerances import Tolerances

FILES = ("tolerance.json", "tolerance.png")


@pytest.fixture
def picture(found: Study, tmp_path: Path) -> NDArray[np.uint8]:
    tolerance_figure(found, tmp_path / "tolerance.png")
    return read_image(tmp_path / "tolerance.png")


def share_of(picture: NDArray[np.uint8], colour: str) -> float:
    wanted = [int(colour[k : k + 2], 16) for k in (1, 3, 5)]
    return float((np.abs(picture.astype(int) - wanted).max(axis=-1) < 12).mean())


def test_bars_are_as_long_as_the_shares(picture: NDArray[np.uint8], found: Study) -> None:
    """The lower part of the picture is one block of bars in the colours of the causes."""
    bars = picture[picture.shape[0] * 62 // 100 :]
    areas = np.array([share_of(bars, colour) for colour in COLOURS])
    shares = np.array([sum(of_cause.values()) for of_cause in found.shares.values()])
    np.testing.assert_allclose(areas[:5] / areas.sum(), shares / shares.sum(), atol=0.02)
    assert areas.sum() > 0.3


def test_nothing_is_cut_off_at_the_border(picture: NDArray[np.uint8]) -> None:
    height, width, _ = picture.shape
    assert 1400 < width < 2000
    assert 1200 < height < 2200
    border = np.concatenate([picture[:2].reshape(-1, 3), picture[-2:].reshape(-1, 3), picture[:, 0], picture[:, -1]])
    assert (border > 250).all()


@pytest.mark.parametrize("depths_mm", [(400.0,), (300.0, 400.0, 500.0)])
def test_any_number_of_depths_and_no_cause_at_all(
    default_layout: Layout, depths_mm: tuple[float, ...], tmp_path: Path
) -> None:
    nothing = study(default_layout, Tolerances.none(), depths_mm, devices=2)
    tolerance_figure(nothing, tmp_path / "tolerance.png")
    assert share_of(read_image(tmp_path / "tolerance.png"), COLOURS[0]) > 0.001
