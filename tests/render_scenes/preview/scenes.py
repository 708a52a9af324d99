"""Objects one by one, for tests of rays."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from mirrorcam.optics.geometry.transforms import rigid
from mirrorcam.render_scenes.preview.traced_scene import TracedScene, traced_tabletop
from mirrorcam.render_scenes.tabletop.objects import SceneObject
from mirrorcam.render_scenes.tabletop.tabletop import Tabletop

TURN = Rotation.from_euler("xyz", [0.4, -0.7, 1.1]).as_matrix()


def item(kind: str, place: tuple[float, float, float] = (5.0, -8.0, 300.0), **more: Any) -> SceneObject:
    """An object of 40, 50 and 60 mm, turned."""
    fields = {"material": "matte", "view_from_object": rigid(TURN, place), "size_mm": np.array([40.0, 50.0, 60.0])}
    return SceneObject(name=kind, kind=kind, **(fields | more))


def scene_of(*objects: SceneObject) -> TracedScene:
    """Objects in the light of a lamp of a scene of 200 mm."""
    return traced_tabletop(Tabletop(objects, np.array([0.0, 0.0, 300.0]), 200.0))
