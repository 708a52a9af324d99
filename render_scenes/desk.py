"""A desk before the camera: things of all kinds at given depths, where all views see them.

Things are placed in view axes (x right, y down, z forward, origin at the pupil, mm), in proportion to what all mirrors
show at their depth; so the same desk suits a camera of any size.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import Field

from optics.layout import Layout
from optics.values import FloatArray, InputError, Matrix4, Value, Vector3
from render_scenes.meshes import Triangles, leaves, read_mesh
from render_scenes.mirrors import mesh
from render_scenes.poses import ROOM_MM, common_bounds
from render_scenes.textures import TextureName, texture

Kind = Literal["sphere", "cylinder", "box", "rectangle", "leaves", "mesh"]
Material = Literal["matte", "glossy", "glass"]

GLASS_INDEX = 1.5
TEXELS_PER_PX = 1.25  # of a texture, where it stands, in the central view
MOST_TEXELS = 4096
SKY = (0.62, 0.65, 0.70)
LAMP = (105.0, 98.0, 87.0)
# Axes of what stands on the desk: x right, y away from the camera, z up. Of pictures: x right, y down, z away.
_STANDING = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])


class Thing(Value):
    """Something on the desk: a surface around the origin of its own frame, a rigid motion away from the view axes.

    Of `size_mm`, a sphere uses x; a cylinder x and, along its z, z; a rectangle (in its x and y) x and y. The base of a
    mesh is at its origin. Without a texture, of so many texels a mm, it has the plain `colour`.
    """

    name: str
    kind: Kind
    material: Material
    view_from_thing: Matrix4
    size_mm: Vector3
    texture: TextureName | None = None
    texels_per_mm: float = 1.0
    colour: Vector3 = Field(default=(0.6, 0.6, 0.6), validate_default=True)
    seed: int = 0
    file: Path | None = None


class NamedMesh(Value):
    """A mesh that a user names: its file, in mm with z up, and where in view axes the middle of its base stands."""

    file: Path
    place_in_view_mm: Vector3 | None = None


def nearest_mm(layout: Layout) -> float:
    """Depth from which on nothing of the camera is in the way."""
    return max(float((m.outline_in_rig_mm @ layout.view_from_rig[2]).max()) for m in layout.mirrors) + ROOM_MM


def desk(
    layout: Layout, depths_mm: tuple[float, ...], seed: int, meshes: tuple[NamedMesh, ...] = ()
) -> tuple[Thing, ...]:
    """What stands on the desk, the desk and the wall behind it; all but colours, textures and small shifts is the same.

    Things stand at the given depths; the wall is a fifth beyond the last. Raises InputError for depths that do not
    grow or lie within the camera.
    """
    depths = np.array(depths_mm)
    if len(depths) < 1 or (np.diff(depths) <= 0).any():
        raise InputError(f"depths {', '.join(f'{d:g}' for d in depths)} mm: expected some that grow")
    if depths[0] < nearest_mm(layout) + 0.25 * depths[0]:
        least = nearest_mm(layout) / 0.75
        raise InputError(f"depth {depths[0]:g} mm: a thing there would touch the camera, expected {least:.0f} or more")
    random = np.random.default_rng(seed)
    fields = {float(depth): common_bounds(layout, depth) for depth in depths}
    centre_mm = layout.virtual_centres_in_view_mm.reshape(-1, 3)[layout.central_index, 2]

    def fine(depth_mm: float) -> float:
        return float(TEXELS_PER_PX * layout.camera.fx_px / (depth_mm - centre_mm))

    near, wall = float(depths[0]), 1.2 * float(depths[-1])
    top_mm = fields[near][1, 1] - 0.06 * np.ptp(fields[near], axis=0)[1]

    def stand(
        name: str, kind: Kind, material: Material, *, rank: float, x: float, size: tuple[float, float, float],
        turn_deg: float = 0.0, lean_deg: float = 0.0, up: float = 0.0, detail: float = 1.0, **more: Any,
    ) -> Thing:  # fmt: skip
        """At the depth of a rank in [0, 1], at x of half the field, `size` and `up` in widths of the field."""
        depth = float(depths[round(rank * (len(depths) - 1))])
        left, right = fields[depth][:, 0]
        width = right - left
        size_mm = np.array(size) * width
        high = {"sphere": size_mm[0], "rectangle": size_mm[1] * np.cos(np.deg2rad(lean_deg))}.get(kind, size_mm[2])
        at = [
            (left + right) / 2.0 + width / 2.0 * (x + random.uniform(-0.04, 0.04)),
            top_mm - high / 2.0 - up * width,
            depth,
        ]
        view_from_thing = np.eye(4)
        upright = np.eye(3) if kind == "rectangle" else _STANDING
        view_from_thing[:3, :3] = _about_y(turn_deg) @ _about_x(-lean_deg) @ upright
        view_from_thing[:3, 3] = at
        drawn = {"seed": int(random.integers(2**31)), "colour": random.uniform(0.15, 0.75, 3)}
        drawn["texels_per_mm"] = detail * fine(depth)
        return Thing(
            name=name, kind=kind, material=material, view_from_thing=view_from_thing, size_mm=size_mm, **(drawn | more)
        )

    far = fields[float(depths[-1])]
    wide, high_mm = 3.2 * np.ptp(far, axis=0)
    back, board = np.eye(4), np.eye(4)
    back[:3, 3] = [far[:, 0].mean(), top_mm - high_mm / 2.0, wall]
    front = 0.5 * (near + nearest_mm(layout))
    board[:3, :3] = _STANDING
    board[:3, 3] = [far[:, 0].mean(), top_mm, (front + wall) / 2.0]
    flat = {"kind": "rectangle", "material": "matte"}
    seeds = random.integers(2**31, size=2)
    found = [
        Thing(
            name="wall",
            view_from_thing=back,
            size_mm=(wide, high_mm, 0.0),
            texture="poster",
            texels_per_mm=fine(wall),
            seed=int(seeds[0]),
            **flat,
        ),
        Thing(
            name="desk",
            view_from_thing=board,
            size_mm=(wide, wall - front, 0.0),
            texture="wood",
            texels_per_mm=fine(near),
            seed=int(seeds[1]),
            **flat,
        ),
        stand("twigs", "leaves", "matte", rank=0.0, x=-0.9, size=(0.34, 0.34, 0.34), up=0.2),
        stand("glass ball", "sphere", "glass", rank=0.0, x=0.04, size=(0.16, 0.16, 0.16)),
        stand("glossy ball", "sphere", "glossy", rank=0.3, x=-0.32, size=(0.17, 0.17, 0.17)),
        stand("page", "rectangle", "matte", rank=0.5, x=0.72, size=(0.3, 0.4, 0.0), turn_deg=-18.0, lean_deg=12.0,
              detail=3.0, texture="page"),
        stand("tin", "cylinder", "matte", rank=0.6, x=-0.62, size=(0.17, 0.17, 0.3), detail=2.0, texture="label"),
        stand("box", "box", "matte", rank=1.0, x=-0.04, size=(0.22, 0.1, 0.3), turn_deg=28.0, texture="cover"),
        stand("globe", "sphere", "matte", rank=1.0, x=0.34, size=(0.2, 0.2, 0.2), turn_deg=90.0, texture="globe"),
    ]  # fmt: skip
    middle = float(depths[len(depths) // 2])
    for number, named in enumerate(meshes):
        place = named.place_in_view_mm
        at = np.array([fields[middle][:, 0].mean(), top_mm, middle]) if place is None else place
        view_from_thing = np.eye(4)
        view_from_thing[:3, :3], view_from_thing[:3, 3] = _STANDING, at
        found.append(
            Thing(
                name=f"mesh {number}",
                kind="mesh",
                material="matte",
                view_from_thing=view_from_thing,
                size_mm=(0.0, 0.0, 0.0),
                colour=random.uniform(0.15, 0.75, 3),
                file=named.file,
            )
        )
    return tuple(found)


def _about_x(angle_deg: float) -> FloatArray:
    c, s = np.cos(np.deg2rad(angle_deg)), np.sin(np.deg2rad(angle_deg))
    return np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])


def _about_y(angle_deg: float) -> FloatArray:
    c, s = np.cos(np.deg2rad(angle_deg)), np.sin(np.deg2rad(angle_deg))
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])


def shapes_of(thing: Thing, view_from_rig: FloatArray) -> list[Any]:
    """A thing as shapes of Mitsuba in rig, mm."""
    import mitsuba as mi

    rig_from_thing = np.eye(4)
    rig_from_thing[:3] = view_from_rig.T @ thing.view_from_thing[:3]
    width, depth, height = thing.size_mm
    bsdf = _bsdf(thing)

    def load(kind: str, thing_from_shape: FloatArray) -> Any:
        to_world = (rig_from_thing @ thing_from_shape).astype(np.float32)
        return mi.load_dict({"type": kind, "to_world": mi.ScalarTransform4f(to_world), "bsdf": bsdf})

    if thing.kind == "sphere":
        return [load("sphere", np.diag([width / 2, width / 2, width / 2, 1.0]))]
    if thing.kind == "rectangle":
        return [load("rectangle", np.diag([width / 2, depth / 2, 1.0, 1.0]))]
    if thing.kind == "box":
        return [load("cube", np.diag([width / 2, depth / 2, height / 2, 1.0]))]
    if thing.kind == "cylinder":
        ends = [rig_from_thing[:3] @ [0.0, 0.0, z, 1.0] for z in (-height / 2, height / 2)]
        side = {"type": "cylinder", "p0": ends[0].tolist(), "p1": ends[1].tolist(), "radius": width / 2, "bsdf": bsdf}
        lid = np.diag([width / 2, width / 2, 1.0, 1.0])
        lid[2, 3] = height / 2
        return [mi.load_dict(side), load("disk", lid)]
    surface = leaves(float(width), thing.seed) if thing.kind == "leaves" else based(thing)
    points = surface.points @ rig_from_thing[:3, :3].T + rig_from_thing[:3, 3]
    shape = mesh(thing.kind, points, surface.faces.astype(np.int64), bsdf)
    if surface.colours is not None:
        shape.add_attribute("vertex_color", 3, np.float32(surface.colours).ravel())
    return [shape]


def based(thing: Thing) -> Triangles:
    """The mesh of a file, moved so that the middle of its base is the origin; InputError where it cannot be read."""
    assert thing.file is not None
    surface = read_mesh(thing.file)
    low, high = surface.points.min(axis=0), surface.points.max(axis=0)
    return Triangles(surface.points - [*(low[:2] + high[:2]) / 2.0, low[2]], surface.faces)


def check_meshes(layout: Layout, things: tuple[Thing, ...]) -> None:
    """Raise InputError for a mesh that cannot be read or reaches into the camera."""
    for thing in things:
        if thing.kind == "mesh":
            depths = based(thing).points @ thing.view_from_thing[2, :3] + thing.view_from_thing[2, 3]
            if depths.min() < nearest_mm(layout):
                reach = f"reaches to a depth of {depths.min():.0f} mm"
                raise InputError(f"{thing.file}: {reach}, expected no less than {nearest_mm(layout):.0f}")


def _bsdf(thing: Thing) -> dict[str, Any]:
    if thing.material == "glass":
        return {"type": "dielectric", "int_ior": GLASS_INDEX, "ext_ior": 1.0}
    colour = _reflectance(thing)
    if thing.material == "glossy":
        return {"type": "plastic", "int_ior": GLASS_INDEX, "ext_ior": 1.0, "diffuse_reflectance": colour}
    return {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": colour}}


def _reflectance(thing: Thing) -> dict[str, Any]:
    import mitsuba as mi

    if thing.kind == "leaves":
        return {"type": "mesh_attribute", "name": "vertex_color"}
    if thing.texture is None:
        return {"type": "rgb", "value": thing.colour.tolist()}
    width, depth, height = thing.size_mm
    around = {"sphere": (np.pi * width, np.pi * width / 2), "cylinder": (np.pi * width, height)}
    flat = {"rectangle": (width, depth), "box": (max(width, depth), height)}
    size_px = tuple(int(np.clip(thing.texels_per_mm * side, 64, MOST_TEXELS)) for side in (around | flat)[thing.kind])
    picture = texture(thing.texture, (size_px[0], size_px[1]), thing.seed)
    if thing.kind == "cylinder":
        # Its second coordinate grows towards its top.
        picture = picture[::-1].copy()
    return {"type": "bitmap", "bitmap": mi.Bitmap(picture), "raw": True, "wrap_mode": "clamp"}


def lights(things: tuple[Thing, ...], view_from_rig: FloatArray) -> dict[str, Any]:
    """A lamp above, left of and before the desk, and a sky that is equally bright all around, in rig."""
    import mitsuba as mi

    wall = next(thing for thing in things if thing.name == "wall")
    reach = wall.size_mm[0] / 3.2
    target = np.array([wall.view_from_thing[0, 3], wall.view_from_thing[1, 3] + wall.size_mm[1] / 2.0, 0.0])
    target[2] = 0.75 * wall.view_from_thing[2, 3]
    origin = target + reach * np.array([-1.2, -2.4, -1.3])
    side = 0.22 * reach
    look = mi.ScalarTransform4f().look_at(
        origin=(view_from_rig.T @ origin).tolist(),
        target=(view_from_rig.T @ target).tolist(),
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
