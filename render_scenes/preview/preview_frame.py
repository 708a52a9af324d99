"""A preview of a layout's picture, rendered in a fraction of a second for interactive design.

Rays are traced via flat mirrors to the objects of `mirrorcam scene` or to a board, with the geometry of the reference
renderer. Shading is approximate: indirect light is estimated roughly, glossy objects and glass reflect once and do not
show the mirrors, and glass plates have no ghosts. A pixel's blur depends on the apparent distance of its object.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from mirrorcam.core.bounds import Bounds
from mirrorcam.core.compiled import compiled, inlined
from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.boards import CalibrationBoard, default_board
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.transforms import rigid
from mirrorcam.optics.light_field.decoder import default_reference_depth_mm
from mirrorcam.render_scenes.fields_of_view import common_bounds
from mirrorcam.render_scenes.lens import MIN_BLUR_PX, defocused, undistorted_pixels
from mirrorcam.render_scenes.preview.mirror_views import (
    INDEX,
    MIN_PUPIL_FRACTION,
    WINDOW,
    MirrorViews,
    mirror_views,
    pupil_fraction,
    reflectance_and_shift,
    scene_ray,
    scene_ray_step,
)
from mirrorcam.render_scenes.preview.ray_colour import ray_colour
from mirrorcam.render_scenes.preview.traced_scene import KIND, TRIANGLES, TracedScene, traced_board, traced_tabletop
from mirrorcam.render_scenes.preview.triangle_tree import NOTHING, add_scaled, scale
from mirrorcam.render_scenes.sets.sensor_model import photograph
from mirrorcam.render_scenes.settings import SENSORS, RenderSettings, SensorModel
from mirrorcam.render_scenes.tabletop.tabletop import MIN_CLEARANCE, Tabletop, arrange_tabletop, clear_depth_mm
from mirrorcam.render_scenes.tabletop.tabletop_set import default_depths_mm

Subject = Literal["tabletop", "board"]

TEXTURE_PX: dict[str, tuple[int, int]] = {
    "poster": (1152, 768),
    "wood": (1536, 960),
    "page": (384, 516),
    "label": (432, 240),
    "cover": (144, 144),
    "globe": (240, 120),
}
"""Columns and rows of textures: about the resolution of nine views in a picture of 1000 px."""
BOARD_ROTATION_DEG = (-12.0, 18.0)
"""Rotations of the board about x and y."""


def arranged_tabletop(layout: Layout, seed: int, sized_for: Layout | None = None) -> Tabletop:
    """Return the tabletop scene of a layout, with textures of the same size for every layout.

    With `sized_for`, this is the scene of that layout, shifted to the centre of the field of `layout`.

    A random texture depends on its size: a fixed size keeps it the same while the design, or the size of its picture,
    changes. The depths are those that the layout was designed for, unless the mirrors leave no room there.
    """
    source = layout if sized_for is None else sized_for
    min_depth_mm = clear_depth_mm(source) / (1.0 - MIN_CLEARANCE) + 1.0
    depths = tuple(sorted({max(depth, min_depth_mm) for depth in default_depths_mm(source)}))
    arranged = arrange_tabletop(source, depths, seed)
    middle_depth = depths[len(depths) // 2]
    shift = np.append(_centre_mm(layout, middle_depth) - _centre_mm(source, middle_depth), 0.0)
    objects = tuple(
        item.replaced(
            view_from_object=rigid(np.eye(3), shift) @ item.view_from_object,
            texture_px=TEXTURE_PX[item.texture] if isinstance(item.texture, str) else None,
        )
        for item in arranged.objects
    )
    return Tabletop(objects, arranged.lamp_target_in_view_mm + shift, arranged.scale_mm)


def view_from_board(layout: Layout, board: CalibrationBoard) -> FloatArray:
    """Return the pose (4, 4) of a slightly tilted board in view axes, mm, in the common field at the middle depth."""
    depth = max(default_reference_depth_mm(layout), clear_depth_mm(layout) + 0.5 * float(np.linalg.norm(board.size_mm)))
    rotation = Rotation.from_euler("XY", BOARD_ROTATION_DEG, degrees=True).as_matrix()
    centre = np.append(_centre_mm(layout, depth), depth)
    return rigid(rotation, centre - rotation @ np.array([*board.size_mm, 0.0]) / 2.0)


def _centre_mm(layout: Layout, depth_mm: float) -> FloatArray:
    """Return the centre (2,) of the common field at a depth, in view x and y."""
    return np.asarray(common_bounds(layout, depth_mm).mean(axis=0))


MAX_BLUR_PX = 20.0
"""Maximum standard deviation of the blur."""


def out_of_focus(radiance: NDArray[np.float32], along_axis_mm: FloatArray, camera: Camera) -> NDArray[np.float32]:
    """Blur a picture (h, w, 3) with a camera's circle of confusion, for objects at distances (h, w) along the axis.

    A disc with diameter d = f A |1 / focus - 1 / distance| has the variance d^2 / 16. Each pixel gathers light from
    its own disc, so that near objects do not spread over far ones at an edge.
    """
    if camera.aperture_mm == 0.0:
        return radiance
    defocus = 1.0 / along_axis_mm - 1.0 / camera.focus_mm
    variance = np.square(camera.fx_px * camera.aperture_mm / 4.0 * defocus).clip(max=MAX_BLUR_PX**2)
    if variance.max() < MIN_BLUR_PX**2:
        return radiance
    variance_px2 = variance.astype(np.float32)
    return np.stack([defocused(np.ascontiguousarray(radiance[..., c]), variance_px2, 1) for c in range(3)], axis=-1)


PARTS = 8
"""Multiplier of an object's number when it is combined with a part number."""


@dataclass(frozen=True, eq=False)
class SensorLight:
    """Light on the pixels of a sensor, and each pixel's object via the mirror that fills most of the pupil.

    Attributes
    ----------
    radiance
        (h, w, 3), float32.
    mirror
        (h, w): number of the mirror, or -1.
    object_number
        (h, w): number of the object, or -1.
    depth_mm
        (h, w): depth of the object along view z; infinite without one.
    along_axis_mm
        (h, w): apparent distance of the object along the axis of the camera; infinite without one.
    """

    radiance: NDArray[np.float32]
    mirror: NDArray[np.int32]
    object_number: NDArray[np.int32]
    depth_mm: FloatArray
    along_axis_mm: FloatArray


def sensor_light(camera: Camera, mirrors: MirrorViews, scene: TracedScene) -> SensorLight:
    """Trace one ray per pixel and visible mirror, and four in it where an adjacent pixel shows a different object."""
    normalized = rays_of_pixels(camera.model_dump_json())
    shape = normalized.shape[:2]
    radiance = np.zeros((*shape, 3), dtype=np.float32)
    mirror, object_number = np.full(shape, NOTHING, np.int32), np.full(shape, NOTHING, np.int32)
    depth, along_axis = np.full(shape, np.inf), np.full(shape, np.inf)
    _trace(normalized, mirrors, scene, radiance, mirror, object_number, depth, along_axis)
    return SensorLight(radiance, mirror, object_number // PARTS, depth, along_axis)


@lru_cache(maxsize=4)
def rays_of_pixels(camera: str) -> FloatArray:
    """Return normalized coordinates (h, w, 2) of the pixels of a camera, given as JSON; NaN where there is no ray."""
    lens = Camera.model_validate_json(camera)
    columns, rows = np.arange(lens.width_px, dtype=np.float64), np.arange(lens.height_px, dtype=np.float64)
    if lens.is_undistorted:
        return lens.normalized_from_pixels(np.stack(np.meshgrid(columns, rows), axis=-1))
    return undistorted_pixels(lens, columns, rows)


@compiled
def _trace(
    normalized: Any,
    mirrors: Any,
    scene: Any,
    radiance: Any,
    mirror: Any,
    object_number: Any,
    depth: Any,
    along_axis: Any,
) -> None:
    """Fill the arrays of `SensorLight`; `object_number` is `PARTS` times the object's number, plus its part."""
    height, width = mirror.shape
    free = np.ones((height, width))
    best = np.zeros((height, width))
    object_parts = np.empty((height, width), np.int32)
    colour = np.empty((height, width, 3), np.float32)
    weight = np.empty((height, width))
    for number in range(len(mirrors.table)):
        top, bottom = int(mirrors.table[number, WINDOW]), int(mirrors.table[number, WINDOW + 1])
        left, right = int(mirrors.table[number, WINDOW + 2]), int(mirrors.table[number, WINDOW + 3])
        for v in range(top, bottom):
            for u in range(left, right):
                x, y = normalized[v, u, 0], normalized[v, u, 1]
                object_parts[v, u] = NOTHING
                # NaN, for a pixel without a ray, also fails this comparison.
                fraction = min(pupil_fraction(mirrors, number, x, y), free[v, u])
                if not fraction > MIN_PUPIL_FRACTION:
                    weight[v, u] = 0.0
                    continue
                free[v, u] -= fraction
                reflectance, shift_mm = reflectance_and_shift(mirrors, number, x, y)
                weight[v, u] = fraction * reflectance
                start, direction, t_min = scene_ray(mirrors, number, x, y, shift_mm)
                right_step, down_step = _steps(normalized, mirrors, number, v, u)
                ray_rgb, item, part, t = ray_colour(scene, start, direction, t_min, right_step, down_step)
                part = part % PARTS if item != NOTHING and int(scene.objects[item, KIND]) != TRIANGLES else 0
                object_parts[v, u] = item * PARTS + part
                colour[v, u, 0], colour[v, u, 1], colour[v, u, 2] = ray_rgb
                if fraction > best[v, u]:
                    best[v, u] = fraction
                    mirror[v, u] = int(mirrors.table[number, INDEX])
                    object_number[v, u] = object_parts[v, u]
                    depth[v, u] = start[2] + t * direction[2] if item != NOTHING else np.inf
                    along_axis[v, u] = t
        for v in range(top, bottom):
            for u in range(left, right):
                if weight[v, u] == 0.0:
                    continue
                if _at_edge(object_parts, weight, v, u, top, bottom, left, right):
                    _smooth(normalized, mirrors, scene, number, v, u, colour)
                for channel in range(3):
                    radiance[v, u, channel] += weight[v, u] * colour[v, u, channel]


@inlined
def _steps(normalized: Any, mirrors: Any, number: Any, v: Any, u: Any) -> Any:
    """Return the changes of the ray direction from a pixel to the next on the right and below."""
    height, width = normalized.shape[:2]
    a, b = min(u, width - 2), min(v, height - 2)
    right = scene_ray_step(
        mirrors,
        number,
        normalized[v, a + 1, 0] - normalized[v, a, 0],
        normalized[v, a + 1, 1] - normalized[v, a, 1],
    )
    down = scene_ray_step(
        mirrors,
        number,
        normalized[b + 1, u, 0] - normalized[b, u, 0],
        normalized[b + 1, u, 1] - normalized[b, u, 1],
    )
    return right, down


@inlined
def _at_edge(object_parts: Any, weight: Any, v: Any, u: Any, top: Any, bottom: Any, left: Any, right: Any) -> Any:
    """Return whether an adjacent pixel shows another part or object via the same mirror."""
    index = object_parts[v, u]
    for dv, du in ((-1, 0), (1, 0), (0, -1), (0, 1)):
        b, a = v + dv, u + du
        if top <= b < bottom and left <= a < right and weight[b, a] > 0.0 and object_parts[b, a] != index:
            return True
    return False


@inlined
def _smooth(normalized: Any, mirrors: Any, scene: Any, number: Any, v: Any, u: Any, colour: Any) -> None:
    """Replace the colour at the centre of a pixel by the mean of four points in the pixel."""
    x, y = normalized[v, u, 0], normalized[v, u, 1]
    _, shift_mm = reflectance_and_shift(mirrors, number, x, y)
    start, direction, t_min = scene_ray(mirrors, number, x, y, shift_mm)
    right, down = _steps(normalized, mirrors, number, v, u)
    total = (float(colour[v, u, 0]), float(colour[v, u, 1]), float(colour[v, u, 2]))
    half_right, half_down = scale(right, 0.5), scale(down, 0.5)
    for x_offset, y_offset in ((0.0, -0.35), (0.3, 0.175), (-0.3, 0.175)):
        towards = add_scaled(add_scaled(direction, x_offset, right), y_offset, down)
        ray_rgb, _, _, _ = ray_colour(scene, start, towards, t_min, half_right, half_down)
        total = add_scaled(total, 1.0, ray_rgb)
    colour[v, u, 0], colour[v, u, 1], colour[v, u, 2] = scale(total, 0.25)


WIDTH_PX = Bounds(64, 4096)
"""Width of a preview."""
REFLECTANCE = 0.92
SENSOR = SENSORS["c920"].replaced(tone_curve="srgb", exposure=0.75)
"""A webcam with sRGB grey levels."""


@dataclass(frozen=True, eq=False)
class PreviewFrame:
    """A preview of the camera's picture.

    Attributes
    ----------
    layout
        The layout with its camera binned to the size of the picture.
    picture
        (h, w, 3), uint8, RGB.
    sensor
        Lens and sensor, binned to the size of the picture.
    light
        Light before lens and sensor, and the object in each pixel.
    """

    layout: Layout
    picture: NDArray[np.uint8]
    sensor: SensorModel
    light: SensorLight


def preview_frame(
    layout: Layout,
    subject: Subject = "tabletop",
    width_px: int = 640,
    *,
    arranged_for: Layout | None = None,
    board: CalibrationBoard | None = None,
    sensor: SensorModel = SENSOR,
    seed: int = 0,
) -> PreviewFrame:
    """Render a preview of a scene via the mirrors of a layout.

    The same arguments give the same picture. The first call after installation compiles for half a minute; the first
    call in a process takes a second to load the compiled code and draw textures.

    Parameters
    ----------
    layout
        The layout; it need not be verified.
    subject
        `tabletop`: the objects of `mirrorcam scene`, at the depths that the layout was designed for; `board`: a
        calibration board at the middle depth.
    width_px
        Width of the picture; at most the camera's.
    arranged_for
        The layout whose field of view the tabletop fills; by default `layout`. Layouts with the same `arranged_for`
        show the same objects at the centres of their fields.
    board
        The board; by default `default_board()`.
    sensor
        Lens and sensor at full resolution, with the camera's pupil. The processing of raw pictures (colour filters,
        denoising, sharpening, compression), rolling shutter and `lens_waves_px` are ignored.
    seed
        Seed of textures, small shifts of objects, and noise.

    Raises
    ------
    InputError
        For an invalid subject or width.
    """
    if subject not in ("tabletop", "board"):
        raise InputError(f"subject is {subject!r}, expected tabletop or board")
    if not WIDTH_PX.min <= width_px <= WIDTH_PX.max:
        raise InputError(f"width of {width_px} px, expected {WIDTH_PX}")
    factor = min(width_px / layout.camera.width_px, 1.0)
    camera = layout.camera.binned(factor)
    binned = layout.replaced(camera=camera)
    if subject == "tabletop":
        scene = traced_tabletop(arranged_tabletop(binned, seed, arranged_for))
    else:
        shown = default_board() if board is None else board
        scene = traced_board(shown, view_from_board(binned, shown), RenderSettings())
    return preview_of(scene, binned, binned_sensor(sensor, factor), seed)


def preview_of(scene: TracedScene, layout: Layout, sensor: SensorModel, seed: int) -> PreviewFrame:
    """Render a preview of any scene, in view axes, at the size of the camera's picture; `seed` is that of the noise."""
    camera = layout.camera
    light = sensor_light(camera, mirror_views(layout, camera.pupil, REFLECTANCE), scene)
    radiance = out_of_focus(light.radiance, light.along_axis_mm, camera)
    random = np.random.default_rng(np.random.SeedSequence((seed, 1)))
    picture = np.atleast_3d(photograph(radiance, 1, camera, sensor, random))
    return PreviewFrame(layout, np.broadcast_to(picture, (*picture.shape[:2], 3)), sensor, light)


def binned_sensor(sensor: SensorModel, factor: float) -> SensorModel:
    """Return the lens and the sensor with the number of pixels along each axis multiplied by `factor`.

    The mean of n pixels has the full well of n pixels, and 1 / sqrt(n) of their read noise and PRNU.
    """
    return SensorModel(
        lens_blur_px=sensor.lens_blur_px * factor,
        lateral_chromatic_percent=sensor.lateral_chromatic_percent,
        axial_chromatic_px=sensor.axial_chromatic_px * factor,
        vignetting=sensor.vignetting,
        veiling_glare=sensor.veiling_glare,
        prnu_percent=sensor.prnu_percent * factor,
        exposure=sensor.exposure,
        full_well_electrons=sensor.full_well_electrons / factor**2,
        read_noise_grey=sensor.read_noise_grey * factor,
        tone_curve=sensor.tone_curve,
    )
