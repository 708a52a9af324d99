"""`foliage`: hundreds of leaves, and edges of depth nearly everywhere."""

from __future__ import annotations

from collections.abc import Callable

from benchmarks.depth_scenes.rendered_scene import RenderedScene, Scene, depth_views


def test_hundreds_of_leaves_with_the_wall_between_them(
    scene: Callable[[str], Scene], rendered: Callable[[str], RenderedScene]
) -> None:
    triangles = sum(len(item.surface.faces) for item in scene("foliage").items if item.name.startswith("leaves"))
    assert triangles / 32 > 500
    assert 0.1 < rendered("foliage").edges(depth_views(3, 256)).mean() < 0.6
