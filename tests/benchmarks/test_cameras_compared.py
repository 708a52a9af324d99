"""Compared cameras: all look at one field, and the bound of depth is the closed form where that holds."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchmarks.cameras_compared.cameras import FIELD_MM, FOCUS_MM, ComparedCamera, cameras
from benchmarks.cameras_compared.measures import WINDOW_PX, depth_bound_mm, inner
from benchmarks.cameras_compared.page import COLUMNS, write_page
from benchmarks.cameras_compared.pictures import noise_variance
from benchmarks.records import Table


@pytest.fixture(scope="module")
def compared() -> list[ComparedCamera]:
    return list(cameras())


@pytest.mark.slow
def test_every_view_shows_the_field_in_the_middle(compared: list[ComparedCamera]) -> None:
    corners = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]]) * FIELD_MM
    points = np.column_stack([corners, np.full(4, FOCUS_MM)])
    for camera in compared:
        views = camera.views
        pixels = views.project(points).reshape(-1, 4, 2)
        np.testing.assert_allclose(pixels, np.broadcast_to(pixels[0], pixels.shape), atol=1e-6)
        np.testing.assert_allclose(pixels[0].mean(axis=0), [(views.width_px - 1) / 2, (views.height_px - 1) / 2])
        height, width = inner(views, np.empty((views.height_px, views.width_px))).shape
        np.testing.assert_allclose(np.ptp(pixels[0], axis=0), [width, height], atol=0.51)


@pytest.mark.slow
def test_bound_of_a_ramp_is_the_closed_form(compared: list[ComparedCamera]) -> None:
    camera = next(camera for camera in compared if camera.name == "two webcams, 60 mm")
    slope = 0.002
    light = np.float32(0.3) + np.float32(slope) * np.arange(21, dtype=np.float32)[None, :, None].repeat(21, axis=0)
    bound = depth_bound_mm(camera, light, np.full((21, 21), 500.0, np.float32))[10, 10]
    noise = np.sqrt(noise_variance(light[10, 10], 1.0))[0]
    # Two equal views 60 mm apart: the sum of squared distances from their mean is 60^2 / 2.
    expected = 500.0**2 / (camera.views.focal_px * np.sqrt(60.0**2 / 2.0)) * noise / (slope * WINDOW_PX)
    assert bound == pytest.approx(expected, rel=1e-3)


def test_both_tables_of_the_page_together_have_every_cell(tmp_path: Path) -> None:
    cells = tuple(f"cell {number}" for number in range(len(COLUMNS)))
    settings = dict.fromkeys(("scene", "scenes", "sure", "field", "noise", "dots", "stated"), "")
    write_page(tmp_path, Table(columns=COLUMNS, rows=(cells,)), settings)
    rows = [line for line in (tmp_path / "compared.md").read_text().splitlines() if line.startswith("| cell 0 |")]
    assert [cell for row in rows for cell in row.strip("| ").split(" | ")] == [*cells[:7], cells[0], *cells[7:]]
