"""A scene of surfaces and lamps in Mitsuba, its pictures from pinholes, and the true depths of their pixels.

A scene is described in its own frame (x right, y away, z up, mm) and rendered in the frame of its central view, which
is also the rig of its light field (x right, y down, z forward).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.depth_scenes.patterns import Pattern
from benchmarks.depth_scenes.surfaces import Surface
from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.transforms import transform
from mirrorcam.optics.light_field.light_field import Views
from mirrorcam.render_scenes.reference.mirror_shapes import mesh
from mirrorcam.render_scenes.tabletop.tabletop_scene import RayThrough, pinhole, pinhole_rays, render_lit
from mirrorcam.render_scenes.variant import SCALAR, use_variant

Triple = tuple[float, float, float]
Kind = Literal["matte", "glossy", "satin", "metal", "mirror"]

VIEWS = 9
"""Number of rows and of columns of the complete grid, as in the 4D Light Field Benchmark."""
STEP_MM, FOCUS_MM = 10.0, 4000.0
START_MM = 100.0
"""Depth at which the rays of a view start: nearer than all that it should show."""
FOCAL_IN_WIDTHS = 100.0 / 35.0  # focal length and sensor of the benchmark's cameras
SOFTNESS_PX = 0.4  # sigma of the Gaussian that a pixel averages over
PLASTIC_INDEX = 1.5
MAX_INDIRECT = 1.0  # linear grey that light by way of another surface may add to a sample
EDGE_PX = 0.1
"""Minimum step of disparity, per step of the complete grid, at a depth edge."""


@dataclass(frozen=True, eq=False)
class Finish:
    """How a surface reflects: `pattern` repeats every `tile_mm`; metals and mirrors have one `colour`."""

    kind: Kind = "matte"
    pattern: Pattern | None = None
    tile_mm: float = 1000.0
    colour: Triple = (0.5, 0.5, 0.5)
    roughness: float = 0.15


@dataclass(frozen=True, eq=False)
class Item:
    """An object of a scene."""

    name: str
    surface: Surface
    finish: Finish


@dataclass(frozen=True)
class Lamp:
    """A rectangular lamp centred at `position`, facing `target`, with the half sides `half_mm`."""

    position: Triple
    target: Triple
    half_mm: tuple[float, float]
    radiance: Triple


@dataclass(frozen=True, eq=False)
class Scene:
    """A scene: its objects, its light, and the position of the central view.

    Attributes
    ----------
    items, lamps
        Objects and lamps.
    sky
        Radiance beyond all surfaces.
    eye_mm
        Height of the central view above the origin of the scene.
    pitch_deg
        Angle by which the central view looks down.
    exposure
        Factor from radiance to linear grey, 1 for white.
    """

    items: tuple[Item, ...]
    lamps: tuple[Lamp, ...]
    sky: Triple
    eye_mm: float
    pitch_deg: float
    exposure: float = 1.0

    @property
    def view_from_scene(self) -> FloatArray:
        """Transform (4, 4) from the scene's frame to that of the central view."""
        pitch = np.radians(self.pitch_deg)
        rotation = np.array(
            [[1.0, 0.0, 0.0], [0.0, -np.sin(pitch), -np.cos(pitch)], [0.0, np.cos(pitch), -np.sin(pitch)]]
        )
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = rotation, -rotation @ [0.0, 0.0, self.eye_mm]
        return pose


def depth_views(count: int, size_px: int, spread: float = 1.0) -> Views:
    """`count` x `count` views of `size_px` x `size_px` pixels, over `spread` times the complete grid of VIEWS."""
    if count < 2 or (VIEWS - 1) % (count - 1) or count % 2 == 0:
        raise InputError(f"{count} views, expected 3, 5 or {VIEWS}: an even subset with the central one")
    offsets = (np.arange(count) - count // 2) * (spread * STEP_MM * (VIEWS - 1) / (count - 1))
    return Views(
        positions_mm=np.stack([*np.meshgrid(offsets, offsets), np.zeros((count, count))], axis=-1),
        focal_px=FOCAL_IN_WIDTHS * size_px,
        centre_px=np.full(2, (size_px - 1) / 2.0),
        width_px=size_px,
        height_px=size_px,
        reference_depth_mm=FOCUS_MM,
        reference_view_in_rig_mm=np.zeros(3),
        view_from_rig=np.eye(3),
        layout_identity="",
    )


class RenderedScene:
    """A scene in Mitsuba. Raises InputError if no backend compiles."""

    def __init__(self, scene: Scene):
        self.variant = use_variant(colour=True)
        if self.variant == SCALAR:
            raise InputError("a scene in colour needs a GPU or an LLVM that compiles: pip install karellen-llvm-core")
        import mitsuba as mi

        self.scene = scene
        pose = scene.view_from_scene
        shapes = {f"item_{number}": _shape(item, pose) for number, item in enumerate(scene.items)}
        lamps = {f"lamp_{number}": _lamp(lamp, pose) for number, lamp in enumerate(scene.lamps)}
        sky = {"type": "constant", "radiance": {"type": "rgb", "value": list(scene.sky)}}
        self._scene = mi.load_dict({"type": "scene", "sky": sky, **lamps, **shapes})

    def picture(self, views: Views, t: int, s: int, *, spp: int) -> NDArray[np.uint8]:
        """Render a view (v, u, 3) in 8-bit sRGB; its position in the complete grid determines the random numbers."""
        use_variant(self.variant)  # before `pinhole` makes values of the variant
        row, column = (round(offset) for offset in views.positions_mm[t, s, 1::-1] / STEP_MM)
        ray_through = _gaussian_pixels(pinhole(views, t, s, START_MM))
        seed = (100 * (row + VIEWS) + column + VIEWS) % 2**31
        return srgb(self.light(views, ray_through, is_pinhole=True, spp=spp, seed=seed))

    def light(
        self, views: Views, ray_through: RayThrough, *, is_pinhole: bool, spp: int, seed: int
    ) -> NDArray[np.float32]:
        """Render linear light (v, u, 3), 1 for white, of a camera with the views' number of pixels."""
        use_variant(self.variant)
        light = render_lit(
            self._scene,
            ray_through,
            is_pinhole=is_pinhole,
            size=(views.width_px, views.height_px),
            subpixels=1,
            spp=spp,
            seed=seed,
            via_mirrors=False,
            max_indirect=MAX_INDIRECT / self.scene.exposure,
        )
        return light * np.float32(self.scene.exposure)

    def depth_mm(self, views: Views, t: int, s: int) -> NDArray[np.float32]:
        """Return the depth (v, u) of the first surface at each pixel centre of a view; infinite without one."""
        use_variant(self.variant)
        import mitsuba as mi

        start, direction = pinhole_rays(views, t, s, START_MM)
        rays = mi.Ray3f(*(mi.Point3f(np.float32(vectors.reshape(-1, 3).T)) for vectors in (start, direction)))
        length = np.array(self._scene.ray_intersect_preliminary(rays).t, dtype=np.float64)
        return (START_MM + length.reshape(start.shape[:2]) * direction[..., 2]).astype(np.float32)

    def edges(self, views: Views) -> NDArray[np.bool_]:
        """Return the pixels (v, u) of the central view that show surfaces with disparities EDGE_PX or more apart."""
        fine = depth_views(views.rows, 3 * views.width_px)
        # Disparity per step of the whole grid, in px of `views`.
        depth = self.depth_mm(fine, views.rows // 2, views.cols // 2).astype(np.float64)
        disparity = (views.focal_px * STEP_MM * (1.0 / depth - 1.0 / FOCUS_MM)).astype(np.float32)
        kernel = np.ones((5, 5), np.uint8)  # fine pixels: what the Gaussian of a pixel reaches
        spread = cv2.dilate(disparity, kernel) - cv2.erode(disparity, kernel)
        return np.asarray(spread[1::3, 1::3] > EDGE_PX)


def srgb(light: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Encode linear grey, 0 to 1, as 8-bit sRGB (IEC 61966-2-1)."""
    clipped = np.clip(light.astype(np.float64), 0.0, 1.0)
    encoded = np.where(clipped <= 0.0031308, 12.92 * clipped, 1.055 * clipped ** (1.0 / 2.4) - 0.055)
    return np.rint(255.0 * encoded).astype(np.uint8)


def _gaussian_pixels(ray_of_point: RayThrough) -> RayThrough:
    """Distribute rays about the centre of a pixel as a Gaussian, instead of uniformly over its square."""
    import drjit as dr

    spread = float(SOFTNESS_PX * np.sqrt(2.0))

    def spread_out(coordinate: Any) -> Any:
        corner = dr.floor(coordinate)
        fraction = dr.clip(coordinate - corner, 1e-4, 1.0 - 1e-4)
        return corner + 0.5 + spread * dr.erfinv(2.0 * fraction - 1.0)

    def ray_through(x: Any, y: Any, u: Any, v: Any) -> Any:
        return ray_of_point(spread_out(x), spread_out(y), u, v)

    return ray_through


def _shape(item: Item, view_from_scene: FloatArray) -> Any:
    surface, finish = item.surface, item.finish
    normals = None if surface.normals is None else surface.normals @ view_from_scene[:3, :3].T
    return mesh(
        item.name,
        transform(view_from_scene, surface.points),
        surface.faces,
        _bsdf(finish),
        normals,
        surface.texture_mm / finish.tile_mm,
    )


def _bsdf(finish: Finish) -> dict[str, Any]:
    import mitsuba as mi

    colour: dict[str, Any] = {"type": "rgb", "value": list(finish.colour)}
    if finish.pattern is not None:
        colour = {"type": "bitmap", "bitmap": mi.Bitmap(finish.pattern), "raw": True, "wrap_mode": "repeat"}
    plastic = {"int_ior": PLASTIC_INDEX, "ext_ior": 1.0, "diffuse_reflectance": colour}
    metal = {"material": "none", "specular_reflectance": colour}
    inner = {
        "matte": {"type": "diffuse", "reflectance": colour},
        "glossy": {"type": "plastic", **plastic},
        "satin": {"type": "roughplastic", "alpha": finish.roughness, **plastic},
        "metal": {"type": "roughconductor", "alpha": finish.roughness, **metal},
        "mirror": {"type": "conductor", **metal},
    }[finish.kind]
    return {"type": "twosided", "bsdf": inner}


def _lamp(lamp: Lamp, view_from_scene: FloatArray) -> dict[str, Any]:
    import mitsuba as mi

    position, target = transform(view_from_scene, np.array([lamp.position, lamp.target]))
    direction = target - position
    up = np.eye(3)[np.abs(direction).argmin()]
    to_world = mi.ScalarTransform4f().look_at(origin=position.tolist(), target=target.tolist(), up=up.tolist())
    return {
        "type": "rectangle",
        "to_world": to_world @ mi.ScalarTransform4f().scale([*lamp.half_mm, 1.0]),
        "bsdf": {"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.0}},
        "emitter": {"type": "area", "radiance": {"type": "rgb", "value": list(lamp.radiance)}},
    }
