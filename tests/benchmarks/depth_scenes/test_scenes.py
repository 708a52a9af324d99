"""All scenes: true depth against independent rays, disparities of the benchmark's range, the same bytes for a seed."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from benchmarks.depth_scenes.rendered_scene import VIEWS, RenderedScene, Scene, depth_views
from benchmarks.depth_scenes.scenes import SCENES
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.transforms import transform

SIZE_PX = 40


def first_hits(scene: Scene, direction: FloatArray) -> FloatArray:
    """Depth (n,) where rays (n, 3) from the central view first meet a triangle (Moeller and Trumbore), in float64."""
    found = np.full(len(direction), np.inf)
    for item in scene.items:
        corners = transform(scene.view_from_scene, item.surface.points)[item.surface.faces]
        origin, one, two = corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
        for number, ray in enumerate(direction):
            across = np.cross(ray, two)
            determinant = (one * across).sum(axis=1)
            with np.errstate(divide="ignore", invalid="ignore"):
                u = -(origin * across).sum(axis=1) / determinant
                other = np.cross(-origin, one)
                v, way = (other @ ray) / determinant, (two * other).sum(axis=1) / determinant
                met = way[(u >= 0.0) & (v >= 0.0) & (u + v <= 1.0) & (way > 0.0)]
            found[number] = min(found[number], met.min(initial=np.inf))
    return found * direction[:, 2]


@pytest.mark.parametrize("name", SCENES)
def test_true_depth_is_that_of_independent_rays(
    name: str, scene: Callable[[str], Scene], rendered: Callable[[str], RenderedScene]
) -> None:
    views = depth_views(3, SIZE_PX)
    depth = rendered(name).depth_mm(views, 1, 1)
    rows, columns = np.random.default_rng(0).integers(0, SIZE_PX, (2, 60))
    direction = np.stack([*(np.stack([columns, rows]) - views.centre_px[:, None]) / views.focal_px, np.ones(60)], -1)
    expected = first_hits(scene(name), direction)
    # A ray that grazes an edge may pass it on either side by rounding.
    assert np.count_nonzero(np.abs(depth[rows, columns] / expected - 1.0) > 1e-5) <= 1


@pytest.mark.parametrize("name", SCENES)
def test_disparities_are_those_of_the_benchmark_and_known_everywhere(
    name: str, rendered: Callable[[str], RenderedScene]
) -> None:
    views = depth_views(VIEWS, 512)
    for t, s in ((4, 4), (0, 0), (8, 8)):
        depth = rendered(name).depth_mm(views, t, s)
        assert np.isfinite(depth).all()
        disparity = views.disparity_px_from_depth(depth.astype(np.float64), "s")
        assert -2.1 < disparity.min() < -1.3
        assert 1.3 < disparity.max() < 2.2


@pytest.mark.parametrize("name", SCENES)
def test_pictures_are_lit_and_the_same_for_the_same_seed(name: str, rendered: Callable[[str], RenderedScene]) -> None:
    views = depth_views(3, SIZE_PX)
    one = rendered(name).picture(views, 1, 1, spp=4)
    assert 30.0 < one.mean() < 160.0
    assert np.mean(one == 255) < 0.05
    assert np.array_equal(one, RenderedScene(SCENES[name](1)).picture(views, 1, 1, spp=4))


def test_another_seed_is_another_scene() -> None:
    one, two = (SCENES["slant"](seed) for seed in (1, 2))
    assert not np.array_equal(one.items[4].surface.points, two.items[4].surface.points)
    first, second = one.items[0].finish.pattern, two.items[0].finish.pattern
    assert first is not None
    assert second is not None
    assert not np.array_equal(first, second)
