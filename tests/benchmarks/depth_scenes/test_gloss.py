"""`gloss`: every kind of finish, and a mirror that shows something else than its surface."""

from __future__ import annotations

from collections.abc import Callable
from typing import get_args

from benchmarks.depth_scenes.rendered_scene import Kind, Scene


def test_every_kind_of_finish_is_there(scene: Callable[[str], Scene]) -> None:
    assert {item.finish.kind for item in scene("gloss").items} == set(get_args(Kind))
