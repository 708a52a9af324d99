"""Product picture of a device from the front, with the lens visible in every mirror, and from the side.

The device stands on a seamless paper background between two soft boxes, as it stands on a desk; rig frame, mm.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.render_scenes.fields_of_view import common_bounds
from mirrorcam.render_scenes.reference.device_bodies import ASSEMBLY, Assembly, DeviceBody, check_mirrors, read_assembly
from mirrorcam.render_scenes.reference.integrator import PathOptions, integrator, render
from mirrorcam.render_scenes.reference.mirror_shapes import mesh
from mirrorcam.render_scenes.variant import use_variant

SIZE_PX = (1920, 1080)  # of both views side by side
GAP_PX = 8
MARGIN = 1.08  # size of the picture relative to the extent of the device
PAPER_MM = 4000.0
BEND_MM = 350.0
MAX_LENS_RADIUS_MM = 10.0  # used where the front of a camera is a single plane
# Radius over the lens ring's, and linear RGB: rings that look like a lens.
LENS = ((1.0, (0.55, 0.56, 0.58)), (0.86, (0.006, 0.006, 0.007)), (0.46, (0.01, 0.03, 0.09)), (0.24, (0.0, 0.0, 0.0)))


@dataclass(frozen=True)
class Viewpoint:
    """A pinhole camera at `eye_in_rig_mm` (3,) that looks at `target_in_rig_mm` (3,), where a pixel is `mm_per_px`.

    `up_in_rig` (3,) is up in its pictures.
    """

    eye_in_rig_mm: FloatArray
    target_in_rig_mm: FloatArray
    up_in_rig: FloatArray
    mm_per_px: float
    size_px: tuple[int, int]
    is_pinhole: ClassVar[bool] = True

    @property
    def axes(self) -> FloatArray:
        """Right, down and forward as rows (3, 3)."""
        forward = self.target_in_rig_mm - self.eye_in_rig_mm
        forward = forward / np.linalg.norm(forward)
        right = np.cross(forward, self.up_in_rig)
        right /= np.linalg.norm(right)
        return np.array([right, np.cross(forward, right), forward])

    def ray_through(self, x: Any, y: Any) -> Any:
        """Return the ray (Dr.Jit) through a point of the picture, in pixels from its top left corner."""
        import drjit as dr
        import mitsuba as mi

        width, height = self.size_px
        distance_px = float(np.linalg.norm(self.target_in_rig_mm - self.eye_in_rig_mm)) / self.mm_per_px
        right, down, forward = (mi.Vector3f(*axis.tolist()) for axis in self.axes)
        direction = (x - 0.5 * width) * right + (y - 0.5 * height) * down + distance_px * forward
        return mi.Ray3f(mi.Point3f(*self.eye_in_rig_mm.tolist()), dr.normalize(direction))


def viewpoints(layout: Layout, assembly: Assembly) -> tuple[Viewpoint, Viewpoint]:
    """Return viewpoints at the centre of all mirrors' common field, and obliquely to the front, the side and above.

    From a point that the camera sees in every mirror, its lens is visible in every mirror.
    """
    points = np.concatenate([body.points for body in assembly.bodies])
    level = assembly.stand_from_rig
    low, high = (points @ level.T).min(axis=0), (points @ level.T).max(axis=0)
    centre = (low + high) / 2.0 @ level
    depth_mm = 500.0 if layout.spec is None else max(layout.spec.depths_mm)
    eye = np.array([*common_bounds(layout, depth_mm).mean(axis=0), depth_mm]) @ layout.view_from_rig
    width, height = (SIZE_PX[0] - GAP_PX) // 2, SIZE_PX[1]
    oblique = centre + 4.0 * (high - low).max() * np.array([0.64, 0.70, 0.27]) @ level
    views = []
    for position in (eye, oblique):
        view = Viewpoint(np.asarray(position), centre, level[2], 1.0, (width, height))
        # Wide enough for the farthest point from the centre, seen from the eye.
        points_in_view = (points - position) @ view.axes.T
        distance_mm = np.linalg.norm(centre - position)
        extent_mm = np.abs(points_in_view[:, :2] / points_in_view[:, 2:] * distance_mm).max(axis=0)
        views.append(replace(view, mm_per_px=float(MARGIN * 2.0 * (extent_mm / (width, height)).max())))
    return views[0], views[1]


def product_picture(layout: Layout, folder: Path, *, spp: int, scale: float = 1.0) -> NDArray[np.uint8]:
    """Render the product picture of a device.

    Parameters
    ----------
    layout
        The layout of the device.
    folder
        Folder that `mirrorcam cad` wrote for this layout.
    spp
        Samples per pixel.
    scale
        Size of the picture relative to 1920 x 1080 pixels.

    Returns
    -------
    NDArray[np.uint8]
        Picture (1080, 1920, 3) times `scale`, RGB in sRGB.

    Raises
    ------
    InputError
        If the folder contains no assembly, or the assembly of a different layout.
    """
    if not (folder / ASSEMBLY).is_file():
        raise InputError(f"{folder}: no {ASSEMBLY}, expected a folder that `mirrorcam cad` wrote")
    check_mirrors(folder, layout)
    assembly = read_assembly(folder / ASSEMBLY)
    bodies = assembly.bodies
    use_variant(colour=True)
    import mitsuba as mi

    scene = mi.load_dict({"type": "scene", **_studio(bodies, assembly.stand_from_rig), **_shapes(bodies)})
    paths = integrator(PathOptions(lit=True, colour=True, max_bounces=5))
    pictures = []
    for view in viewpoints(layout, assembly):
        width, height = (round(length * scale) for length in view.size_px)
        scaled = replace(view, mm_per_px=view.mm_per_px / scale, size_px=(width, height))
        light = render(scene, scaled, paths, crop=(0, 0, width, height), subpixels=1, spp=spp, seed=0)
        pictures += [_srgb(light), np.full((height, round(GAP_PX * scale), 3), 255, dtype=np.uint8)]
    return np.concatenate(pictures[:-1], axis=1)


def _srgb(light: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Encode radiance as sRGB; highlights above 0.6 are compressed towards 1."""
    knee = 0.6
    over = np.maximum(light - knee, 0.0) / (1.0 - knee)
    rolled = np.where(light > knee, knee + (1.0 - knee) * over / (1.0 + over), light)
    srgb = np.where(rolled <= 0.0031308, 12.92 * rolled, 1.055 * np.maximum(rolled, 1e-9) ** (1 / 2.4) - 0.055)
    return np.asarray(np.rint(255.0 * srgb.clip(0.0, 1.0)), dtype=np.uint8)


def _shapes(bodies: Sequence[DeviceBody]) -> dict[str, Any]:
    shapes = {
        f"body_{body.name}": mesh(body.name, body.points, body.faces, _material(body), body.normals) for body in bodies
    }
    for body in bodies:
        if body.kind == "camera":
            shapes |= _lens(body)
    return shapes


def _material(body: DeviceBody) -> dict[str, Any]:
    colour = {"type": "rgb", "value": list(body.rgb)}
    if body.kind == "mirror":
        bright = {"type": "rgb", "value": [0.90, 0.92, 0.93]}
        return {"type": "twosided", "bsdf": {"type": "conductor", "material": "none", "specular_reflectance": bright}}
    if body.kind in ("part", "camera"):
        return {"type": "roughplastic", "diffuse_reflectance": colour, "alpha": 0.3 if body.kind == "part" else 0.15}
    return {"type": "roughconductor", "material": "none", "alpha": 0.25, "specular_reflectance": colour}


def _lens(camera: DeviceBody) -> dict[str, Any]:
    """Return rings around the optical axis on the front of the camera."""
    points = camera.points
    front = points[:, 2].max()
    top = points[points[:, 2] > front - 0.01]
    radius = min(float(np.hypot(top[:, 0], top[:, 1]).max()), MAX_LENS_RADIUS_MM)
    angles = np.linspace(0.0, 2.0 * np.pi, 97)[:-1]
    circle = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(96)])
    indices = np.arange(96)
    disc = np.column_stack([np.full(96, 96), indices, np.roll(indices, -1)])
    shapes = {}
    for number, (relative_radius, rgb) in enumerate(LENS):
        rim = circle * radius * relative_radius + [0.0, 0.0, front + 0.05 * (number + 1)]
        corners = np.concatenate([rim, [rim.mean(axis=0)]])
        colour = {"type": "rgb", "value": list(rgb)}
        glass = {"type": "roughplastic", "diffuse_reflectance": colour, "alpha": 0.05}
        shapes[f"lens_{number}"] = mesh("lens", corners, disc, glass, np.tile([0.0, 0.0, 1.0], (97, 1)))
    return shapes


def _studio(bodies: Sequence[DeviceBody], level: FloatArray) -> dict[str, Any]:
    """Return paper under and behind the device, two soft boxes and ambient light."""
    import mitsuba as mi

    points = np.concatenate([body.points for body in bodies]) @ level.T
    low, high = points.min(axis=0), points.max(axis=0)
    centre, size = (low + high) / 2.0, float((high - low).max())
    back = low[1] - 1.2 * size
    angles = np.linspace(0.0, np.pi / 2.0, 33)
    # From in front of the device along the floor, around a bend, and up.
    profile = np.array(
        [(centre[1] + PAPER_MM, 0.0)]
        + [(back - BEND_MM * np.sin(angle), BEND_MM * (1.0 - np.cos(angle))) for angle in angles]
        + [(back - BEND_MM, PAPER_MM)]
    )
    normals = np.array([(0.0, 1.0), *((np.sin(angle), np.cos(angle)) for angle in angles), (1.0, 0.0)])
    sides = (centre[0] + PAPER_MM, centre[0] - PAPER_MM)
    corners = np.array([[x, y, z + low[2]] for x in sides for y, z in profile])
    count = len(profile)
    indices = np.arange(count - 1)
    faces = np.concatenate(
        [
            np.column_stack([indices, indices + 1, indices + count + 1]),
            np.column_stack([indices, indices + count + 1, indices + count]),
        ]
    )
    paper_normals = np.array([[0.0, y, z] for _ in sides for y, z in normals])
    matte = {"type": "diffuse", "reflectance": {"type": "rgb", "value": [0.78, 0.79, 0.80]}}

    def soft_box(
        offset: tuple[float, float, float], size_ratio: float, radiance: tuple[float, float, float]
    ) -> dict[str, Any]:
        origin, target = (centre + size * np.array(offset)) @ level, centre @ level
        frame = mi.ScalarTransform4f().look_at(origin=origin.tolist(), target=target.tolist(), up=level[2].tolist())
        return {
            "type": "rectangle",
            "to_world": frame @ mi.ScalarTransform4f().scale([size_ratio * size, size_ratio * size, 1.0]),
            "bsdf": {"type": "diffuse", "reflectance": {"type": "uniform", "value": 0.0}},
            "emitter": {"type": "area", "radiance": {"type": "rgb", "value": list(radiance)}},
        }

    return {
        "paper": mesh("paper", corners @ level, faces, {"type": "twosided", "bsdf": matte}, paper_normals @ level),
        "key": soft_box((2.4, 2.0, 3.0), 0.9, (12.5, 12.2, 11.7)),
        "fill": soft_box((-3.4, 2.4, 1.0), 1.2, (2.2, 2.3, 2.5)),
        "sky": {"type": "constant", "radiance": {"type": "rgb", "value": [0.30, 0.31, 0.33]}},
    }
