"""`foliage`: hundreds of leaves, and edges of depth nearly everywhere."""

from __future__ import annotations

from collections.abc import Callable

from mirrorcam.render_scenes.depth_scenes.room import Room, RoomScene, depth_views


def test_hundreds_of_leaves_with_the_wall_between_them(
    room: Callable[[str], Room], scene: Callable[[str], RoomScene]
) -> None:
    triangles = sum(len(item.surface.faces) for item in room("foliage").items if item.name.startswith("leaves"))
    assert triangles / 32 > 500
    assert 0.1 < scene("foliage").edges(depth_views(3, 256)).mean() < 0.6
