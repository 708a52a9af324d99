"""The unvignetted part of the pupil, against individually traced rays, evenly spread points and closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.pupil import HalfPlanes, disc_part, outline_aperture, segment_fraction
from mirrorcam.render_scenes.truth.light_rays import trace_via_mirror
from mirrorcam.render_scenes.truth.pupil_maps import sunflower

FOCUS_MM = 450.0


def rays_around(layout: Layout, index: int, count: int) -> tuple[FloatArray, FloatArray]:
    """Chief rays (n, 2) in and around a sub-image, and points (n, 2) in a large pupil."""
    random = np.random.default_rng(index)
    outline = layout.mirrors[index].outline_normalized
    low, high = outline.min(axis=0) - 0.02, outline.max(axis=0) + 0.02
    return random.uniform(low, high, (count, 2)), random.uniform(-3.0, 3.0, (count, 2))


@pytest.mark.parametrize("index", [0, 4, 8])
def test_half_planes_hold_the_rays_that_meet_the_mirror(default_layout: Layout, index: int) -> None:
    chief, places = rays_around(default_layout, index, 4000)
    mirror = default_layout.mirrors[index]
    origin = np.column_stack([places, np.zeros(len(places))])
    rays = np.column_stack([chief, np.ones(len(chief))]) - origin / FOCUS_MM
    entry, *_ = trace_via_mirror(mirror, rays / np.linalg.norm(rays, axis=1, keepdims=True), None, origin)
    planes = outline_aperture(mirror, chief, FOCUS_MM)
    inside = ((planes.direction * places[:, None]).sum(axis=-1) + planes.distance >= 0.0).all(axis=1)
    np.testing.assert_array_equal(inside, np.isfinite(entry))
    assert 0.1 < inside.mean() < 0.9


def test_a_shift_moves_the_border_as_far_on_the_mirror(default_layout: Layout) -> None:
    """A ray that meets the front 2 mm inside the border leaves at the border if the shift is 2 mm."""
    mirror = default_layout.mirrors[4]
    chief = mirror.outline_normalized.mean(axis=0)[None] + np.linspace(0.0, 0.1, 200)[:, None] * [1.0, 0.3]
    here, shifted = (outline_aperture(mirror, chief, FOCUS_MM, shift) for shift in (None, np.full(200, 2.0)))
    foot = -mirror.distance_mm * mirror.normal_in_rig
    moved = mirror.intersect(chief)
    outwards = moved - foot
    moved += 2.0 * outwards / np.linalg.norm(outwards, axis=1, keepdims=True)
    there = outline_aperture(mirror, moved[:, :2] / moved[:, 2:], FOCUS_MM)
    assert (here.distance.min(axis=1) > 0.0).any()
    np.testing.assert_array_equal(shifted.distance > 0.0, there.distance > 0.0)


def test_parts_are_those_of_evenly_spread_points() -> None:
    random = np.random.default_rng(0)
    angles = random.uniform(0.0, 2.0 * np.pi, (60, 1)) + np.array([0.0, 1.6, 3.0, 4.5])
    direction = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    distance = random.uniform(-0.5, 1.5, (60, 4))
    distance[:20, 1:] = 2.0  # a single border
    part = disc_part(HalfPlanes(direction, distance), 1.0)
    points = sunflower(100_000)
    inside = (points @ direction.swapaxes(1, 2) + distance[:, None] >= 0.0).all(axis=2)
    share = inside.mean(axis=1)
    np.testing.assert_allclose(part.fraction[:20], share[:20], atol=2e-4)
    np.testing.assert_allclose(part.fraction, share, atol=4e-3)
    for k in np.flatnonzero(share > 0.02):
        x, y = points[inside[k]].T
        np.testing.assert_allclose(share[k] * (part.centroid[k] - [x.mean(), y.mean()]), 0.0, atol=4e-3)
        covariance = np.cov(x, y)
        np.testing.assert_allclose(share[k] * (part.spread[k] - covariance[[0, 1, 0], [0, 1, 1]]), 0.0, atol=4e-3)
    assert (share == 0.0).any()
    assert (part.centroid[part.fraction == 0.0] == 0.0).all()


def test_half_a_disc_has_its_closed_form_in_millimetres() -> None:
    part = disc_part(HalfPlanes(np.array([[[0.0, 1.0]]]), np.zeros((1, 1))), 0.9)
    np.testing.assert_allclose(part.fraction, 0.5)
    np.testing.assert_allclose(part.centroid, [[0.0, 4.0 / (3.0 * np.pi)]], atol=1e-12)
    np.testing.assert_allclose(part.spread, [[0.25, 0.25 - (4.0 / (3.0 * np.pi)) ** 2, 0.0]], atol=1e-12)


def test_a_pinhole_is_either_clear_or_blocked() -> None:
    planes = HalfPlanes(np.array([[[1.0, 0.0]], [[1.0, 0.0]]]), np.array([[1e-9], [-1e-9]]))
    part = disc_part(planes, 0.0)
    np.testing.assert_array_equal(part.fraction, [1.0, 0.0])
    np.testing.assert_array_equal(part.centroid, 0.0)


def test_a_segment_has_its_fraction_of_the_discs_area() -> None:
    at = np.linspace(-1.2, 1.2, 25)
    y = (np.arange(20_000) + 0.5) / 10_000 - 1.0
    chords = np.sqrt(1.0 - y**2)
    expected = [float(chords[y > -inside].sum() / chords.sum()) for inside in at]
    assert segment_fraction(at) == pytest.approx(expected, abs=1e-4)
