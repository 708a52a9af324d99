"""Objects of a tabletop scene as shapes of Mitsuba, their materials, and the light sources."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import Field

from mirrorcam.core.values import FloatArray, Matrix4, Value, Vector3
from mirrorcam.optics.geometry.transforms import rigid, transform
from mirrorcam.render_scenes.mesh_shapes import Triangles, leaves, read_mesh
from mirrorcam.render_scenes.reference.mirror_shapes import mesh
from mirrorcam.render_scenes.tabletop.textures import Texture, TextureName, texture

Kind = Literal["sphere", "cylinder", "box", "rectangle", "leaves", "mesh"]
Material = Literal["matte", "glossy", "glass"]

GLASS_INDEX = 1.5
MOST_TEXELS = 4096
SKY = (0.62, 0.65, 0.70)
LAMP = (105.0, 98.0, 87.0)
LAMP_PLACE = (-1.2, -2.4, -1.3)
"""Middle of the area light from what it faces, in view axes and scales of the arrangement."""
LAMP_HALF = 0.22
"""Half a side of it, likewise."""


class SceneObject(Value):
    """An object of a tabletop scene: a surface around the origin of its frame, placed by `view_from_object`.

    Of `size_mm`, a sphere uses x; a cylinder x (diameter) and z (length, along its z); a rectangle x and y. The base of
    a mesh is at its origin. Without a texture, of `texels_per_mm` or of `texture_px` (columns, rows), the object has
    the plain `colour`, linear RGB.
    """

    name: str
    kind: Kind
    material: Material
    view_from_object: Matrix4 = Field(serialization_alias="view_from_thing")
    size_mm: Vector3
    texture: TextureName | None = None
    texels_per_mm: float = 1.0
    texture_px: tuple[int, int] | None = None
    colour: Vector3 = Field(default=(0.6, 0.6, 0.6), validate_default=True)
    seed: int = 0
    file: Path | None = None


def shapes_of(item: SceneObject, view_from_rig: FloatArray) -> list[Any]:
    """Make the shapes of an object, in rig, mm."""
    import mitsuba as mi

    rig_from_object = rigid(view_from_rig.T, np.zeros(3)) @ item.view_from_object
    width, depth, height = item.size_mm
    bsdf = _bsdf(item)

    def load(kind: str, object_from_shape: FloatArray) -> Any:
        to_world = (rig_from_object @ object_from_shape).astype(np.float32)
        return _loaded({"type": kind, "to_world": mi.ScalarTransform4f(to_world), "bsdf": bsdf})

    if item.kind == "sphere":
        return [load("sphere", np.diag([width / 2, width / 2, width / 2, 1.0]))]
    if item.kind == "rectangle":
        return [load("rectangle", np.diag([width / 2, depth / 2, 1.0, 1.0]))]
    if item.kind == "box":
        return [load("cube", np.diag([width / 2, depth / 2, height / 2, 1.0]))]
    if item.kind == "cylinder":
        ends = [rig_from_object[:3] @ [0.0, 0.0, z, 1.0] for z in (-height / 2, height / 2)]
        side = {"type": "cylinder", "p0": ends[0].tolist(), "p1": ends[1].tolist(), "radius": width / 2, "bsdf": bsdf}
        lid = np.diag([width / 2, width / 2, 1.0, 1.0])
        lid[2, 3] = height / 2
        return [_loaded(side), load("disk", lid)]
    surface = leaves(float(width), item.seed) if item.kind == "leaves" else based(item)
    points = transform(rig_from_object, surface.points)
    shape = mesh(item.kind, points, surface.faces.astype(np.int64), bsdf)
    if surface.colours is not None:
        shape.add_attribute("vertex_color", 3, np.float32(surface.colours).ravel())
    return [shape]


def _loaded(shape: dict[str, Any]) -> Any:
    """A shape without Mitsuba's warnings: it takes what float32 rounds of a rotation, times a size in mm, for shear."""
    import mitsuba as mi

    level = mi.log_level()
    mi.set_log_level(mi.LogLevel.Error)
    try:
        return mi.load_dict(shape)
    finally:
        mi.set_log_level(level)


def based(item: SceneObject) -> Triangles:
    """Read the mesh of a file, with the middle of its base at the origin; InputError where it cannot be read."""
    assert item.file is not None
    surface = read_mesh(item.file)
    low, high = surface.points.min(axis=0), surface.points.max(axis=0)
    return Triangles(surface.points - [*(low[:2] + high[:2]) / 2.0, low[2]], surface.faces)


def _bsdf(item: SceneObject) -> dict[str, Any]:
    if item.material == "glass":
        return {"type": "dielectric", "int_ior": GLASS_INDEX, "ext_ior": 1.0}
    colour = _reflectance(item)
    if item.material == "glossy":
        return {"type": "plastic", "int_ior": GLASS_INDEX, "ext_ior": 1.0, "diffuse_reflectance": colour}
    return {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": colour}}


def _reflectance(item: SceneObject) -> dict[str, Any]:
    import mitsuba as mi

    if item.kind == "leaves":
        return {"type": "mesh_attribute", "name": "vertex_color"}
    if item.texture is None:
        return {"type": "rgb", "value": item.colour.tolist()}
    picture = surface_texture(item.kind, item.texture, texture_size_px(item), item.seed)
    return {"type": "bitmap", "bitmap": mi.Bitmap(picture), "raw": True, "wrap_mode": "clamp"}


def texture_size_px(item: SceneObject) -> tuple[int, int]:
    """Columns and rows of the texture of an object."""
    if item.texture_px is not None:
        return item.texture_px
    width, depth, height = item.size_mm
    around = {"sphere": (np.pi * width, np.pi * width / 2), "cylinder": (np.pi * width, height)}
    flat = {"rectangle": (width, depth), "box": (max(width, depth), height)}
    columns, rows = (int(np.clip(item.texels_per_mm * side, 64, MOST_TEXELS)) for side in (around | flat)[item.kind])
    return columns, rows


def surface_texture(kind: Kind, name: TextureName, size_px: tuple[int, int], seed: int) -> Texture:
    """The texture (rows, columns, 3) of a kind of object, by its texture coordinates from the top left corner on."""
    picture = texture(name, size_px, seed)
    # The v coordinate of a cylinder grows towards its top.
    return picture[::-1].copy() if kind == "cylinder" else picture


def lamp_square(target_in_view: FloatArray, reach_mm: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Middle (3,) of the area light, the unit vector (3,) to where it faces, half its sides (2, 3); view axes, mm."""
    towards = -np.array(LAMP_PLACE) / np.linalg.norm(LAMP_PLACE)
    first = np.cross([0.0, 0.0, 1.0], towards)
    first /= np.linalg.norm(first)
    sides = LAMP_HALF * reach_mm * np.stack([first, np.cross(towards, first)])
    return target_in_view + reach_mm * np.array(LAMP_PLACE), towards, sides


def lights(target_in_view: FloatArray, reach_mm: float, view_from_rig: FloatArray) -> dict[str, Any]:
    """Make an area light above, left of and before a point (3,) in view axes, and a uniform environment, in rig.

    Size and distance of the area light are proportional to `reach_mm`, so that its irradiance does not depend on scale.
    """
    import mitsuba as mi

    origin, _, _ = lamp_square(target_in_view, reach_mm)
    side = LAMP_HALF * reach_mm
    look = mi.ScalarTransform4f().look_at(
        origin=(view_from_rig.T @ origin).tolist(),
        target=(view_from_rig.T @ target_in_view).tolist(),
        up=(view_from_rig.T @ [0.0, 0.0, 1.0]).tolist(),
    )
    return {
        "sky": {"type": "constant", "radiance": {"type": "rgb", "value": list(SKY)}},
        "lamp": {
            "type": "rectangle",
            "to_world": look @ mi.ScalarTransform4f().scale([side, side, 1.0]),
            "bsdf": {"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.0}},
            "emitter": {"type": "area", "radiance": {"type": "rgb", "value": list(LAMP)}},
        },
    }
