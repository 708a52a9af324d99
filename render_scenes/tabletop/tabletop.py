"""Arrangement of a tabletop scene: objects of several kinds at given depths in the common field of all views.

Positions are in view axes (x right, y down, z forward, origin at the pupil, mm). Positions and sizes are proportional
to the common field of the mirrors at the depth of an object, so one arrangement suits a camera of any size.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray, Value, Vector3
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.transforms import rigid
from mirrorcam.render_scenes.fields_of_view import common_bounds
from mirrorcam.render_scenes.sets.poses import CLEARANCE_MM
from mirrorcam.render_scenes.tabletop.objects import Kind, Material, SceneObject, TextureName, colours, mesh_surface

WALL_RELATIVE_DEPTH = 1.2  # depth of the wall, relative to the farthest objects
WALL_RELATIVE_SIZE = 3.2  # its width and height, relative to the common field at their depth
MIN_CLEARANCE = 0.25  # clearance between mirrors and nearest object, relative to its depth
TEXELS_PER_PX = 1.25  # texels of a texture per pixel of the central view
# view_from_object of objects on the table (x right, y away from the camera, z up); pictures have view axes.
_STANDING = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])


@dataclass(frozen=True)
class _Placement:
    """Placement of an object: `depth_fraction` 0 is the nearest depth, 1 the farthest; `x` is in half field widths.

    `size` and the `height` above the table are in field widths. `detail` scales the texture resolution.
    """

    name: str
    kind: Kind
    material: Material
    depth_fraction: float
    x: float
    size: tuple[float, float, float]
    height: float = 0.0
    yaw_deg: float = 0.0
    tilt_deg: float = 0.0
    texture: TextureName | None = None
    detail: float = 1.0


# fmt: off
_PLACEMENTS = (
    _Placement("twigs", "leaves", "matte", 0.0, -0.9, (0.34, 0.34, 0.34), height=0.2),
    _Placement("glass ball", "sphere", "glass", 0.0, 0.04, (0.16, 0.16, 0.16)),
    _Placement("glossy ball", "sphere", "glossy", 0.3, -0.32, (0.17, 0.17, 0.17)),
    _Placement("page", "rectangle", "matte", 0.5, 0.72, (0.3, 0.4, 0.0), yaw_deg=-18.0, tilt_deg=12.0,
           texture="page", detail=3.0),
    _Placement("tin", "cylinder", "matte", 0.6, -0.62, (0.17, 0.17, 0.3), texture="label", detail=2.0),
    _Placement("box", "box", "matte", 1.0, -0.04, (0.22, 0.1, 0.3), yaw_deg=28.0, texture="cover"),
    _Placement("globe", "sphere", "matte", 1.0, 0.34, (0.2, 0.2, 0.2), yaw_deg=90.0, texture="globe"),
)
# fmt: on


class UserMesh(Value):
    """A user-supplied mesh: its file, in mm with z up, and where the centre of its base goes, in view axes, mm."""

    file: Path
    position_in_view_mm: Vector3 | None = None


def clear_depth_mm(layout: Layout) -> float:
    """Return the minimum depth at which an object is clear of the mirrors."""
    return max(float((m.outline_in_rig_mm @ layout.view_from_rig[2]).max()) for m in layout.mirrors) + CLEARANCE_MM


@dataclass(frozen=True)
class Tabletop:
    """Objects, the target (3,) of the area light, and the scale of the arrangement: its common field's width."""

    objects: tuple[SceneObject, ...]
    lamp_target_in_view_mm: FloatArray
    scale_mm: float


def arrange_tabletop(
    layout: Layout, depths_mm: tuple[float, ...], seed: int, meshes: tuple[UserMesh, ...] = ()
) -> Tabletop:
    """Arrange objects on a table in front of a wall; the seed changes only colours, textures and small shifts.

    Parameters
    ----------
    layout
        Layout whose common field the arrangement fills.
    depths_mm
        Depths of the objects, ascending.
    seed
        Seed of colours, textures and shifts.
    meshes
        Additional, user-supplied meshes.

    Raises
    ------
    InputError
        If depths do not ascend, or objects would touch the camera.
    """
    depths = _checked_depths(layout, depths_mm)
    random = np.random.default_rng(seed)
    centre_z_mm = layout.virtual_centres_in_view_mm.reshape(-1, 3)[layout.central_index, 2]
    texel_scale = TEXELS_PER_PX * layout.camera.fx_px
    near, middle, far = (float(depths[index]) for index in (0, len(depths) // 2, -1))
    fields = {float(depth): common_bounds(layout, depth) for depth in depths}
    wall, front = WALL_RELATIVE_DEPTH * far, 0.5 * (near + clear_depth_mm(layout))
    width, height = WALL_RELATIVE_SIZE * np.ptp(fields[far], axis=0)
    x, top = fields[far][:, 0].mean(), fields[near][1, 1] - 0.06 * np.ptp(fields[near], axis=0)[1]
    seeds = random.integers(2**31, size=2)
    upright = rigid(np.eye(3), [x, top - height / 2.0, wall])
    lying = rigid(_STANDING, [x, top, (front + wall) / 2.0])
    objects = [
        _rectangle("wall", upright, (width, height), "poster", texel_scale / (wall - centre_z_mm), int(seeds[0])),
        _rectangle("desk", lying, (width, wall - front), "wood", texel_scale / (near - centre_z_mm), int(seeds[1])),
    ]
    for placement in _PLACEMENTS:
        depth = float(depths[round(placement.depth_fraction * (len(depths) - 1))])
        texels_per_mm = texel_scale / (depth - centre_z_mm)
        objects.append(_placed_object(placement, depth, fields[depth][:, 0], top, texels_per_mm, random))
    for number, mesh in enumerate(meshes):
        default = [fields[middle][:, 0].mean(), top, middle]
        position = default if mesh.position_in_view_mm is None else mesh.position_in_view_mm
        objects.append(
            SceneObject(
                name=f"mesh {number}",
                kind="mesh",
                material="matte",
                view_from_object=rigid(_STANDING, position),
                size_mm=(0.0, 0.0, 0.0),
                colour=colours(random, 1)[0],
                file=mesh.file,
            )
        )
    return Tabletop(tuple(objects), np.array([x, top, 0.75 * wall]), width / WALL_RELATIVE_SIZE)


def _checked_depths(layout: Layout, depths_mm: tuple[float, ...]) -> FloatArray:
    depths = np.array(depths_mm)
    if len(depths) < 1 or (np.diff(depths) <= 0).any():
        raise InputError(f"depths {', '.join(f'{d:g}' for d in depths)} mm: expected one or more, ascending")
    if depths[0] < clear_depth_mm(layout) + MIN_CLEARANCE * depths[0]:
        min_depth_mm = clear_depth_mm(layout) / (1.0 - MIN_CLEARANCE)
        raise InputError(
            f"depth {depths[0]:g} mm: an object there would touch the camera, expected {min_depth_mm:.0f} or more"
        )
    return depths


def _rectangle(
    name: str,
    view_from_object: FloatArray,
    size_mm: tuple[float, float],
    picture: TextureName,
    texels_per_mm: float,
    seed: int,
) -> SceneObject:
    return SceneObject(
        name=name,
        kind="rectangle",
        material="matte",
        view_from_object=view_from_object,
        size_mm=(*size_mm, 0.0),
        texture=picture,
        texels_per_mm=texels_per_mm,
        seed=seed,
    )


def _placed_object(
    placement: _Placement,
    depth: float,
    field_mm: FloatArray,
    top_mm: float,
    texels_per_mm: float,
    random: np.random.Generator,
) -> SceneObject:
    """Return the object of a placement on a table at y = `top_mm`; `field_mm` is (left, right) of the field."""
    left, right = field_mm
    size_mm = np.array(placement.size) * (right - left)
    heights = {"sphere": size_mm[0], "rectangle": size_mm[1] * np.cos(np.deg2rad(placement.tilt_deg))}
    position = [
        (left + right) / 2.0 + (right - left) / 2.0 * (placement.x + random.uniform(-0.04, 0.04)),
        top_mm - heights.get(placement.kind, size_mm[2]) / 2.0 - placement.height * (right - left),
        depth,
    ]
    upright = np.eye(3) if placement.kind == "rectangle" else _STANDING
    rotation = Rotation.from_euler("YX", [placement.yaw_deg, -placement.tilt_deg], degrees=True).as_matrix() @ upright
    return SceneObject(
        name=placement.name,
        kind=placement.kind,
        material=placement.material,
        view_from_object=rigid(rotation, position),
        size_mm=size_mm,
        texture=placement.texture,
        texels_per_mm=placement.detail * texels_per_mm,
        seed=int(random.integers(2**31)),
        colour=colours(random, 1)[0],
    )


def check_meshes(layout: Layout, objects: tuple[SceneObject, ...]) -> None:
    """Raise InputError for a mesh that is unreadable or reaches into the camera."""
    for item in objects:
        if item.kind == "mesh":
            depths = mesh_surface(item).points @ item.view_from_object[2, :3] + item.view_from_object[2, 3]
            if depths.min() < clear_depth_mm(layout):
                reason = f"reaches to a depth of {depths.min():.0f} mm"
                name = item.file or item.name or "a mesh"
                raise InputError(f"{name}: {reason}, expected no less than {clear_depth_mm(layout):.0f}")
