"""One frame of a scene in memory: what it refuses. What it shows is tested with its program of docs/library.md."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mirrorcam.core.errors import InputError
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.transforms import rigid
from mirrorcam.render_scenes.tabletop.objects import SceneObject
from mirrorcam.render_scenes.tabletop.single_frame import render_frame

BALL = SceneObject(kind="sphere", view_from_object=rigid(np.eye(3), [0.0, 0.0, 400.0]), size_mm=(40, 0, 0))


@pytest.mark.parametrize(
    ("objects", "more", "reason"),
    [
        ([], {}, "^objects: none, expected one or more"),
        ([BALL], {"spp": 3}, "^spp: 3, expected 4 to"),
        ([BALL], {"seed": -1}, "^seed: -1, expected 0 to"),
    ],
)
def test_scenes_that_cannot_be_rendered_are_refused(
    objects: list[SceneObject], more: dict[str, Any], reason: str, default_layout: Layout
) -> None:
    with pytest.raises(InputError, match=reason):
        render_frame(default_layout, objects, **more)


def test_a_mesh_in_the_mirrors_is_refused(default_layout: Layout, tmp_path: Path) -> None:
    corners = np.array([[0, 0, 1], [0, 0, 0], [9, 0, 0], [0, 9, 9]], dtype="<f4")  # the normal first
    (tmp_path / "a.stl").write_bytes(bytes(80) + (1).to_bytes(4, "little") + corners.tobytes() + bytes(2))
    near = SceneObject(kind="mesh", view_from_object=np.eye(4), file=tmp_path / "a.stl")
    with pytest.raises(InputError, match=r"a\.stl: reaches to a depth of 0 mm"):
        render_frame(default_layout, [near])


@pytest.mark.parametrize(
    ("fields", "reason"),
    [
        ({"kind": "mesh"}, "a mesh with the file None"),
        ({"kind": "box", "size_mm": (1, 1, 1), "file": "a.stl"}, "a box with the file a.stl"),
        ({"kind": "box", "size_mm": (1, 0, 1)}, "positive sides"),
        ({"kind": "sphere"}, "positive sides"),
        ({"kind": "sphere", "size_mm": (9, 0, 0), "view_from_object": 2.0 * np.eye(4)}, "not rigid"),
        ({"kind": "sphere", "size_mm": (9, 0, 0), "view_from_object": np.diag([1, 1, -1, 1])}, "not rigid"),
    ],
)
def test_objects_that_cannot_be_are_refused(fields: dict[str, Any], reason: str) -> None:
    with pytest.raises(InputError, match=reason):
        SceneObject(**{"view_from_object": np.eye(4), **fields})
