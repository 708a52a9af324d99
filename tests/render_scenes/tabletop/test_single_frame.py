"""One frame of a scene in memory: the program of docs/scenes.md, and refusals. test_library_page.py tests another."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from docs.page_code import blocks
from mirrorcam.core.errors import InputError
from mirrorcam.core.images.pictures import write_image
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.transforms import rigid
from mirrorcam.render_scenes.tabletop.objects import SceneObject
from mirrorcam.render_scenes.tabletop.single_frame import render_frame

PAGE = Path(__file__).parents[3] / "docs" / "scenes.md"
BALL = SceneObject(kind="sphere", view_from_object=rigid(np.eye(3), [0.0, 0.0, 400.0]), size_mm=(40, 0, 0))
SHEET: dict[str, Any] = {"kind": "rectangle", "size_mm": (1, 1, 0)}


@pytest.mark.slow
@pytest.mark.skipif(find_spec("mitsuba") is None, reason="rendering needs the extra render")
def test_the_program_of_the_page_shows_pictures_and_meshes(
    small_layout: Layout, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    small_layout.save(tmp_path / "layout.json")
    # Red, green; blue, yellow.
    corners = np.array([[(230, 30, 30), (30, 230, 30)], [(30, 30, 230), (230, 230, 30)]], dtype=np.uint8)
    write_image(tmp_path / "photo.png", corners.repeat(60, axis=0).repeat(80, axis=1))
    monkeypatch.chdir(tmp_path)
    (program,) = (block.text for block in blocks(PAGE.read_text(encoding="utf-8"), "python") if "photo" in block.text)
    names: dict[str, Any] = {}
    exec(program, names)
    middle, tip = names["middle"], names["roof"][:3] @ [0.0, 0.0, 15.0, 1.0]
    # Beyond the objects before the wall, seen from any mirror.
    sides = {"red": (-100.0, -30.0), "green": (100.0, -30.0), "blue": (-100.0, 30.0), "yellow": (100.0, 30.0)}
    points = {name: np.add(middle, (*side, 0.0)) for name, side in sides.items()} | {"roof": tip}
    bright = {"red": "100", "green": "010", "blue": "001", "yellow": "110", "roof": "010"}
    seen = set()
    for mirror in small_layout.mirror_names:
        for name, point in points.items():
            pixel = small_layout.project(point @ small_layout.view_from_rig, mirror)
            if small_layout.shows(pixel, mirror):
                column, row = pixel.round().astype(int)
                levels = names["frame"][row, column].tolist()
                assert "".join(str(int(level > 0.75 * max(levels))) for level in levels) == bright[name]
                seen.add(name)
    assert seen == bright.keys()


@pytest.mark.parametrize(
    ("objects", "more", "reason"),
    [
        ([], {}, "^objects: none, expected one or more"),
        ([BALL], {"spp": 3}, "^spp: 3, expected 4 to"),
        ([BALL], {"seed": -1}, "^seed: -1, expected 0 to"),
        ([BALL], {"sensor": "phone"}, "^sensor: 'phone', expected one of ideal, c920, poor, webcam, or a SensorModel"),
    ],
)
def test_scenes_that_cannot_be_rendered_are_refused(
    objects: list[SceneObject], more: dict[str, Any], reason: str, default_layout: Layout
) -> None:
    with pytest.raises(InputError, match=reason):
        render_frame(default_layout, objects, **more)


def test_a_camera_without_mirrors_is_refused(default_layout: Layout) -> None:
    with pytest.raises(InputError, match=r"^layout: a bare camera, expected a layout with mirrors$"):
        render_frame(Layout.bare(default_layout.camera), [BALL])


@pytest.mark.parametrize(
    ("objects", "more", "reason"),
    [
        (BALL, {}, "^objects: SceneObject, expected an iterable of SceneObject"),
        (None, {}, "^objects: NoneType, expected an iterable of SceneObject"),
        ([BALL], {"sensor": 3}, "^sensor: int, expected SensorModel or str"),
    ],
)
def test_arguments_of_another_type_are_refused_by_name(
    objects: Any, more: dict[str, Any], reason: str, default_layout: Layout
) -> None:
    with pytest.raises(TypeError, match=reason):
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
        ({"kind": "mesh"}, "a mesh with no triangles"),
        ({"kind": "box", "size_mm": (1, 1, 1), "file": "a.stl"}, "a box with file, expected"),
        ({"kind": "mesh", "vertices_mm": np.eye(3)}, "a mesh with vertices_mm, expected"),
        ({"kind": "mesh", "vertices_mm": np.eye(3), "faces": [(0, 1, 3)]}, "the index 3, expected less than 3"),
        ({"kind": "mesh", "vertices_mm": np.eye(3), "faces": [(0, 1, -1)]}, "counted from 0"),
        ({"kind": "mesh", "vertices_mm": np.eye(3), "faces": [(0, 1, 1.5)]}, "counted from 0"),
        ({"kind": "mesh", "vertices_mm": np.eye(3), "faces": np.zeros((0, 3))}, "one or more triangles"),
        ({"kind": "mesh", "file": "a.stl", "texture": "poster"}, "a texture on a mesh"),
        ({**SHEET, "texture": "poster", "material": "glass"}, "of glass material"),
        ({"kind": "box", "size_mm": (1, 1, 1), "texture": "a.png"}, "a picture on a box"),
        ({**SHEET, "texture": "postr"}, "texture: postr, expected one of wood, poster"),
        ({**SHEET, "texture": np.zeros((4, 4))}, r"texture: shape \(4, 4\)"),
        ({**SHEET, "texture": np.full((4, 4, 3), 255.0)}, "from 255 to 255, expected 0 to 1, or uint8"),
        ({**SHEET, "texture": np.full((4, 4, 3), np.nan)}, "from nan to nan"),
        ({**SHEET, "texture": np.zeros((4, 4, 3), dtype=np.int64)}, "an array of int64"),
        ({**SHEET, "texels_per_mm": -1.0}, "^texels_per_mm"),
        ({**SHEET, "texture_px": (0, 64)}, "^texture_px"),
        ({**SHEET, "seed": -1}, "^seed"),
        ({**SHEET, "colour": (255, 0, 0)}, r"colour \[255.0, 0.0, 0.0\], expected linear RGB from 0 to 1"),
        ({"kind": "box", "size_mm": (1, 0, 1)}, "positive sides"),
        ({"kind": "sphere"}, "positive sides"),
        ({"kind": "sphere", "size_mm": (9, 0, 0), "view_from_object": 2.0 * np.eye(4)}, "not rigid"),
        ({"kind": "sphere", "size_mm": (9, 0, 0), "view_from_object": np.diag([1, 1, -1, 1])}, "not rigid"),
    ],
)
def test_objects_that_cannot_be_are_refused(fields: dict[str, Any], reason: str) -> None:
    with pytest.raises(InputError, match=reason):
        SceneObject(**{"view_from_object": np.eye(4), **fields})
