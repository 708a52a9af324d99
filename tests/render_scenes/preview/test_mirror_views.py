"""Pupil fractions of mirrors and rays of pixels, against the exact ones of the fast renderer and the truth."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.pupil import Pupil, clear_aperture, disc_part
from mirrorcam.render_scenes.preview.mirror_views import (
    INDEX,
    MIN_PUPIL_FRACTION,
    WINDOW,
    mirror_views,
    pupil_fraction,
    reflectance_and_shift,
    scene_ray,
    scene_ray_step,
)
from mirrorcam.render_scenes.truth.light_rays import trace_via_mirror


def pixels_of(layout: Layout, mirror: int, pupil: Pupil) -> tuple[np.ndarray, np.ndarray]:
    """Some pixels (n, 2) of the window of a mirror, and their normalized coordinates."""
    views = mirror_views(layout, pupil, 0.9)
    number = int(np.flatnonzero(views.table[:, INDEX] == mirror)[0])
    top, bottom, left, right = views.table[number, WINDOW : WINDOW + 4]
    px = np.random.default_rng(mirror).uniform([left, top], [right - 1, bottom - 1], (400, 2))
    return px, layout.camera.normalized_from_pixels(px)


@pytest.mark.parametrize("pupil", [Pupil(1.8, 500.0), Pupil(6.0, 500.0)])
@pytest.mark.parametrize("name", ["distorted_layout", "plates"])
def test_pupil_fractions_are_those_of_a_disc_divided_by_edges(
    name: str, pupil: Pupil, request: pytest.FixtureRequest
) -> None:
    layout: Layout = request.getfixturevalue(name)
    views = mirror_views(layout, pupil, 0.9)
    for number, mirror in enumerate(views.table[:, INDEX].astype(int)):
        _, points = pixels_of(layout, mirror, pupil)
        exact = disc_part(clear_aperture(layout.mirrors[mirror], points, pupil.focus_mm), pupil.radius_mm).fraction
        found = np.array([pupil_fraction(views, number, *point) for point in points])
        # At corners, the share is the product of two.
        assert np.abs(found - exact).max() < 0.12
        assert np.abs(found - exact).mean() < 0.005
        assert 0.0 < exact.mean() < 1.0


def test_no_pixel_outside_the_window_shows_the_mirror(distorted_layout: Layout) -> None:
    pupil = Pupil(6.0, 500.0)
    views = mirror_views(distorted_layout, pupil, 0.9)
    camera = distorted_layout.camera
    columns, rows = np.meshgrid(np.arange(0, camera.width_px, 9), np.arange(0, camera.height_px, 9))
    points = camera.normalized_from_pixels(np.stack([columns, rows], axis=-1))
    for number in range(len(views.table)):
        top, bottom, left, right = views.table[number, WINDOW : WINDOW + 4]
        outside = (rows < top) | (rows >= bottom) | (columns < left) | (columns >= right)
        assert max(pupil_fraction(views, number, *point) for point in points[outside]) < MIN_PUPIL_FRACTION


@pytest.mark.parametrize("name", ["distorted_layout", "plates"])
def test_rays_leave_the_mirror_as_in_the_ground_truth(name: str, request: pytest.FixtureRequest) -> None:
    layout: Layout = request.getfixturevalue(name)
    views = mirror_views(layout, Pupil(1.8, 500.0), 0.9)
    turn = layout.view_from_rig
    for number, mirror in enumerate(views.table[:, INDEX].astype(int)):
        _, points = pixels_of(layout, mirror, Pupil(1.8, 500.0))
        rays = np.column_stack([points, np.ones(len(points))])
        _, leaves, out, _ = trace_via_mirror(layout.mirrors[mirror], rays / np.linalg.norm(rays, axis=1, keepdims=True))
        met = np.flatnonzero(np.isfinite(leaves[:, 0]))[:50]
        assert len(met) == 50
        for k in met:
            _, slide = reflectance_and_shift(views, number, *points[k])
            start, direction, least = (np.array(part) for part in scene_ray(views, number, *points[k], slide))
            np.testing.assert_allclose(direction / np.linalg.norm(direction), turn @ out[k], atol=1e-9)
            to = turn @ leaves[k] - start
            np.testing.assert_allclose(np.cross(to, direction), 0.0, atol=1e-6)
            assert least == pytest.approx(float(to @ direction / (direction @ direction)), rel=1e-6)


def test_a_plate_gives_the_light_of_all_its_passes(plates: Layout) -> None:
    views = mirror_views(plates, Pupil(1.8, 500.0), 0.9)
    light, _ = reflectance_and_shift(views, 4, 0.0, 0.0)
    # Acrylic reflects 4 % and more; the loss of the image returns as the front's ghost and by further passes.
    assert 0.9 < light < 0.92
    plain, slide = reflectance_and_shift(
        mirror_views(plates.with_surface("first"), Pupil(1.8, 500.0), 0.9), 4, 0.0, 0.0
    )
    assert (plain, slide) == (0.9, 0.0)


def test_the_step_of_a_ray_is_the_difference_of_two(distorted_layout: Layout) -> None:
    views = mirror_views(distorted_layout, Pupil(1.8, 500.0), 0.9)
    ends = [np.array(scene_ray(views, 2, 0.1 + x, 0.05 + y, 0.0)[1]) for x, y in ((0.0, 0.0), (0.02, -0.01))]
    np.testing.assert_allclose(scene_ray_step(views, 2, 0.02, -0.01), ends[1] - ends[0], atol=1e-12)
