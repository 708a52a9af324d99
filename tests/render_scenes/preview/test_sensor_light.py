"""What pixels of a sensor show, against the reference's rays and pictures of the same scene."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.pupil import Pupil
from mirrorcam.render_scenes.preview.arranged import arranged_tabletop
from mirrorcam.render_scenes.preview.mirror_views import mirror_views
from mirrorcam.render_scenes.preview.sensor_light import SensorLight, rays_of_pixels, sensor_light
from mirrorcam.render_scenes.preview.traced_scene import traced_tabletop
from mirrorcam.render_scenes.preview.triangle_tree import NOTHING
from mirrorcam.render_scenes.tabletop.tabletop_scene import TabletopScene
from mirrorcam.render_scenes.truth.pixel_maps import pixel_rays

PUPIL = Pupil(1.8, 500.0)


def light_of(layout: Layout) -> SensorLight:
    return sensor_light(layout.camera, mirror_views(layout, PUPIL, 0.92), traced_tabletop(arranged_tabletop(layout, 0)))


@pytest.fixture(params=["distorted_layout", "plates"])
def small(request: pytest.FixtureRequest) -> Layout:
    """A layout with a lens that distorts, and with plates, at 480 x 270 pixels."""
    layout: Layout = request.getfixturevalue(request.param)
    return layout.replaced(camera=layout.camera.binned(0.25))


def test_each_pixel_shows_what_the_reference_meets_at_its_depth_and_about_its_colour(small: Layout) -> None:
    found = light_of(small)
    reference = TabletopScene(small, arranged_tabletop(small, 0), 0.92)
    rays = pixel_rays(small, mirrors=True, pupil=PUPIL)
    hits = reference.hits(rays.start, rays.direction)
    shown = (hits.object_index != NOTHING) & (rays.mirror == found.mirror)
    # Borders of mirrors are bands in which both are seen.
    assert shown.mean() > 0.85
    assert (hits.object_index == found.thing)[shown].mean() > 0.9999
    same = shown & (hits.object_index == found.thing)
    depth = hits.points[same] @ small.view_from_rig[2]
    error = np.abs(depth - found.depth_mm[same])
    assert np.median(error) < 1e-3
    assert np.percentile(error, 99.0) < 0.01
    seen = rays.path_before_mm[same] + hits.path_mm[same]
    pixels = rays_of_pixels(small.camera.model_dump_json())[same]
    if not small.mirrors[0].is_second_surface:
        along = found.along_axis_mm[same] * np.sqrt(1.0 + np.square(pixels).sum(axis=1))
        np.testing.assert_allclose(along, seen, rtol=1e-4)
    radiance = reference.photograph(PUPIL, spp=16, subpixels=1, seed=0)
    grey = [np.clip(light, 0.0, 1.0).mean(axis=2) for light in (radiance, found.radiance)]
    assert np.corrcoef(grey[0].ravel(), grey[1].ravel())[0, 1] > 0.965
    assert grey[1][shown].mean() == pytest.approx(grey[0][shown].mean(), rel=0.05)
    for number in np.unique(found.thing[same]):
        of_one = same & (found.thing == number)
        assert grey[1][of_one].mean() == pytest.approx(grey[0][of_one].mean(), rel=0.2)


def test_gaps_between_mirrors_are_black_and_nothing_is_at_infinity(small: Layout) -> None:
    found = light_of(small)
    gap = found.mirror == NOTHING
    assert gap.any()
    assert not found.radiance[gap].any()
    assert (found.thing[gap] == NOTHING).all()
    assert np.isinf(found.depth_mm[found.thing == NOTHING]).all()
    assert np.isfinite(found.depth_mm[found.thing != NOTHING]).all()
    # Where two mirrors share the pupil, neither is as bright as alone, and both together no brighter.
    assert np.isfinite(found.radiance).all()


def test_edges_are_smooth(small_layout: Layout) -> None:
    found = light_of(small_layout)
    board = found.thing == 5
    grey = found.radiance.mean(axis=2)
    levels = np.unique(np.round(grey[board], 3))
    assert len(levels) > 100
