"""Features of closed-form scenes: they lie on surfaces, within their uncertainties."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.light_field.features import DetectorName, FeatureDetector, FeatureFinder, Features
from mirrorcam.optics.light_field.features.light_field_features import _one_per_pixel
from mirrorcam.optics.light_field.light_field import Axis, LightField, Views
from tests.nightly import a_few
from tests.optics.light_field.features.scenes import Plane, astigmatic, of_grey, of_planes, uneven_views
from tests.optics.light_field.features.test_keypoints import NAMES

WALL: Plane = (560.0, (0.1, -0.2), None, 1)
BOARD: Plane = (430.0, (0.6, 0.2), (-30.0, -60.0, 55.0, 25.0), 2)


@pytest.fixture(scope="module")
def scene() -> tuple[LightField, FloatArray]:
    """A slanted board before a wall, with the noise of a camera, and true depths (v, u)."""
    return of_planes(uneven_views(), [WALL, BOARD], noise_grey=1.5)


@pytest.fixture(scope="module")
def found(scene: tuple[LightField, FloatArray]) -> Features:
    return FeatureFinder(scene[0], "ORB").find(scene[0])


def true_at(features: Features, depth_mm: FloatArray) -> FloatArray:
    """Return the true depth nearest to each feature's, from the 3x3 pixels around it."""
    u, v = np.rint(features.pixels).astype(int).T
    near = np.array([depth_mm[v + down, u + across] for down in (-1, 0, 1) for across in (-1, 0, 1)])
    best = np.abs(near - features.depth_mm).argmin(axis=0)
    return near[best, np.arange(len(features))]


@pytest.mark.parametrize("name", NAMES)
def test_features_lie_on_surfaces(scene: tuple[LightField, FloatArray], name: DetectorName) -> None:
    light_field, depth_mm = scene
    features = FeatureFinder(light_field, name).find(light_field)
    assert features.detector == name
    assert len(features) > 120
    error = np.abs(features.depth_mm / true_at(features, depth_mm) - 1.0)
    assert np.mean(error < 0.01) >= 0.98
    assert np.median(error) < 0.001
    assert np.mean(features.refracted) < 0.005
    sides = [np.mean(np.abs(features.depth_mm - depth) < 60) for depth in (350.0, 480.0)]
    assert min(sides) > 0.1  # both planes have features


def test_the_values_of_a_feature_are_consistent(scene: tuple[LightField, FloatArray], found: Features) -> None:
    light_field = scene[0]
    exact = np.moveaxis(light_field.project(found.points_in_rig_mm), 2, 0)
    assert np.allclose(exact[:, 1, 1], found.pixels, atol=1e-9)
    assert np.allclose(found.points_in_rig_mm @ light_field.view_from_rig[2], found.depth_mm)
    assert np.allclose(light_field.disparity_px_from_depth(found.depth_mm), found.disparity_px)
    distance = np.linalg.norm(found.seen_px - exact, axis=-1)
    assert (np.isfinite(found.seen_px).all(axis=-1) == found.seen).all()
    assert np.nanmax(distance) <= 0.5 + 1e-6
    assert np.allclose(np.sqrt(np.nanmean(distance**2, axis=(1, 2))), found.residual_px, rtol=1e-3)
    assert found.seen[:, 1, 1].all()
    assert found.seen.sum(axis=(1, 2)).min() >= 6
    assert len(np.unique(found.pixels, axis=0)) == len(found)
    pair = np.abs(found.apart_disparity_px - found.disparity_px[:, None])
    assert np.median(pair) < 3 * np.median(found.disparity_sigma_px)


def test_errors_match_their_uncertainties(scene: tuple[LightField, FloatArray], found: Features) -> None:
    light_field, _ = scene
    on_board = np.abs(found.depth_mm - 350) < 60
    places = (found.points_in_rig_mm - light_field.reference_view_in_rig_mm) @ light_field.view_from_rig.T
    # Along their rays, from where these meet their plane.
    errors = []
    for (distance, slants, _, _), chosen in ((BOARD, on_board), (WALL, ~on_board)):
        normal = np.array([-slants[0], -slants[1], 1.0])
        ways = places[chosen] / places[chosen, 2:]
        errors.append((places[chosen, 2] - distance / (ways @ normal)) / found.depth_sigma_mm[chosen])
    off = np.abs(np.concatenate(errors))
    inner = off < 10  # the board's outline is on neither plane
    assert inner.mean() > 0.97
    assert 0.3 < np.median(off) < 1.0
    assert np.mean(off[inner] < 2) > 0.9
    ratio = found.disparity_sigma_px * (found.depth_mm + 80) ** 2 / (800.0 * light_field.step_mm())
    assert np.allclose(ratio, found.depth_sigma_mm)


def test_occluded_views_are_not_counted(scene: tuple[LightField, FloatArray]) -> None:
    """Features of the wall that the board hides from a view."""
    light_field = scene[0]
    found = FeatureFinder(light_field).find(light_field)
    wall = found.depth_mm > 420
    pixels = np.moveaxis(light_field.project(found.points_in_rig_mm), 2, 0)
    corners = np.array([[-30.0, -60.0], [55.0, -60.0], [55.0, 25.0], [-30.0, 25.0]])
    points = np.c_[corners, 430.0 + corners @ BOARD[1]]
    outline = light_field.project_in_view(points)
    low, high = outline.min(axis=2), outline.max(axis=2)
    left, top = np.sort(outline[..., 0], axis=2)[..., 1] + 4, np.sort(outline[..., 1], axis=2)[..., 1] + 4
    right, bottom = np.sort(outline[..., 0], axis=2)[..., 2] - 4, np.sort(outline[..., 1], axis=2)[..., 2] - 4
    hidden = (pixels[..., 0] > left) & (pixels[..., 0] < right) & (pixels[..., 1] > top) & (pixels[..., 1] < bottom)
    assert (low < high).all()
    assert hidden[wall].sum() > 10
    assert found.seen[wall][hidden[wall]].mean() < 0.03
    outside = (pixels < 4).any(axis=-1) | (pixels > [255, 175]).any(axis=-1)
    assert outside.sum() > 100
    assert not found.seen[outside].any()


def test_the_same_light_field_has_the_same_features(scene: tuple[LightField, FloatArray], found: Features) -> None:
    finder = FeatureFinder(scene[0], "ORB")
    for features in (finder.find(scene[0]), finder.find(scene[0])):
        for field in fields(Features):
            one, other = getattr(features, field.name), getattr(found, field.name)
            assert np.array_equal(one, other, equal_nan=np.asarray(one).dtype.kind == "f")


def test_views_assumed_on_an_even_grid_find_few_features(scene: tuple[LightField, FloatArray], found: Features) -> None:
    light_field = scene[0]
    even = np.zeros((3, 3, 3))
    even[..., 0], even[..., 1] = [-35.0, 0.0, 35.0], [[-25.0], [0.0], [25.0]]
    moved = LightField.of(uneven_views(positions_mm=even), light_field.samples, light_field.weights)
    features = FeatureFinder(moved, "ORB").find(moved)
    assert len(features) < 0.35 * len(found)


def test_more_views_or_a_shorter_distance_give_fewer_and_more_certain_features(
    scene: tuple[LightField, FloatArray], found: Features
) -> None:
    light_field = scene[0]
    everywhere = FeatureFinder(light_field, "ORB", min_views=8).find(light_field)
    assert 20 < len(everywhere) < len(found)
    assert everywhere.seen.all()
    strict = FeatureFinder(light_field, "ORB", max_distance_px=0.1).find(light_field)
    assert 20 < len(strict) < len(found)
    assert np.median(strict.residual_px) < np.median(found.residual_px)


def test_features_are_sought_between_the_given_depths(scene: tuple[LightField, FloatArray]) -> None:
    light_field = scene[0]
    near = FeatureFinder(light_field, "ORB", nearest_mm=250.0, farthest_mm=420.0).find(light_field)
    assert len(near) > 20
    assert near.depth_mm.max() < 420


@pytest.mark.parametrize("turn_deg", a_few(1, [0.0, 45.0, 80.0]))
def test_two_slopes_along_any_directions_are_flagged(turn_deg: float) -> None:
    views = uneven_views(positions_mm=uneven_views().positions_mm * [1.0, 1.0, 0.0])
    turn = np.deg2rad(turn_deg)
    axes = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    shares = []
    for apart in (0.0, 2e-5):
        light_field = astigmatic(views, axes @ np.diag([1 / 450.0 + apart, 1 / 450.0 - apart]) @ axes.T)
        features = FeatureFinder(light_field, "ORB", max_distance_px=1.5).find(light_field)
        assert len(features) > 50
        shares.append(np.mean(features.refracted))
        assert np.median(features.depth_mm) == pytest.approx(370.0, rel=0.01)
    assert shares[0] < 0.03
    assert shares[1] > 0.95


def test_two_slopes_have_the_right_size_and_sign() -> None:
    views = uneven_views(positions_mm=uneven_views().positions_mm * [1.0, 1.0, 0.0])
    light_field = astigmatic(views, np.diag([1 / 440.0, 1 / 460.0]))
    features = FeatureFinder(light_field, "ORB", max_distance_px=1.5).find(light_field)
    expected = views.disparity_px_from_depth(np.array([440.0, 460.0]) - 80.0)
    assert np.allclose(np.median(features.apart_disparity_px, axis=0), expected, atol=0.03)


@pytest.mark.parametrize("name", [pytest.param("SIFT4D", marks=pytest.mark.slow), "AKAZE"])
def test_a_repeating_pattern_gives_no_wrong_depth(name: FeatureDetector) -> None:
    """With a regular grid of views and a periodic pattern, several depths look alike; none is guessed."""
    positions = np.zeros((3, 3, 3))
    positions[..., 0], positions[..., 1] = [-30.0, 0.0, 30.0], [[-30.0], [0.0], [30.0]]
    views = uneven_views(positions_mm=positions)
    u, v = views.pixel_grid().transpose(2, 0, 1)
    grey = np.zeros((3, 3, 180, 260))
    random = np.random.default_rng(0)
    cell = gaussian_filter(random.standard_normal((16, 16)), 1.2, mode="wrap")
    cell *= 40 / cell.std()
    for t, s in np.ndindex(3, 3):
        # Moves by 5 px from view to view; by 16 px more it looks the same.
        across, down = np.int64(u + 5 * (s - 1)) % 16, np.int64(v + 5 * (t - 1)) % 16
        grey[t, s] = 128 + cell[down, across]
    light_field = of_grey(views, grey)
    features = FeatureFinder(light_field, name).find(light_field)
    step_px = 800.0 * 30.0 / (features.depth_mm + 80) - 800.0 * 30.0 / views.reference_distance_mm
    wrong = np.abs(step_px - 5.0) > 1
    assert wrong.sum() <= 2


@pytest.mark.parametrize("shape", [(1, 2), (1, 3), (3, 1), (2, 2), (2, 4)])
def test_any_grid_of_views_has_features(shape: tuple[int, int]) -> None:
    views = uneven_views(*shape)
    light_field, depth_mm = of_planes(views, [(450.0, (0.2, 0.3), None, 3)])
    features = FeatureFinder(light_field, "ORB").find(light_field)
    assert len(features) > 50
    assert np.mean(np.abs(features.depth_mm / true_at(features, depth_mm) - 1) < 0.01) > 0.95
    assert features.seen.shape == (len(features), *shape)
    if min(shape) == 1:
        assert np.mean(features.refracted) < 0.03
        axis: Axis = "s" if shape[1] > 1 else "t"
        expected = light_field.disparity_px_from_depth(features.depth_mm, axis)
        assert np.allclose(features.disparity_px, expected)


def test_a_blank_light_field_has_no_features() -> None:
    views = uneven_views()
    shape = (3, 3, 180, 260)
    for weight in (0.0, 1.0):
        samples = np.full((*shape, 1), 80 * int(weight), np.uint8)
        blank = LightField.of(views, samples, np.full(shape, weight, np.float32))
        names: tuple[FeatureDetector, ...] = ("SIFT4D", "ORB")
        for name in names:
            features = FeatureFinder(views, name).find(blank)
            assert len(features) == 0
            assert features.seen_px.shape == (0, 3, 3, 2)
            assert features.points_in_rig_mm.shape == (0, 3)


def test_identical_views_show_the_reference_plane() -> None:
    """On it disparity is zero for any positions; nothing differs, but no uncertainty is zero."""
    views = uneven_views(positions_mm=uneven_views().positions_mm * [1.0, 1.0, 0.0])
    one = of_planes(views, [(460.0, (0.0, 0.0), None, 1)])[0].samples[1, 1]
    samples = np.broadcast_to(one, (3, 3, *one.shape)).copy()
    features = FeatureFinder(views, "ORB").find(LightField.of(views, samples, np.ones((3, 3, 180, 260), np.float32)))
    assert len(features) > 100
    assert np.abs(features.depth_mm - 380.0).max() < 0.5
    assert (features.depth_sigma_mm > 0).all()
    assert not features.refracted.any()


def test_light_fields_of_other_views_are_refused(scene: tuple[LightField, FloatArray]) -> None:
    for changes in (
        {"layout_identity": "f" * 16},
        {"positions_mm": uneven_views().positions_mm * 1.001},
        {"focal_px": 801.0},
    ):
        finder = FeatureFinder(uneven_views(**changes), "ORB")
        with pytest.raises(InputError, match="differs in its views from layout"):
            finder.find(scene[0])


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"min_views": 0}, "minimum number of views is 0 besides the reference view, expected 1 to 8"),
        ({"min_views": 9}, "minimum number of views is 9 besides the reference view, expected 1 to 8"),
        ({"max_distance_px": 0.0}, "maximum distance is 0 px, expected a positive number"),
        ({"max_distance_px": np.nan}, "maximum distance is nan px"),
        ({"nearest_mm": 500.0, "farthest_mm": 400.0}, "depths 500 to 400 mm: the nearer one must come first"),
        ({"nearest_mm": -81.0}, "depths -81 to inf mm: the nearer one must come first and be in front of all views"),
        ({"nearest_mm": np.nan}, "depths nan to inf mm"),
        ({"keypoints": 0}, "maximum number of keypoints is 0"),
        ({"two_slope_sigma": -1.0}, "difference of two slopes is -1 standard deviations"),
    ],
)
def test_invalid_requests_are_refused_in_one_line(options: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message) as caught:
        FeatureFinder(uneven_views(), "ORB", **options)
    assert "\n" not in str(caught.value)


def test_one_view_has_no_features() -> None:
    with pytest.raises(InputError, match="light field has one view, expected at least two views for features"):
        FeatureFinder(uneven_views(1, 1), "ORB")


def test_keypoints_at_one_pixel_are_one_feature_or_none() -> None:
    pixels = np.array([[5.0, 5.0], [7.0, 5.0], [5.0, 5.0], [7.0, 5.0], [9.0, 9.0]])
    chosen = _one_per_pixel(pixels, np.array([6, 9, 8, 6, 6]), np.array([10.0, 20.0, 10.4, 25.0, 3.0]), 1.0)
    assert chosen.tolist() == [False, False, True, False, True]
    assert _one_per_pixel(np.zeros((0, 2)), np.zeros(0, int), np.zeros(0), 1.0).shape == (0,)


def test_the_reference_is_the_view_at_the_origin() -> None:
    views: Views = uneven_views(2, 4)
    assert FeatureFinder(views, "ORB").geometry.reference == 1 * 4 + 2
