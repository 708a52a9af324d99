"""The scenes by their names."""

from __future__ import annotations

from collections.abc import Callable

from benchmarks.depth_scenes.borders import borders
from benchmarks.depth_scenes.clutter import clutter
from benchmarks.depth_scenes.foliage import foliage
from benchmarks.depth_scenes.gloss import gloss
from benchmarks.depth_scenes.rendered_scene import Scene
from benchmarks.depth_scenes.slant import slant

SCENES: dict[str, Callable[[int], Scene]] = {
    "slant": slant,
    "foliage": foliage,
    "gloss": gloss,
    "borders": borders,
    "clutter": clutter,
}
