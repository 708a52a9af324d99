"""What each camera sees of a scene: rendered through its lens, with the same lens blur and sensor noise for all.

The scenes of `benchmarks.depth_scenes` are of rooms and gardens, shown in miniature: at a tenth of their size, most of
them lie at 300 to 600 mm.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.cameras_compared.cameras import FOCUS_MM, ComparedCamera
from benchmarks.depth_scenes.rendered_scene import START_MM, RenderedScene, srgb
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.light_field.light_field import LightField, Views
from mirrorcam.render_scenes.settings import SENSORS
from mirrorcam.render_scenes.tabletop.tabletop_scene import RayThrough, pinhole

Float32 = NDArray[np.float32]

SCALE = 10.0
"""Size of a scene relative to its miniature."""
SENSOR = SENSORS["c920"]
SPP, SPP_WIDE = 8, 32
GREY = np.array([0.2126, 0.7152, 0.0722], np.float32)

# Projector of the active camera, between its two imagers.
DOTS, DOT_FIELD_DEG = 5000, (86.0, 57.0)
DOT_PX, PX_PER_DOT_SIGMA = 643.0, 2.0  # sigma of a dot, as 1 / DOT_PX of its distance, and its pixels in the pattern
AMBIENT, DOT_LIGHT = 0.6, 1.5  # light of the room and of the middle of a dot, relative to the light in the visible


def light_of(scene: RenderedScene, camera: ComparedCamera, seed: int) -> Float32:
    """Render linear light (t, s, v, u, c), without noise; zero for views that the camera lacks."""
    views = camera.views
    channels = 1 if camera.is_active else 3
    light = np.zeros((views.rows, views.cols, views.height_px, views.width_px, channels), np.float32)
    for number, (t, s) in enumerate(np.ndindex(views.rows, views.cols)):
        if camera.exists[t, s]:
            picture = _photograph(scene, views, (t, s), camera.aperture_mm, SPP, seed + number)
            if camera.is_active:
                picture = (picture @ GREY) * _dots(views, (t, s), true_depth_mm(scene, views, (t, s)), seed)
                picture = picture[..., None]
            blurred = cv2.GaussianBlur(picture, (0, 0), SENSOR.lens_blur_px, borderType=cv2.BORDER_REFLECT_101)
            light[t, s] = blurred.reshape(light.shape[2:])
    return light


def wide_aperture(scene: RenderedScene, views: Views, position_mm: FloatArray, aperture_mm: float) -> Float32:
    """Render linear light (v, u, 3) through one lens at a position (3,) in the view frame, focused at FOCUS_MM."""
    there = replace(views, positions_mm=position_mm[None, None])
    picture = _photograph(scene, there, (0, 0), aperture_mm, SPP_WIDE if aperture_mm else SPP, 0)
    return np.asarray(cv2.GaussianBlur(picture, (0, 0), SENSOR.lens_blur_px), dtype=np.float32)


def noise_variance(light: Float32, samples: float) -> Float32:
    """Return the variance of samples that average `samples` of the sensor, of linear light 0 to 1."""
    grey = np.maximum(light, 0.0) * np.float32(255.0)
    variance = grey * np.float32(255.0 / SENSOR.full_well_electrons) + np.float32(SENSOR.read_noise_grey**2)
    return variance / np.float32(255.0**2 * samples)


def with_noise(camera: ComparedCamera, light: Float32, seed: int) -> LightField:
    """Return the light field in 8-bit sRGB that the camera's sensor reads from light (t, s, v, u, c)."""
    random = np.random.default_rng(seed)
    noise = random.standard_normal(light.shape, dtype=np.float32) * np.sqrt(noise_variance(light, camera.samples))
    exists = camera.exists[..., None, None].astype(np.float32)
    samples = srgb(light + noise) * exists[..., None].astype(np.uint8)
    return LightField.of(camera.views, samples, np.broadcast_to(exists, light.shape[:4]).copy())


def true_depth_mm(scene: RenderedScene, views: Views, index: tuple[int, int]) -> Float32:
    """Return the depth (v, u) that a view sees, mm; infinite without a surface."""
    return scene.depth_mm(_enlarged(views), *index) / np.float32(SCALE)


def _enlarged(views: Views) -> Views:
    """Return the views for the scene at full size."""
    return replace(
        views,
        positions_mm=SCALE * views.positions_mm,
        reference_depth_mm=SCALE * views.reference_depth_mm,
        reference_view_in_rig_mm=SCALE * views.reference_view_in_rig_mm,
    )


def _photograph(
    scene: RenderedScene, views: Views, index: tuple[int, int], aperture_mm: float, spp: int, seed: int
) -> Float32:
    lens = _lens(_enlarged(views), index, SCALE * aperture_mm)
    return scene.light(views, lens, is_pinhole=False, spp=spp, seed=seed)


def _lens(views: Views, index: tuple[int, int], aperture_mm: float) -> RayThrough:
    """Return the rays of a thin lens in place of a view's pinhole, focused on the reference plane."""
    import drjit as dr
    import mitsuba as mi

    chief = pinhole(views, *index, START_MM)
    centre = views.reference_view_in_rig_mm + views.positions_mm[index]
    diameter, to_focus, to_start = (
        mi.Float(float(value)) for value in (aperture_mm, views.reference_depth_mm - centre[2], START_MM - centre[2])
    )
    origin = mi.Point3f(*centre.tolist())
    dr.make_opaque(diameter, to_focus, to_start, origin)

    def ray_through(x: Any, y: Any, u: Any, v: Any) -> Any:
        direction = chief(x, y, u, v).d
        disc = mi.warp.square_to_uniform_disk_concentric(mi.Point2f(u, v))
        radius = diameter * 0.5
        offset: Any = mi.Vector3f(disc.x * radius, disc.y * radius, 0.0)
        through = direction * (to_focus / direction.z) - offset
        return mi.Ray3f(origin + offset + through * (to_start / through.z), dr.normalize(through))

    return ray_through


def _dots(views: Views, index: tuple[int, int], depth_mm: Float32, seed: int) -> Float32:
    """Return the light (v, u) of the room and of the projected dots on the surfaces that a view sees."""
    extent = np.tan(np.radians(DOT_FIELD_DEG) / 2.0)
    px = DOT_PX * PX_PER_DOT_SIGMA
    width, height = (int(2.0 * side * px) for side in extent)
    pattern = np.zeros((height, width), np.float32)
    random = np.random.default_rng(seed)
    pattern[random.integers(0, height, DOTS), random.integers(0, width, DOTS)] = 2.0 * np.pi * PX_PER_DOT_SIGMA**2
    pattern = np.asarray(cv2.GaussianBlur(pattern, (0, 0), PX_PER_DOT_SIGMA), dtype=np.float32)
    centre = views.reference_view_in_rig_mm + views.positions_mm[index]
    on_plane = views.plane_points_in_rig(FOCUS_MM, views.pixel_grid(), index)
    direction = (on_plane - centre)[..., :2] / (FOCUS_MM - centre[2])
    with np.errstate(invalid="ignore"):
        slope = direction + centre[:2] / depth_mm[..., None]  # seen from the projector, at the origin
    u, v = (np.moveaxis(slope + extent, -1, 0) * px).astype(np.float32)
    return np.float32(AMBIENT) + np.float32(DOT_LIGHT) * cv2.remap(pattern, u, v, cv2.INTER_LINEAR)
