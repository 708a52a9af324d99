"""Laws of the seeds: defining properties of paraboloids, ellipsoids and tilings."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from numpy.testing import assert_allclose
from shapely import Polygon

from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.design.program.seeds import (
    corner_pattern,
    ellipsoid_centres,
    faceted_parabola,
    layout_of,
    mirrors_of,
    parabola_centres,
    seed_of,
    sensor_rectangle,
    tile_positions,
    tiles,
)
from mirrorcam.optics.geometry.arrangement import Arrangement, Pattern
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.design_spec import DesignSpec, InfeasibleDesign
from mirrorcam.optics.geometry.layout import FOLD_90_VIEW_FROM_RIG
from mirrorcam.optics.geometry.mirror import reflect
from mirrorcam.optics.geometry.mirror_gaps import smallest_gap_mm

SIZES = [(1, 2), (2, 2), (3, 3), (2, 4), (4, 1)]
BENT = Camera.c920().replaced(distortion=[0.08, -0.15, 0.001, -0.002, 0.02])


FOLDS = [90.0, 120.0]
Z = np.array([0.0, 0.0, 1.0])


def chief_points() -> FloatArray:
    u, v = np.meshgrid(np.linspace(-0.6, 0.6, 5), np.linspace(-0.4, 0.4, 4))
    return np.stack([u, v], axis=-1)


def view_from_rig(fold_deg: float) -> FloatArray:
    return DesignSpec(fold_deg=fold_deg).view_from_rig


def rays_in_view(chief: FloatArray, turned: FloatArray) -> FloatArray:
    return np.concatenate([chief, np.ones((*chief.shape[:-1], 1))], axis=-1) @ turned.T


def where_chief_rays_meet(centres: FloatArray, rays: FloatArray) -> FloatArray:
    """Points (..., 3) of rays from the pupil on the planes that bisect pupil and virtual centres."""
    return rays * (0.5 * np.sum(centres**2, -1, keepdims=True) / np.sum(rays * centres, -1, keepdims=True))


@pytest.mark.parametrize("fold_deg", [60.0, 90.0, 105.0, 150.0])
def test_the_fold_turns_the_optical_axis_by_its_angle(fold_deg: float) -> None:
    turned, fold = view_from_rig(fold_deg), np.radians(fold_deg)
    assert_allclose(turned @ turned.T, np.eye(3), atol=1e-15)
    assert np.linalg.det(turned) == pytest.approx(1.0)
    assert_allclose(turned[2], [0.0, np.sin(fold), np.cos(fold)], atol=1e-15)
    assert_allclose(turned[0], [1.0, 0.0, 0.0])


def test_the_right_angle_is_exactly_that_of_the_layouts() -> None:
    assert (view_from_rig(90.0) == np.array(FOLD_90_VIEW_FROM_RIG)).all()


@pytest.mark.parametrize("fold_deg", FOLDS)
def test_parabola_sends_chief_rays_parallel_to_the_view_axis(fold_deg: float) -> None:
    chief, turned = chief_points(), view_from_rig(fold_deg)
    centres = parabola_centres(chief, 80.0, turned)
    leaving = where_chief_rays_meet(centres, rays_in_view(chief, turned)) - centres
    assert_allclose(
        leaving / np.linalg.norm(leaving, axis=-1, keepdims=True), np.broadcast_to(Z, centres.shape), atol=1e-14
    )
    # All centres lie in the directrix plane, normal to the view axis.
    assert_allclose(centres[..., 2], -80.0 * (1.0 - np.cos(np.radians(fold_deg))))


@pytest.mark.parametrize("fold_deg", FOLDS)
def test_parabola_facets_are_tangent_to_one_paraboloid(fold_deg: float) -> None:
    chief, turned = chief_points(), view_from_rig(fold_deg)
    points = where_chief_rays_meet(parabola_centres(chief, 80.0, turned), rays_in_view(chief, turned))
    # Points are equally far from the focus at the origin and from the directrix plane.
    directrix = -80.0 * (1.0 - np.cos(np.radians(fold_deg)))
    assert_allclose(np.linalg.norm(points, axis=-1), points[..., 2] - directrix)


@pytest.mark.parametrize("fold_deg", FOLDS)
def test_ellipsoid_sends_chief_rays_through_its_target(fold_deg: float) -> None:
    chief, turned = chief_points(), view_from_rig(fold_deg)
    meets_mirror = 80.0 * turned[:, 2]
    target = np.array([*meets_mirror[:2], 375.0])
    centres = ellipsoid_centres(chief, 80.0, 375.0, turned)
    points = where_chief_rays_meet(centres, rays_in_view(chief, turned))
    total = 80.0 + np.linalg.norm(target - meets_mirror)
    assert_allclose(np.linalg.norm(points, axis=-1) + np.linalg.norm(points - target, axis=-1), total)
    assert_allclose(np.linalg.norm(np.cross(points - centres, target - centres), axis=-1), 0.0, atol=1e-9)
    # Chief rays leave from their virtual centres towards the target, not away from it.
    assert (np.sum((points - centres) * (target - points), axis=-1) > 0).all()
    assert_allclose(reflect(centres, centres), 0.0, atol=1e-12)


@pytest.mark.parametrize("fold_deg", FOLDS)
def test_ellipsoid_becomes_the_parabola_as_its_target_recedes(fold_deg: float) -> None:
    chief, turned = chief_points(), view_from_rig(fold_deg)
    parabola = parabola_centres(chief, 80.0, turned)
    errors = [np.abs(ellipsoid_centres(chief, 80.0, depth, turned) - parabola).max() for depth in (1e5, 1e6)]
    assert errors[0] < 0.2
    assert errors[1] < 0.11 * errors[0]


@pytest.mark.parametrize("fold_deg", FOLDS)
def test_the_optical_axis_leaves_along_the_views_at_the_scale(fold_deg: float) -> None:
    turned = view_from_rig(fold_deg)
    axis = np.zeros((1, 2))
    for centres in (parabola_centres(axis, 80.0, turned), ellipsoid_centres(axis, 80.0, 375.0, turned)):
        point = where_chief_rays_meet(centres, rays_in_view(axis, turned))
        assert_allclose(point @ turned, [[0.0, 0.0, 80.0]], atol=1e-12)
        assert_allclose(point - centres, [[0.0, 0.0, 80.0]], atol=1e-12)


def test_a_right_angle_gives_the_closed_forms() -> None:
    chief, turned = chief_points(), view_from_rig(90.0)
    u, v = np.moveaxis(chief, -1, 0)
    # In rig: t = h / (|(u, v, 1)| - v), centre (t u, -h, t).
    t = 80.0 / (np.sqrt(1.0 + u * u + v * v) - v)
    assert_allclose(parabola_centres(chief, 80.0, turned) @ turned, np.stack([t * u, np.full_like(t, -80.0), t], -1))
    # In rig: foci at the pupil and at (0, depth, h), sum of distances h + depth.
    rays = np.stack([u, v, np.ones_like(u)], axis=-1) / np.sqrt(1.0 + u * u + v * v)[..., None]
    target = np.array([0.0, 375.0, 80.0])
    away = rays * (80.0 * 375.0 / (455.0 - rays @ target))[..., None] - target
    expected = target + 455.0 * away / np.linalg.norm(away, axis=-1, keepdims=True)
    assert_allclose(ellipsoid_centres(chief, 80.0, 375.0, turned) @ turned, expected, atol=1e-11)


@pytest.mark.parametrize("fold_deg", FOLDS)
def test_a_seed_knows_where_its_chief_rays_meet_the_mirrors(fold_deg: float) -> None:
    spec = DesignSpec(rows=2, cols=3, fold_deg=fold_deg, sides=5)
    seed = seed_of(spec, 375.0)
    middles, rays = seed.chief_points(spec.view_from_rig), rays_in_view(seed.chief_rays, spec.view_from_rig)
    assert_allclose(np.cross(middles, rays), 0.0, atol=1e-12)
    assert_allclose(np.linalg.norm(middles, axis=1), np.linalg.norm(middles - seed.centres, axis=1))
    sizes = np.ptp(seed.corners, axis=1)
    assert_allclose(sizes, np.broadcast_to(2.0 * seed.half_tile, sizes.shape))


def test_seeds_leave_at_least_half_of_each_tile() -> None:
    spec = DesignSpec(rows=1, cols=3, spacing_mm=30.0)
    across = np.ptp(seed_of(spec, 375.0).corners[..., 0], axis=1)
    low, high = sensor_rectangle(spec.camera)
    assert (across > 0.5 * (high - low)[0] / 3.0).all()


@pytest.mark.parametrize("sides", [4, 5, 6])
def test_tiles_of_any_corners_are_rectangles_with_broken_edges(sides: int) -> None:
    pattern = corner_pattern(sides)
    assert pattern.shape == (sides, 2)
    square = Polygon(pattern)
    assert square.is_valid
    assert square.exterior.is_ccw
    assert square.equals(Polygon([(0, 0), (1, 0), (1, 1), (0, 1)]))
    assert len({tuple(corner) for corner in pattern.tolist()}) == sides
    broken = {tuple(corner) for corner in pattern.tolist()} - {(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)}
    assert broken == {4: set(), 5: {(0.5, 1.0)}, 6: {(0.0, 0.5), (1.0, 0.5)}}[sides]
    spec = DesignSpec(rows=2, cols=3, sides=sides)
    assert_allclose(np.ptp(tiles(spec, 0.02), axis=1), np.ptp(tiles(spec.replaced(sides=4), 0.02), axis=1))


@pytest.mark.parametrize(("rows", "cols"), SIZES)
@pytest.mark.parametrize("scale_mm", [40.0, 120.0])
def test_parabola_of_any_size_is_in_order(rows: int, cols: int, scale_mm: float) -> None:
    layout = faceted_parabola(DesignSpec(rows=rows, cols=cols, scale_mm=scale_mm, fold_deg=90.0, sides=6))
    assert {len(mirror.outline_in_rig_mm) for mirror in layout.mirrors} == {4}
    assert_allclose(layout.virtual_centres_in_rig_mm[:, 1], -scale_mm)
    x, y, _ = np.moveaxis(layout.virtual_centres_in_view_mm, -1, 0)
    assert (np.diff(x, axis=1) > 0).all(), "columns run to the right of the view"
    assert (np.diff(y, axis=0) > 0).all(), "rows run down the view"
    assert smallest_gap_mm(layout.mirrors) == pytest.approx(1.0, abs=1e-3)
    for k in range(rows * cols):
        assert_allclose(
            layout.mirrors[k].outline_in_rig_mm @ layout.mirrors[k].normal_in_rig, -layout.mirrors[k].distance_mm
        )


def test_tiles_fill_the_sensor_but_for_their_gaps() -> None:
    spec = DesignSpec(rows=2, cols=4)
    corners = tiles(spec, 0.02)
    rectangle = sensor_rectangle(spec.camera)
    assert_allclose(corners.min(axis=(0, 1)), rectangle[0])
    assert_allclose(corners.max(axis=(0, 1)), rectangle[1])
    width, height = rectangle[1] - rectangle[0]
    assert_allclose(width, 1920 / 1360.38)
    sizes = np.ptp(corners, axis=1)
    assert_allclose(sizes, np.broadcast_to([(width - 3 * 0.02) / 4, (height - 0.02) / 2], sizes.shape))
    # Row 0 holds the highest views, which the fold puts where v is greatest.
    assert corners[0, :, 1].min() > corners[4, :, 1].max()


def test_a_distorted_sensor_holds_its_rectangle() -> None:
    low, high = sensor_rectangle(BENT)
    along = np.linspace(0.0, 1.0, 50)[:, None]
    for start, end in (
        (low, [high[0], low[1]]),
        (low, [low[0], high[1]]),
        (high, [high[0], low[1]]),
        (high, [low[0], high[1]]),
    ):
        pixels = BENT.pixels_from_normalized(np.asarray(start) * (1 - along) + np.asarray(end) * along)
        assert (pixels > -0.51).all()
        assert (pixels < np.array([1919.51, 1079.51])).all()


def test_a_lens_that_folds_inside_the_sensor_is_refused() -> None:
    camera = Camera.c920().replaced(distortion=[-0.9, 0.0, 0.0, 0.0, 0.0])
    with pytest.raises(InputError, match="is not monotonic on the sensor"):
        sensor_rectangle(camera)


def test_facets_with_an_impossible_gap_are_refused() -> None:
    with pytest.raises(InfeasibleDesign, match=r"spacing constraint: facets 60 mm apart .* too close"):
        faceted_parabola(DesignSpec(spacing_mm=60.0))


def test_noise_below_a_nanometre_leaves_no_trace() -> None:
    spec = DesignSpec()
    corners = tiles(spec, 0.02).round(8)
    centres = parabola_centres(corners.mean(axis=1), 80.0, spec.view_from_rig).round(6)
    noise = np.random.default_rng(0).uniform(-2e-10, 2e-10, centres.shape)
    assert mirrors_of(spec, centres, corners) == mirrors_of(spec, centres + noise, corners + noise[0, 0])


@pytest.mark.parametrize("fold_deg", FOLDS)
@pytest.mark.parametrize("surface", ["first", "second"])
def test_apparent_mirrors_have_the_requested_centres_and_corners(fold_deg: float, surface: str) -> None:
    spec = DesignSpec(rows=2, cols=2, fold_deg=fold_deg).replaced(surface=surface, thickness_mm=3.0)
    seed = seed_of(spec, 375.0)
    mirrors = mirrors_of(spec, 80.0 * seed.centres, seed.corners)
    layout = layout_of(spec, mirrors, {})
    assert_allclose(layout.virtual_centres_in_view_mm.reshape(-1, 3), 80.0 * seed.centres, atol=1e-5)
    for mirror, corners in zip(layout.mirrors, seed.corners, strict=True):
        assert mirror.surface == surface
        assert_allclose(mirror.apparent.outline_normalized, corners, atol=1e-7)


def test_a_mirror_that_does_not_fit_before_the_pupil_is_refused() -> None:
    spec = DesignSpec(rows=1, cols=2, surface="second", thickness_mm=150.0)
    seed = seed_of(spec, 375.0)
    with pytest.raises(InfeasibleDesign, match="occlusion constraint"):
        mirrors_of(spec, 80.0 * seed.centres, seed.corners)


def test_overlapping_mirrors_are_refused() -> None:
    spec = DesignSpec(rows=1, cols=2)
    seed = seed_of(spec, 375.0)
    mirrors = mirrors_of(spec, 80.0 * seed.centres, seed.corners[[0, 0]])
    with pytest.raises(InfeasibleDesign, match=r"spacing constraint: .*overlap in the image"):
        layout_of(spec, mirrors, {})


def test_outlines_are_rounded_and_lie_on_their_planes() -> None:
    for mirror in faceted_parabola(DesignSpec(rows=2, cols=2)).mirrors:
        outline = mirror.outline_in_rig_mm
        assert (outline == outline.round(9)).all()
        assert np.abs(outline @ mirror.normal_in_rig + mirror.distance_mm).max() < 2e-9


@pytest.mark.parametrize(("rows", "cols"), [(1, 2), (3, 3), (7, 4)])
def test_tiles_of_a_grid_lie_in_its_rows_and_columns(rows: int, cols: int) -> None:
    places = tile_positions(Arrangement(rows, cols)).reshape(rows, cols, 2)
    assert (places == np.stack(np.meshgrid(np.arange(cols), np.arange(rows)), axis=-1)).all()


@pytest.mark.parametrize(
    ("pattern", "size"),
    [
        (Pattern.hexagonal(1), (3, 3)),
        (Pattern.hexagonal(2), (5, 5)),
        (Pattern.ring(8), (3, 3)),
        (Pattern(positions=[[0, -1.5], [-2, 0], [0, 0], [1, 0], [3, 0], [0, 1]]), (4, 3)),
    ],
    ids=["hex7", "hex19", "ring8", "cross"],
)
def test_tiles_of_a_pattern_lie_apart_in_its_order(pattern: Pattern, size: tuple[int, int]) -> None:
    arrangement = Arrangement(1, len(pattern.positions), pattern)
    places = tile_positions(arrangement)
    assert places.min() == 0.0
    assert (places.max(axis=0) + 1 == size).all()
    for i, j in combinations(range(len(places)), 2):
        moved, step = places[j] - places[i], arrangement.steps[j] - arrangement.steps[i]
        assert np.abs(moved).max() >= 1.0 - 1e-12
        axis = int(np.abs(moved).argmax())
        assert moved[axis] * step[axis] > 0


def test_seeds_of_a_pattern_tile_the_sensor_without_overlap() -> None:
    spec = DesignSpec(pattern=Pattern.hexagonal(1))
    seed = seed_of(spec, 375.0)
    polygons = [Polygon(corners) for corners in seed.corners]
    assert all(not one.intersects(other) for one, other in combinations(polygons, 2))
    low, high = sensor_rectangle(spec.camera)
    assert ((seed.corners >= low - 1e-9) & (seed.corners <= high + 1e-9)).all()
    assert sum(polygon.area for polygon in polygons) > 0.7 * float(np.prod(high - low))
    layout = faceted_parabola(spec)
    assert (layout.pattern, layout.mirror_names[-1]) == (spec.pattern, "6")
    # The highest view is mirror 0, whose sub-image lies lowest on the sensor.
    assert layout.virtual_centres_in_view_mm[0, 0, 1] < layout.virtual_centres_in_view_mm[0, -1, 1]
