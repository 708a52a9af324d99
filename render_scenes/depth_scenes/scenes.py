"""The scenes by their names."""

from __future__ import annotations

from collections.abc import Callable

from mirrorcam.render_scenes.depth_scenes.borders import borders
from mirrorcam.render_scenes.depth_scenes.clutter import clutter
from mirrorcam.render_scenes.depth_scenes.foliage import foliage
from mirrorcam.render_scenes.depth_scenes.gloss import gloss
from mirrorcam.render_scenes.depth_scenes.rendered_scene import Scene
from mirrorcam.render_scenes.depth_scenes.slant import slant

SCENES: dict[str, Callable[[int], Scene]] = {
    "slant": slant,
    "foliage": foliage,
    "gloss": gloss,
    "borders": borders,
    "clutter": clutter,
}
