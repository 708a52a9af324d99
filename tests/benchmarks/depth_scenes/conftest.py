"""What the tests of scenes share: each scene, built once."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import pytest

from benchmarks.depth_scenes.rendered_scene import RenderedScene, Scene
from benchmarks.depth_scenes.scenes import SCENES
from mirrorcam.render_scenes.variant import SCALAR, use_variant


@pytest.fixture(scope="session")
def scene() -> Callable[[str], Scene]:
    """The scenes by name, of seed 1."""
    return cache(lambda name: SCENES[name](1))


@pytest.fixture(scope="session")
def rendered(scene: Callable[[str], Scene]) -> Callable[[str], RenderedScene]:
    """The scenes in Mitsuba."""
    if use_variant(colour=True) == SCALAR:
        pytest.skip("nothing compiles in colour")
    return cache(lambda name: RenderedScene(scene(name)))
