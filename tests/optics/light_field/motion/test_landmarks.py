"""Landmarks of a light field, seen by itself and by one that has moved."""

from __future__ import annotations

import numpy as np

from mirrorcam.optics.geometry.transforms import inverse, rigid
from mirrorcam.optics.light_field.features.slope import Geometry
from mirrorcam.optics.light_field.motion.landmarks import Frame, landmarks_of, see
from mirrorcam.optics.light_field.motion.pose_fit import predicted
from tests.optics.light_field.relief_scene import Relief, even_views, light_field_of

VIEWS = even_views(3, 10.0, width_px=200, height_px=150, centre_px=np.array([99.5, 74.5]))
SCENE = Relief(heights_mm=((20.0, 8.0),))


def test_landmarks_are_seen_where_the_scene_has_them() -> None:
    geometry = Geometry.of(VIEWS)
    first, true_mm = light_field_of(SCENE, VIEWS, subsamples=1)
    pixels = np.stack(np.meshgrid(np.arange(30, 171, 10), np.arange(30, 121, 10)), axis=-1).reshape(-1, 2)
    exact = 1.0 / true_mm[pixels[:, 1], pixels[:, 0]]
    directions = geometry.directions(pixels.astype(float))
    known = landmarks_of(geometry, Frame.of(first), directions, exact * 1.001, np.full(len(pixels), 2.0), map)
    assert len(known.directions) > 0.8 * len(pixels)
    place = [np.flatnonzero((directions == each).all(axis=1))[0] for each in known.directions]
    ratio = (known.inverse_mm - exact[place]) / np.hypot(known.sigma_per_mm, known.shape_sigma_per_mm)
    assert np.median(np.abs(ratio)) < 1.0

    moved = rigid(np.eye(3), [15.0, 5.0, -10.0])
    second, _ = light_field_of(SCENE, VIEWS, world_from_view=moved, subsamples=1, seed=1)
    expected = predicted(known, inverse(moved))
    seen = see(geometry, Frame.of(second), known.given, *expected, map)
    assert seen.valid.mean() > 0.7
    off_px = 500.0 * np.linalg.norm(seen.directions - expected[0], axis=1)[seen.valid]
    assert np.median(off_px) < 0.05
    assert np.median(np.abs(seen.inverse_mm / expected[1] - 1.0)[seen.valid]) < 0.002
