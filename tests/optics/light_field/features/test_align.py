"""Alignment against pictures moved and slanted by known amounts."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from numpy.typing import NDArray

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.light_field.features import align as alignment
from mirrorcam.optics.light_field.features.align import AlignedPatches, align
from mirrorcam.optics.light_field.features.keypoints import grey_views
from mirrorcam.optics.light_field.features.patches import WIDE, ImagePyramid, templates
from mirrorcam.optics.light_field.features.slope import ViewGeometry
from mirrorcam.optics.light_field.light_field import LightField
from tests.optics.light_field.features.scenes import of_planes, uneven_views

PIXELS = np.stack(np.meshgrid(np.arange(40.0, 221.0, 9.0), np.arange(40.0, 141.0, 9.0)), axis=-1).reshape(-1, 2)
Bytes = NDArray[np.uint8]


def grey(light_field: LightField) -> Bytes:
    images = grey_views(light_field)
    return images.reshape(light_field.rows, light_field.cols, *images.shape[1:])


def true_pixels(light_field: LightField, depth_mm: FloatArray, pixels: FloatArray) -> FloatArray:
    """Return the pixels (views, n, 2) of points that the central view shows at pixels, with known depths (n,)."""
    distance = depth_mm - light_field.reference_depth_mm + light_field.reference_distance_mm
    across = (pixels - light_field.centre_px) / light_field.focal_px * distance[:, None]
    points = np.concatenate([across, distance[:, None]], axis=1)
    return light_field.project_in_view(points).reshape(-1, len(pixels), 2)


def aligned(light_field: LightField, start_px: FloatArray, images: Bytes | None = None) -> AlignedPatches:
    pyramid = ImagePyramid(grey(light_field) if images is None else images)
    given = templates(pyramid, 4, PIXELS, np.ones(len(PIXELS)), WIDE)
    across = light_field.positions_mm.reshape(-1, 3)[:, :2]
    return align(pyramid, given, np.arange(9), start_px, across, np.full(len(PIXELS), 450.0))


def depths_at(true_mm: FloatArray) -> FloatArray:
    u, v = PIXELS.astype(int).T
    return true_mm[v, u]


@pytest.fixture(scope="module")
def facing() -> tuple[LightField, FloatArray]:
    """Return a plane that faces the views, and the pixels of its points at PIXELS in all views."""
    light_field, true_mm = of_planes(uneven_views(), [(430.0, (0.0, 0.0), None, 1)])
    return light_field, true_pixels(light_field, depths_at(true_mm), PIXELS)


@pytest.fixture(scope="module")
def slanted() -> tuple[LightField, FloatArray]:
    """A plane slanted by 50 and 35 degrees."""
    light_field, true_mm = of_planes(uneven_views(), [(450.0, (1.2, -0.7), None, 1)])
    return light_field, true_pixels(light_field, depths_at(true_mm), PIXELS)


def errors_px(light_field: LightField, expected: FloatArray, off_px: float = 1.2) -> FloatArray:
    random = np.random.default_rng(2)
    start = expected + random.uniform(-off_px, off_px, expected.shape)
    inside = (expected > 12).all(axis=2) & (expected < [247, 167]).all(axis=2)
    start[~inside] = np.nan
    found = aligned(light_field, start)
    accepted = np.isfinite(found.pixels[..., 0]) & (found.correlation > 0.85)
    assert accepted.sum() > 0.9 * inside.sum()
    return np.linalg.norm(found.pixels - expected, axis=2)[accepted]


def test_patches_are_found_to_hundredths_of_a_pixel(facing: tuple[LightField, FloatArray]) -> None:
    error = errors_px(*facing)
    assert np.median(error) < 0.02
    assert np.percentile(error, 95) < 0.06


def test_slant_is_found_with_the_shift(slanted: tuple[LightField, FloatArray], monkeypatch: pytest.MonkeyPatch) -> None:
    error = np.percentile(errors_px(*slanted), 75)
    monkeypatch.setattr(alignment, "SHAPE_ROUNDS", 0)
    monkeypatch.setattr(alignment, "SHIFT_ROUNDS", 5)
    plain = np.percentile(errors_px(*slanted), 75)
    assert error < 0.06
    assert plain > 2 * error


def test_brightness_and_contrast_of_views_do_not_matter(facing: tuple[LightField, FloatArray]) -> None:
    light_field, expected = facing
    images, start = grey(light_field), expected + 0.5
    straight = aligned(light_field, start, images)
    images[0] = np.rint(0.6 * images[0] + 20)
    dimmed = aligned(light_field, start, images)
    usual = straight.correlation > 0.9
    assert np.median(np.abs(straight.pixels - dimmed.pixels)[usual]) < 0.01
    assert dimmed.correlation[usual].min() > 0.85


def test_unrelated_patches_do_not_match(facing: tuple[LightField, FloatArray]) -> None:
    light_field, expected = facing
    found = aligned(light_field, expected + np.array([25.0, 10.0]))
    others = [view for view in range(9) if view != 4]
    assert np.mean(found.correlation[others] > 0.85) < 0.05
    assert np.mean(aligned(light_field, expected).correlation[others] > 0.85) > 0.8


def test_excluded_pixels_have_no_matches(facing: tuple[LightField, FloatArray]) -> None:
    light_field, expected = facing
    start = expected.copy()
    start[3, :7] = np.nan
    found = aligned(light_field, start)
    assert np.isnan(found.pixels[3, :7]).all()
    assert (found.correlation[3, :7] == 0).all()


def test_coarse_keypoints_are_aligned_at_their_scale(facing: tuple[LightField, FloatArray]) -> None:
    light_field, expected = facing
    pyramid = ImagePyramid(grey(light_field))
    given = templates(pyramid, 4, PIXELS, np.full(len(PIXELS), 4.0), WIDE)
    assert [each.level for each in given] == [1]
    across = light_field.positions_mm.reshape(-1, 3)[:, :2]
    found = align(pyramid, given, np.arange(9), expected + 2.0, across, np.full(len(PIXELS), 450.0))
    accepted = found.correlation > 0.9
    assert np.median(np.linalg.norm(found.pixels - expected, axis=2)[accepted]) < 0.05


def test_views_and_parts_do_not_depend_on_each_other(
    facing: tuple[LightField, FloatArray], monkeypatch: pytest.MonkeyPatch
) -> None:
    light_field, expected = facing
    complete = aligned(light_field, expected + 0.5)
    monkeypatch.setattr(alignment, "KEYPOINTS_PER_BATCH", 7)
    assert np.allclose(aligned(light_field, expected + 0.5).pixels, complete.pixels, rtol=0, atol=1e-3)
    pyramid, views = ImagePyramid(grey(light_field)), np.array([8, 2])
    given = templates(pyramid, 4, PIXELS, np.ones(len(PIXELS)), WIDE)
    across = light_field.positions_mm.reshape(-1, 3)[views, :2]
    with ThreadPoolExecutor(2) as pool:
        two = align(pyramid, given, views, expected[views] + 0.5, across, np.full(len(PIXELS), 450.0), pool.map)
    usual = (complete.correlation[views] > 0.95) & (two.correlation > 0.95)
    assert usual.mean() > 0.5
    assert np.median(np.linalg.norm(two.pixels - complete.pixels[views], axis=2)[usual]) < 0.01


@pytest.mark.parametrize("slants", [(0.0, 0.0), (1.0, -0.6)])
def test_slants_match_the_plane(slants: tuple[float, float]) -> None:
    """w = (1 - slants.a) / d of a plane Z = d + slants.(X, Y)."""
    views, distance = uneven_views(), 450.0
    light_field, _ = of_planes(views, [(distance, slants, None, 1)])
    images = grey_views(light_field)
    geometry, pyramid = ViewGeometry.of(views), ImagePyramid(images.reshape(3, 3, *images.shape[1:]))
    pixels = np.stack(np.meshgrid(np.arange(90.0, 171.0, 8.0), np.arange(60.0, 121.0, 8.0)), axis=-1).reshape(-1, 2)
    directions = geometry.directions(pixels)
    inverse_distance = (1.0 - directions @ np.array(slants)) / distance
    start = np.stack([geometry.predict(view, directions, inverse_distance) for view in range(9)])
    given = templates(pyramid, 4, pixels, np.full(len(pixels), 2.0), WIDE)
    found = align(pyramid, given, np.arange(9), start, geometry.lateral_mm, 1.0 / inverse_distance)
    chosen = given[0].index
    error = found.shapes[chosen, :2] * distance + slants
    assert np.median(np.abs(error)) < 0.12
    # Nothing is curved, and residuals across epipolar lines are small.
    assert np.median(np.abs(found.shapes[chosen, 2:])) * distance < 0.12
    assert np.median(found.variance[chosen]) < 1e-3
    assert (np.linalg.eigvalsh(found.shape_covariance[chosen]) > -1e-12).all()
