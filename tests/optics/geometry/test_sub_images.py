"""Fields of view and what they have in common, against closed forms and a count of pixels."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose
from shapely import Polygon, contains_xy

from mirrorcam.core.values import InputError
from mirrorcam.optics.design.program.seeds import faceted_parabola
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.sub_images import (
    common_region,
    fields_of_view,
    pixel_efficiency,
    seen_px,
    sensor_polygon,
    sub_images,
    vertices,
)
from tests.optics.seeing_mirrors import DEPTH_MM, mirror_seeing, two_rectangles


def test_the_common_region_is_where_footprints_overlap() -> None:
    region, footprints = common_region(two_rectangles(), DEPTH_MM)
    assert [seen.area for seen in footprints] == pytest.approx([70.0 * 85.0, 70.0 * 70.0])
    assert region.symmetric_difference(Polygon([(-20, -90), (30, -90), (30, -105), (-20, -105)])).area < 1e-6


def test_pixel_efficiency_counts_every_view_that_sees_the_region() -> None:
    pixels = 750.0 * 1360.38**2 * (1.0 / 380.0**2 + 1.0 / 400.0**2)
    assert pixel_efficiency(two_rectangles(), DEPTH_MM) == pytest.approx(pixels / (1920 * 1080))


def test_the_sensor_reaches_to_the_edges_of_its_outermost_pixels() -> None:
    camera = Camera.c920()
    width, height = (size / focal for size, focal in ((1920, camera.fx_px), (1080, camera.fy_px)))
    assert sensor_polygon(camera).area == pytest.approx(width * height)
    folding = camera.replaced(distortion=[-0.9, 0.0, 0.0, 0.0, 0.0])
    with pytest.raises(InputError, match="folds inside the sensor"):
        sensor_polygon(folding)


def test_a_mirror_beside_the_sensor_has_an_empty_sub_image() -> None:
    beside = Layout(rows=1, cols=1, camera=Camera.c920(), mirrors=(mirror_seeing((900, 950, 60, 120), 80.0),))
    assert sub_images(beside)[0].is_empty
    views = fields_of_view(beside)
    region, footprints = views.common_region(DEPTH_MM)
    assert region.is_empty
    assert footprints[0].is_empty
    assert views.pixel_efficiency(region, DEPTH_MM) == 0.0


def test_a_depth_within_the_mirrors_has_no_footprints() -> None:
    views = fields_of_view(two_rectangles())
    with pytest.raises(InputError, match="is nearer than the mirrors, which reach"):
        views.footprints(views.reach_mm)
    assert not any(seen.is_empty for seen in views.footprints(views.reach_mm + 1.0))


def test_an_outline_on_the_sensor_is_where_its_points_project() -> None:
    layout = two_rectangles()
    region, _ = common_region(layout, DEPTH_MM)
    outline = seen_px(layout, region, DEPTH_MM, 1)
    corners = np.column_stack([vertices(region), np.full(4, DEPTH_MM)]) @ layout.view_from_rig
    assert_allclose(outline, layout.project(corners, 1))


def test_what_the_sensor_cuts_off_does_not_count() -> None:
    wide = Layout(rows=1, cols=1, camera=Camera.c920(), mirrors=(mirror_seeing((-400, 400, 60, 120), 80.0),))
    assert pixel_efficiency(wide, DEPTH_MM) == pytest.approx(60.0 * 1360.38 / 380.0 / 1080.0)


@pytest.mark.parametrize("fold_deg", [80.0, 90.0, 105.0])
def test_efficiency_equals_a_count_of_pixels_through_a_distorting_lens(fold_deg: float) -> None:
    camera = Camera.c920().replaced(distortion=[0.08, -0.15, 0.001, -0.002, 0.02])
    cosine, sine = np.cos(np.radians(fold_deg)), np.sin(np.radians(fold_deg))
    across, down, axis = np.array([[1.0, 0.0, 0.0], [0.0, cosine, -sine], [0.0, sine, cosine]])
    layout = faceted_parabola(DesignSpec(camera=camera)).replaced(view_from_rig=np.array([across, down, axis]))
    region, _ = common_region(layout, 500.0)
    step = 4
    pixels = np.stack(np.meshgrid(np.arange(1.5, 1920, step), np.arange(1.5, 1080, step)), axis=-1).reshape(-1, 2)
    rays = camera.unproject(pixels)
    seeing = np.zeros(len(pixels), dtype=bool)
    for mirror in layout.mirrors:
        on_mirror = mirror.cut(rays[:, :2])
        leaving = on_mirror - mirror.virtual_centre_in_rig_mm
        at = on_mirror + leaving * ((500.0 - on_mirror @ axis) / (leaving @ axis))[:, None]
        here = contains_xy(Polygon(mirror.outline_normalized), rays[:, :2])
        seeing |= here & contains_xy(region, at @ across, at @ down)
    assert seeing.mean() > 0.01
    assert pixel_efficiency(layout, 500.0) == pytest.approx(seeing.mean(), abs=5e-4)
