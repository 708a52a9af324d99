"""Places on the sensor of a decoded pixel's light, and its unvignetted part, against rays of the complete pupil."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror import Mirror
from mirrorcam.optics.light_field.decoder import MAX_CROSSTALK, MIN_PUPIL_FRACTION, Decoder, choose_views, pupil_sources
from mirrorcam.render_scenes.truth.light_rays import trace_via_mirror
from mirrorcam.render_scenes.truth.pupil_maps import sunflower
from tests.nightly import a_few

APERTURE_MM, FOCUS_MM = 1.8, 500.0
DEPTH_MM = 375.0
RAYS = 1000


@pytest.fixture(scope="module")
def lens_layout(parabola_layout: Layout) -> Layout:
    """Return mirrors before a lens; the lower right ones are second-surface mirrors."""
    mirrors = [
        mirror
        if index < 6
        else Mirror.second_surface(
            mirror.virtual_centre_in_rig_mm, mirror.outline_in_rig_mm, thickness_mm=3.0, refractive_index=1.49
        )
        for index, mirror in enumerate(parabola_layout.mirrors)
    ]
    camera = parabola_layout.camera.replaced(aperture_mm=APERTURE_MM, focus_mm=FOCUS_MM)
    return parabola_layout.replaced(camera=camera, mirrors=tuple(mirrors))


@dataclass(frozen=True)
class Traced:
    """Traced pixels (n, 2): parts (n,) of the pupil whose rays meet a mirror, or other mirrors, and mean places.

    `shown_mm` (n, 2) is the mean place, in view axes, where rays via the mirror meet a plane.
    """

    own: FloatArray
    others: FloatArray
    shown_mm: FloatArray


def traced(layout: Layout, index: int, pixels: FloatArray) -> Traced:
    chief = layout.camera.unproject(pixels)
    own, others, shown = np.zeros(len(pixels)), np.zeros(len(pixels)), np.zeros((len(pixels), 2))
    for place in sunflower(RAYS):
        origin = np.array([*(APERTURE_MM / 2.0 * place), 0.0])
        rays = chief - origin / FOCUS_MM
        rays /= np.linalg.norm(rays, axis=1, keepdims=True)
        for number, mirror in enumerate(layout.mirrors):
            _, start, along, path_mm = trace_via_mirror(mirror, rays, None, origin)
            met = np.isfinite(path_mm)
            if number != index:
                others += met
                continue
            own += met
            start, along = start @ layout.view_from_rig.T, along @ layout.view_from_rig.T
            at = start + along * ((DEPTH_MM - start[:, 2]) / along[:, 2])[:, None]
            shown[met] += at[met, :2]
    return Traced(own / RAYS, others / RAYS, shown / np.maximum(own, 1.0)[:, None])


@pytest.mark.parametrize("index", a_few(1, [0, 4, 7]))
def test_fractions_and_pixels_match_rays_through_the_complete_pupil(lens_layout: Layout, index: int) -> None:
    views = choose_views(lens_layout, DEPTH_MM, "union")
    at = divmod(index, lens_layout.cols)
    points = views.plane_points_in_rig(DEPTH_MM, views.pixel_grid(), at).reshape(-1, 3)
    pixels, shares = pupil_sources(lens_layout, index, points, 2.0)
    partial, complete, none = (np.flatnonzero(mask) for mask in ((shares > 0) & (shares < 1), shares == 1, shares == 0))
    random = np.random.default_rng(index)
    chosen = np.concatenate([random.choice(partial, 100), random.choice(complete, 20)])
    found = traced(lens_layout, index, pixels[chosen])
    assert shares[chosen].min() < 0.6
    assert shares[chosen].min() > MIN_PUPIL_FRACTION
    np.testing.assert_allclose(shares[chosen], found.own, atol=0.007)
    assert found.others.max() < MAX_CROSSTALK + 0.004
    # The rays' mean is the requested point within .02 px; chief rays are off by .1 px and more.
    expected = (points[chosen] @ lens_layout.view_from_rig.T)[:, :2]
    px_per_mm = views.focal_px / views.reference_distance_mm
    assert np.abs(found.shown_mm - expected).max() * px_per_mm < 0.02
    # No pixel is left out that only this mirror shows, mostly unvignetted.
    inner = np.array([lens_layout.camera.width_px, lens_layout.camera.height_px]) - 1.0
    none = none[((pixels[none] >= 0.0) & (pixels[none] <= inner)).all(axis=1)]
    left = traced(lens_layout, index, pixels[random.choice(none, 100)])
    assert ((left.own < 0.75) | (left.others > MAX_CROSSTALK - 0.004)).all()


def test_a_point_out_of_focus_is_displaced_from_its_chief_ray(lens_layout: Layout) -> None:
    views = choose_views(lens_layout, 600.0, "common")
    points = views.plane_points_in_rig(600.0, views.pixel_grid(), (0, 0))
    pixels, shares = pupil_sources(lens_layout, 0, points, 2.0)
    moved = np.abs(pixels - lens_layout.project(points, 0))
    assert moved[shares == 1.0].max() < 1e-9
    assert 0.02 < moved[(shares > 0.0) & (shares < 0.7)].max() < 1.0


def test_a_tiny_pupil_is_a_pinhole(parabola_layout: Layout) -> None:
    camera = parabola_layout.camera.replaced(aperture_mm=0.002)
    pinhole, tiny = Decoder(parabola_layout), Decoder(parabola_layout.replaced(camera=camera))
    assert set(np.unique(tiny.weights)) == {0.0, 1.0}
    assert (tiny.weights != pinhole.weights).mean() < 1e-3


@pytest.mark.parametrize("aperture_mm", [1e-6, 1.8, 1000.0])
@pytest.mark.parametrize("focus_mm", [1e-3, 80.0, 1e6])
def test_any_valid_pupil_is_decoded(parabola_layout: Layout, aperture_mm: float, focus_mm: float) -> None:
    camera = parabola_layout.camera.replaced(aperture_mm=aperture_mm, focus_mm=focus_mm)
    weights = Decoder(parabola_layout.replaced(camera=camera), width_px=60).weights
    assert ((weights >= 0.0) & (weights <= 1.0)).all()
    assert weights.any() or aperture_mm > 1.0


def test_a_mirror_that_is_always_mostly_vignetted_shows_nothing(parabola_layout: Layout) -> None:
    camera = parabola_layout.camera.replaced(aperture_mm=60.0)
    assert not Decoder(parabola_layout.replaced(camera=camera), width_px=60).weights.any()


def test_a_walking_pupil_moves_the_sources(lens_layout: Layout) -> None:
    walking = lens_layout.replaced(camera=lens_layout.camera.replaced(pupil_walk_mm=0.5))
    views = choose_views(walking, DEPTH_MM, "union")
    points = views.plane_points_in_rig(DEPTH_MM, views.pixel_grid(), (0, 0)).reshape(-1, 3)
    pixels, shares = pupil_sources(walking, 0, points, 2.0)
    np.testing.assert_allclose(pixels[shares == 1], walking.project(points[shares == 1], 0), atol=1e-9)
    assert np.abs(pixels - lens_layout.project(points, 0))[shares == 1].max() > 0.02
