"""Vignetted corners, and the note on the pupil."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration import pupil_estimate
from mirrorcam.optics.calibration.detection.border_light import Border, BorderLight, borders
from mirrorcam.optics.calibration.pupil_estimate import (
    INVERSE_FOCUS_SIGMA,
    MARGIN_PX,
    BoardPictures,
    PupilFit,
    estimated_pupil,
    fit_pupil,
    unvignetted,
)
from mirrorcam.optics.calibration.solver.observations import DIRECT, Observations
from mirrorcam.optics.geometry.boards import default_board
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror import Mirror
from mirrorcam.optics.geometry.pupil import PINHOLE, Pupil
from mirrorcam.render_scenes.sets.sensor_model import srgb
from tests.nightly import a_few

PUPIL = Pupil(1.8, 500.0)
RAYS = 250
NOISE = 2.0  # grey levels, of 90


def with_pupil(layout: Layout, pupil: Pupil) -> Layout:
    return layout.replaced(camera=layout.camera.with_pupil(pupil))


def grid_of(layout: Layout, index: int) -> Observations:
    """Corners every 7 px in a sub-image, as frame 0."""
    low, high = layout.outline_px(index).min(axis=0), layout.outline_px(index).max(axis=0)
    x, y = np.meshgrid(np.arange(low[0], high[0], 7.0), np.arange(low[1], high[1], 7.0))
    pixels = np.column_stack([x.ravel(), y.ravel()])
    shown = traced(layout.mirrors[index], layout.camera.normalized_from_pixels(pixels), Pupil(0.0, 500.0)) > 0.0
    return Observations.of_view(0, index, np.arange(int(shown.sum())), pixels[shown])


def encoded(light: BorderLight) -> BorderLight:
    """Return the light as the grey levels of sRGB show it."""
    white, black = (255.0 * srgb(np.maximum(light.level + sign * light.light, 0.0) / 255.0) for sign in (1.0, -1.0))
    return BorderLight(light.border, (white - black) / 2.0, light.sigma, (white + black) / 2.0)


@pytest.mark.slow
def test_edges_agree_about_the_pupil_only_in_linear_light(fold_90_layout: Layout) -> None:
    random, layout = np.random.default_rng(8), with_pupil(fold_90_layout, PUPIL)
    linear = [light(fold_90_layout, border, PUPIL, random) for border in borders(fold_90_layout)]
    in_srgb = [encoded(each) for each in linear]
    for right, wrong in (([each.from_srgb() for each in in_srgb], in_srgb), (linear, [e.from_srgb() for e in linear])):
        found, other = fit_pupil(layout, right), fit_pupil(layout, wrong)
        assert found is not None
        assert found.aperture_mm == pytest.approx(PUPIL.aperture_mm, abs=0.2)
        assert other is None or found.relative_sigma < other.relative_sigma


def test_every_remaining_corner_is_unvignetted_with_a_margin(default_layout: Layout) -> None:
    layout = with_pupil(default_layout, PUPIL)
    corners = grid_of(layout, 4)
    kept, notes = unvignetted(layout, corners)
    left_out = int((~kept).sum())
    assert notes == (f"{left_out} of {len(corners)} corners left out: vignetted, near mirrors' edges",)
    mirror, camera = layout.mirrors[4], layout.camera
    around = 0.9 * MARGIN_PX * np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
    served = [traced(mirror, camera.normalized_from_pixels(corners.pixels + step), PUPIL) for step in around]
    assert np.min(served, axis=0)[kept].min() == 1.0
    farther = [traced(mirror, camera.normalized_from_pixels(corners.pixels + 2.0 * step), PUPIL) for step in around]
    assert np.min(farther, axis=0)[~kept].max() < 1.0
    assert 0.5 < kept.mean() < 0.95


def test_no_corner_of_a_pinhole_or_the_bare_camera_is_left_out(default_layout: Layout) -> None:
    corners = grid_of(default_layout, 0)
    kept, notes = unvignetted(with_pupil(default_layout, PINHOLE), corners)
    assert kept.all()
    assert notes == ()
    direct = Observations.of_view(0, DIRECT, corners.corner, corners.pixels)
    assert unvignetted(with_pupil(default_layout, PUPIL), direct)[0].all()


def test_a_mostly_vignetted_mirror_keeps_its_corners(default_layout: Layout) -> None:
    layout = with_pupil(default_layout, Pupil(40.0, 500.0))
    kept, notes = unvignetted(layout, grid_of(layout, 4))
    assert kept.all()
    assert notes == ("mirror 1-1: hardly any corner is unvignetted, so all are used",)


def test_a_frame_keeps_its_corners_where_few_would_be_left(default_layout: Layout) -> None:
    layout = with_pupil(default_layout, PUPIL)
    corners = grid_of(layout, 4)
    kept, _ = unvignetted(layout, corners)
    edge = np.flatnonzero(~kept)[:8]
    alone = Observations.of_view(1, 4, corners.corner[edge], corners.pixels[edge])
    both, _ = unvignetted(layout, Observations.join([corners, alone]))
    assert (both[: len(kept)] == kept).all()
    assert both[len(kept) :].all()


@pytest.mark.parametrize(
    ("seen", "expected", "words"),
    [
        (None, (1.8, 500.0), "show the blur of too few mirror edges to estimate the pupil: 1.8 mm wide"),
        (PupilFit(0.01, 0.02, 0.002, 0.002, 20), (0.0, 500.0), "0.10 ± 0.07 mm wide, by the blur of 20 mirror edges"),
        (PupilFit(4.0, 0.2, 0.001, 0.002, 20), (2.0, 500.0), "do not determine the distance in focus"),
        (PupilFit(4.0, 0.2, 0.001, 0.0003, 20), (2.0, 1000.0), "in focus at 1000 mm (1.00 ± 0.30 per metre)"),
    ],
)
def test_undetermined_values_of_the_pupil_are_kept(
    default_layout: Layout,
    monkeypatch: pytest.MonkeyPatch,
    seen: PupilFit | None,
    expected: tuple[float, float],
    words: str,
) -> None:
    monkeypatch.setattr(pupil_estimate, "border_light", lambda layout, frames, board: [])
    monkeypatch.setattr(pupil_estimate, "fit_pupil", lambda layout, lights: seen)
    found = estimated_pupil(with_pupil(default_layout, PUPIL), [], default_board())
    assert (found.camera.aperture_mm, found.camera.focus_mm) == pytest.approx(expected)
    assert words in found.note
    assert ("aperture_sigma_mm" in found.metrics) == (seen is not None)
    assert ("focus_mm" in found.metrics) == (seen is not None and seen.inverse_focus_sigma < INVERSE_FOCUS_SIGMA / 4.0)


def test_unavailable_pictures_are_skipped() -> None:
    grey = np.zeros((4, 4), np.uint8)
    pictures = BoardPictures([None, grey, grey], default_board())
    poses = np.stack([np.eye(4), 2.0 * np.eye(4)])
    with_poses = pictures.with_poses([0, 2], poses)
    assert [frame.rig_from_board[0, 0] for frame in with_poses] == [2.0]


def places(pupil: Pupil) -> FloatArray:
    """Points (n, 2) spread evenly over a pupil, mm."""
    number = np.arange(RAYS)
    radius, angle = np.sqrt((number + 0.5) / RAYS), np.pi * (3.0 - np.sqrt(5.0)) * number
    return pupil.radius_mm * np.column_stack([radius * np.cos(angle), radius * np.sin(angle)])


def traced(mirror: Mirror, normalized: FloatArray, pupil: Pupil) -> FloatArray:
    """Return the part (n,) of the pupil's rays, in focus, that meet a mirror within its outline."""
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
    """Return the light across a border, with noise; it fades along the border by a tenth."""
    shape = border.pixels.shape[:2]
    normalized = border.normalized(layout).reshape(-1, 2)
    served = traced(layout.mirrors[border.mirror], np.nan_to_num(normalized), pupil).reshape(shape)
    fading = np.linspace(1.0, 0.9, shape[0])[:, None]
    shown = 90.0 * fading * served + random.normal(0.0, NOISE, shape)
    on_sensor = np.isfinite(normalized).all(axis=1).reshape(shape)
    shown, level = (np.where(on_sensor, each, np.nan) for each in (shown, 110.0 * fading * served))
    return BorderLight(border, shown, np.where(on_sensor, NOISE, np.inf), level)


def found(layout: Layout, pupil: Pupil, seed: int, assumed: Pupil) -> PupilFit:
    random = np.random.default_rng(seed)
    given = layout.replaced(camera=layout.camera.with_pupil(assumed))
    seen = fit_pupil(given, [light(layout, border, pupil, random) for border in borders(given)])
    assert seen is not None
    return seen


@pytest.mark.parametrize(
    ("true", "seed"), a_few(1, [(Pupil(1.8, 500.0), 1), (Pupil(2.4, 900.0), 2), (Pupil(1.2, 300.0), 3)])
)
def test_diameter_and_focus_are_found_within_their_uncertainty(fold_90_layout: Layout, true: Pupil, seed: int) -> None:
    seen = found(fold_90_layout, true, seed, Pupil(1.8, 500.0))
    assert abs(seen.aperture_mm - true.aperture_mm) < 2.5 * seen.aperture_sigma_mm
    assert abs(seen.inverse_focus - 1.0 / true.focus_mm) < 2.5 * seen.inverse_focus_sigma
    assert seen.aperture_sigma_mm < 0.04 * true.aperture_mm
    assert seen.shows_focus
    assert not seen.is_pinhole


def test_a_pinhole_is_recognised_and_its_focus_left_undetermined(fold_90_layout: Layout) -> None:
    seen = found(fold_90_layout, Pupil(0.0, 500.0), 4, Pupil(1.8, 500.0))
    assert seen.is_pinhole
    assert not seen.shows_focus
    assert seen.aperture_mm < 0.15
    assert 0.0 < seen.aperture_sigma_mm < 0.15
    assert seen.inverse_focus_sigma > 0.9 * INVERSE_FOCUS_SIGMA


def test_few_or_dim_borders_determine_nothing(fold_90_layout: Layout) -> None:
    random = np.random.default_rng(5)
    lights = [light(fold_90_layout, border, Pupil(1.8, 500.0), random) for border in borders(fold_90_layout)[:4]]
    assert fit_pupil(fold_90_layout, lights) is None
    dim = [BorderLight(each.border, 0.02 * each.light, each.sigma, each.level) for each in lights] * 3
    assert fit_pupil(fold_90_layout, dim) is None


@pytest.mark.slow
def test_a_border_that_shows_something_else_is_left_out(fold_90_layout: Layout) -> None:
    random, true = np.random.default_rng(6), Pupil(1.8, 500.0)
    lights = [light(fold_90_layout, border, true, random) for border in borders(fold_90_layout)]
    clean = fit_pupil(fold_90_layout, lights)
    wide = light(fold_90_layout, lights[4].border, Pupil(4.0, 500.0), random)
    spoilt = fit_pupil(fold_90_layout, [*lights[:4], wide, *lights[5:]])
    assert clean is not None
    assert spoilt is not None
    assert spoilt.borders == clean.borders - 1
    assert spoilt.aperture_mm == pytest.approx(clean.aperture_mm, abs=clean.aperture_sigma_mm)
