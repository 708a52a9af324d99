"""Clipping of convex polygons."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from numpy.testing import assert_allclose
from shapely import Polygon, contains_xy

from mirrorcam.core.errors import InputError
from mirrorcam.optics.design.program.seeds import faceted_parabola
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.pupil import Pupil, outline_aperture
from mirrorcam.optics.geometry.sub_images import (
    clipped,
    clipped_polygons,
    common_region,
    fields_of_view,
    pixel_efficiency,
    region_outline_px,
    sensor_polygon,
    sub_image_polygons,
    unvignetted_outline,
    unvignetted_outlines,
    vertices,
)
from tests.optics.rim_rays import unvignetted
from tests.optics.seeing_mirrors import DEPTH_MM, mirror_seeing, two_rectangles

SQUARE = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [0.0, 2.0]])
PUPIL = Pupil(1.8, 450.0)


def test_the_clipped_part_lies_beyond_the_line() -> None:
    heights = SQUARE @ [1.0, 1.0] - 1.0
    part = clipped(SQUARE, heights)
    expected = Polygon(SQUARE).difference(Polygon([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]))
    assert Polygon(part).symmetric_difference(expected).area < 1e-12


def test_clipping_may_keep_all_or_nothing() -> None:
    np.testing.assert_array_equal(clipped(SQUARE, np.ones(4)), SQUARE)
    assert clipped(SQUARE, -np.ones(4)).shape == (0, 2)
    assert clipped(np.zeros((0, 2)), np.zeros(0)).shape == (0, 2)


def test_polygons_clipped_together_equal_those_clipped_alone() -> None:
    """Twice in a row, a triangle that repeats its last corner among quadrangles."""
    random = np.random.default_rng(1)
    polygons = SQUARE + random.uniform(-0.4, 0.4, (40, 4, 2))
    polygons[::3, 3] = polygons[::3, 2]
    together, alone = polygons, [polygon[:3] if k % 3 == 0 else polygon for k, polygon in enumerate(polygons)]
    for _ in range(2):
        slopes, reach = random.normal(size=(40, 2)), random.normal(0.5, 0.5, 40)
        together = clipped_polygons(together, (together @ slopes[..., None])[..., 0] + reach[:, None])
        alone = [clipped(part, part @ slope + far) for part, slope, far in zip(alone, slopes, reach, strict=True)]
    assert together.shape[1] <= 6
    assert {len(part) for part in alone} == {0, 3, 4, 5}
    for part, expected in zip(together, alone, strict=True):
        np.testing.assert_array_equal(part[: len(expected)], expected)
        np.testing.assert_array_equal(part[len(expected) :] - (part[len(expected) - 1] if len(expected) else 0.0), 0.0)


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
    with pytest.raises(InputError, match="is not monotonic on the sensor"):
        sensor_polygon(folding)


def test_a_mirror_outside_the_sensor_has_an_empty_sub_image() -> None:
    beside = Layout(rows=1, cols=1, camera=Camera.c920(), mirrors=(mirror_seeing((900, 950, 60, 120), 80.0),))
    assert sub_image_polygons(beside)[0].is_empty
    views = fields_of_view(beside)
    region, footprints = views.common_region(DEPTH_MM)
    assert region.is_empty
    assert footprints[0].is_empty
    assert views.pixel_efficiency(region, DEPTH_MM) == 0.0


def test_a_depth_within_the_mirrors_has_no_footprints() -> None:
    views = fields_of_view(two_rectangles())
    with pytest.raises(InputError, match="is nearer than the mirrors, which reach"):
        views.footprints(views.mirror_depth_mm)
    assert not any(seen.is_empty for seen in views.footprints(views.mirror_depth_mm + 1.0))


def test_an_outline_on_the_sensor_is_where_its_points_project() -> None:
    layout = two_rectangles()
    region, _ = common_region(layout, DEPTH_MM)
    outline = region_outline_px(layout, region, DEPTH_MM, 1)
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
        on_mirror = mirror.intersect(rays[:, :2])
        leaving = on_mirror - mirror.virtual_centre_in_rig_mm
        at = on_mirror + leaving * ((500.0 - on_mirror @ axis) / (leaving @ axis))[:, None]
        here = contains_xy(Polygon(mirror.outline_normalized), rays[:, :2])
        seeing |= here & contains_xy(region, at @ across, at @ down)
    assert seeing.mean() > 0.01
    assert pixel_efficiency(layout, 500.0) == pytest.approx(seeing.mean(), abs=5e-4)


def test_pixels_within_the_unvignetted_outline_are_unvignetted(default_layout: Layout) -> None:
    shares = []
    for mirror in default_layout.mirrors:
        outline = unvignetted_outline(mirror, PUPIL)
        middles = (outline + np.roll(outline, -1, axis=0)) / 2.0
        for border in (outline, middles):
            np.testing.assert_allclose(
                outline_aperture(mirror, border, PUPIL.focus_mm).distance.min(axis=1), PUPIL.radius_mm, atol=1e-3
            )
        shares.append(Polygon(outline).area / Polygon(mirror.outline_normalized).area)
    assert 0.8 < min(shares) < max(shares) < 0.95
    np.testing.assert_array_equal(unvignetted_outline(mirror, Pupil()), mirror.usable_normalized)


@pytest.mark.parametrize(("thickness_mm", "within_px"), [(0.0, 0.05), (1.5, 8.0)])
def test_it_holds_the_pixels_all_of_whose_rays_meet_the_mirror(
    default_layout: Layout, thickness_mm: float, within_px: float
) -> None:
    """Glass acts like the apparent mirror of the chief ray, with deviations at the borders on both sides."""
    for number, mirror in enumerate(default_layout.mirrors):
        if thickness_mm:
            mirror = mirror.replaced(surface="second", thickness_mm=thickness_mm)
        outline = Polygon(unvignetted_outline(mirror, PUPIL))
        low, high = np.reshape(outline.bounds, (2, 2))
        chief = np.random.default_rng(number).uniform(low - 0.005, high + 0.005, (3000, 2))
        served = unvignetted(mirror, chief, PUPIL)
        inside = shapely.contains_xy(outline, *chief.T)
        assert 0.4 < served.mean() < 0.99
        assert inside.mean() == pytest.approx(served.mean(), abs=0.02)
        far = chief[inside != served]
        assert (shapely.distance(outline.exterior, shapely.points(far)) * 1360.4 < within_px).all()


def test_a_mirror_narrower_than_the_blur_has_no_unvignetted_pixel(default_layout: Layout) -> None:
    assert unvignetted_outline(default_layout.mirrors[0], Pupil(40.0, PUPIL.focus_mm)).shape == (0, 2)


def test_outlines_computed_together_equal_those_computed_alone(default_layout: Layout) -> None:
    """A triangle that repeats its last corner among them, and one too small for the pupil."""
    small, mirrors = 0.02, list(default_layout.mirrors)
    corners = mirrors[0].outline_in_rig_mm
    mirrors[0] = mirrors[0].replaced(outline_in_rig_mm=corners[:3])
    middle = mirrors[1].outline_in_rig_mm.mean(axis=0)
    mirrors[1] = mirrors[1].replaced(outline_in_rig_mm=middle + small * (mirrors[1].outline_in_rig_mm - middle))
    shown = np.array([mirror.outline_normalized[[0, 1, 2, -1]] for mirror in mirrors])
    normals = np.array([mirror.normal_in_rig for mirror in mirrors])
    distances_mm = np.array([mirror.distance_mm for mirror in mirrors])
    together = unvignetted_outlines(shown, normals, distances_mm, PUPIL)
    for mirror, outline in zip(mirrors, together, strict=True):
        alone = unvignetted_outline(mirror, PUPIL)
        np.testing.assert_allclose(outline[: len(alone)], alone, atol=1e-15)
        np.testing.assert_array_equal(outline[len(alone) :] - (outline[len(alone) - 1] if len(alone) else 0.0), 0.0)
    assert [len(unvignetted_outline(mirror, PUPIL)) for mirror in mirrors[:3]] == [3, 0, 4]
