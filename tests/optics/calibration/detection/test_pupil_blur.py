"""The pupil from light across mirrors' borders, against rays from all over a pupil, with their own arithmetic."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.detection.border_light import Border, BorderLight, borders
from mirrorcam.optics.calibration.detection.pupil_blur import NEARNESS_SIGMA, SeenPupil, seen_pupil
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror import Mirror
from mirrorcam.optics.geometry.pupil import Pupil

RAYS = 250
NOISE = 2.0  # grey levels, of 90


def places(pupil: Pupil) -> FloatArray:
    """Points (n, 2) spread evenly over a pupil, mm."""
    number = np.arange(RAYS)
    radius, angle = np.sqrt((number + 0.5) / RAYS), np.pi * (3.0 - np.sqrt(5.0)) * number
    return pupil.radius_mm * np.column_stack([radius * np.cos(angle), radius * np.sin(angle)])


def traced(mirror: Mirror, normalized: FloatArray, pupil: Pupil) -> FloatArray:
    """Part (n,) of the rays of a pupil, in focus, that meet a mirror within its outline."""
    normal, outline = mirror.normal_in_rig, mirror.outline_in_rig_mm
    middle, met = outline.mean(axis=0), np.zeros(len(normalized))
    for x, y in places(pupil):
        start = np.array([x, y, 0.0])
        along = np.column_stack([normalized, np.ones(len(normalized))]) - start / pupil.focus_mm
        at = start + along * ((middle - start) @ normal / (along @ normal))[:, None]
        inside = np.ones(len(at), dtype=bool)
        for corner, following in zip(outline, np.roll(outline, -1, axis=0), strict=True):
            side = np.cross(normal, following - corner)
            inside &= (at - corner) @ side * ((middle - corner) @ side) > 0.0
        met += inside
    return met / RAYS


def light(layout: Layout, border: Border, pupil: Pupil, random: np.random.Generator) -> BorderLight:
    """What frames would show across a border, with noise; light fades along it by a tenth."""
    shape = border.pixels.shape[:2]
    normalized = border.normalized(layout).reshape(-1, 2)
    served = traced(layout.mirrors[border.mirror], np.nan_to_num(normalized), pupil).reshape(shape)
    fading = np.linspace(1.0, 0.9, shape[0])[:, None]
    shown = 90.0 * fading * served + random.normal(0.0, NOISE, shape)
    on_sensor = np.isfinite(normalized).all(axis=1).reshape(shape)
    return BorderLight(border, np.where(on_sensor, shown, np.nan), np.where(on_sensor, NOISE, np.inf))


def found(layout: Layout, pupil: Pupil, seed: int, assumed: Pupil) -> SeenPupil:
    random = np.random.default_rng(seed)
    given = layout.replaced(camera=layout.camera.with_pupil(assumed))
    seen = seen_pupil(given, [light(layout, border, pupil, random) for border in borders(given)])
    assert seen is not None
    return seen


@pytest.mark.parametrize(("true", "seed"), [(Pupil(1.8, 500.0), 1), (Pupil(2.4, 900.0), 2), (Pupil(1.2, 300.0), 3)])
def test_diameter_and_focus_are_found_within_their_uncertainty(fold_90_layout: Layout, true: Pupil, seed: int) -> None:
    seen = found(fold_90_layout, true, seed, Pupil(1.8, 500.0))
    assert abs(seen.aperture_mm - true.aperture_mm) < 2.5 * seen.aperture_sigma_mm
    assert abs(seen.nearness - 1.0 / true.focus_mm) < 2.5 * seen.nearness_sigma
    assert seen.aperture_sigma_mm < 0.04 * true.aperture_mm
    assert seen.shows_focus
    assert not seen.is_pinhole


def test_a_pinhole_is_found_to_be_one_and_its_focus_left_open(fold_90_layout: Layout) -> None:
    seen = found(fold_90_layout, Pupil(0.0, 500.0), 4, Pupil(1.8, 500.0))
    assert seen.is_pinhole
    assert not seen.shows_focus
    assert seen.aperture_mm < 0.15
    assert 0.0 < seen.aperture_sigma_mm < 0.15
    assert seen.nearness_sigma > 0.9 * NEARNESS_SIGMA


def test_few_borders_and_dim_ones_tell_nothing(fold_90_layout: Layout) -> None:
    random = np.random.default_rng(5)
    lights = [light(fold_90_layout, border, Pupil(1.8, 500.0), random) for border in borders(fold_90_layout)[:4]]
    assert seen_pupil(fold_90_layout, lights) is None
    dim = [BorderLight(each.border, 0.02 * each.light, each.sigma) for each in lights] * 3
    assert seen_pupil(fold_90_layout, dim) is None


def test_a_border_that_shows_something_else_is_left_out(fold_90_layout: Layout) -> None:
    random, true = np.random.default_rng(6), Pupil(1.8, 500.0)
    lights = [light(fold_90_layout, border, true, random) for border in borders(fold_90_layout)]
    clean = seen_pupil(fold_90_layout, lights)
    wide = light(fold_90_layout, lights[4].border, Pupil(4.0, 500.0), random)
    spoilt = seen_pupil(fold_90_layout, [*lights[:4], wide, *lights[5:]])
    assert clean is not None
    assert spoilt is not None
    assert spoilt.borders == clean.borders - 1
    assert spoilt.aperture_mm == pytest.approx(clean.aperture_mm, abs=clean.aperture_sigma_mm)
