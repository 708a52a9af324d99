"""One frame of a scene of one's own via the mirrors of a layout, in memory."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.arguments import check_count, check_type
from mirrorcam.core.bounds import SAMPLES_PER_PIXEL, SEED
from mirrorcam.core.errors import InputError
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.light_field.decoder import default_reference_depth_mm
from mirrorcam.render_scenes.fields_of_view import common_bounds
from mirrorcam.render_scenes.lens import true_camera, with_pupil_of
from mirrorcam.render_scenes.sets.sensor_model import photograph
from mirrorcam.render_scenes.settings import SENSORS, SensorModel, SensorName
from mirrorcam.render_scenes.tabletop.objects import SceneObject
from mirrorcam.render_scenes.tabletop.tabletop import Tabletop, check_meshes
from mirrorcam.render_scenes.tabletop.tabletop_scene import TabletopScene

SUBPIXELS = 2
REFLECTANCE = 0.92


def render_frame(
    layout: Layout,
    objects: Iterable[SceneObject],
    *,
    sensor: SensorModel | SensorName = "c920",
    spp: int = 64,
    seed: int = 0,
) -> NDArray[np.uint8]:
    """Render the frame that the camera of a layout takes of objects via the mirrors; needs the extra `render`.

    An area light above, left of and in front of the common field of the views, and a uniform sky, light the scene. The
    first call after installation compiles for half a minute.

    Parameters
    ----------
    layout
        The device as it is; tolerances are not applied.
    objects
        The scene; `SceneObject.view_from_object` places each in view axes, mm.
    sensor
        Lens and sensor, or the name of a preset: `ideal`, `c920`, `poor` or `webcam`. Compression and rolling shutter
        are ignored.
    spp
        Samples per pixel.
    seed
        Seed of the samples and of the sensor's noise; the same arguments give the same frame.

    Returns
    -------
    ndarray of uint8
        The frame (h, w, 3), RGB, for `Decoder(layout).decode`.

    Raises
    ------
    InputError
        If the extra `render` is missing, the layout has no mirrors, there are no objects, the sensor's name is unknown,
        `spp` or `seed` is out of range, or a mesh or a picture is unreadable, or a mesh reaches into the camera.
    """
    check_type("layout", layout, Layout)
    if not layout.mirrors:
        raise InputError("layout: a bare camera, expected a layout with mirrors")
    check_type("sensor", sensor, SensorModel, str)
    if isinstance(sensor, str):
        if sensor not in SENSORS:
            raise InputError(f"sensor: {sensor!r}, expected one of {', '.join(SENSORS)}, or a SensorModel")
        sensor = SENSORS[sensor]
    check_count("spp", spp, SAMPLES_PER_PIXEL.narrowed(min=SUBPIXELS**2))
    check_count("seed", seed, SEED)
    if isinstance(objects, SceneObject) or not isinstance(objects, Iterable):
        raise TypeError(f"objects: {type(objects).__name__}, expected an iterable of SceneObject")
    things = tuple(objects)
    for item in things:
        check_type("objects", item, SceneObject)
    if not things:
        raise InputError("objects: none, expected one or more")
    check_meshes(layout, things)
    depth_mm = default_reference_depth_mm(layout)
    (left, top), (right, bottom) = common_bounds(layout, depth_mm)
    lamp_target = np.array([(left + right) / 2.0, (top + bottom) / 2.0, depth_mm])
    built = layout.replaced(camera=with_pupil_of(layout.camera, sensor))
    with_true_lens = built.replaced(camera=true_camera(built.camera, sensor))
    scene = TabletopScene(with_true_lens, Tabletop(things, lamp_target, right - left), REFLECTANCE)
    render, noise = (np.random.default_rng(child) for child in np.random.SeedSequence(seed).spawn(2))
    return photographed(scene, built, sensor, spp=spp, seed=int(render.integers(2**32)), noise=noise)


def photographed(
    scene: TabletopScene, layout: Layout, sensor: SensorModel, *, spp: int, seed: int, noise: np.random.Generator
) -> NDArray[np.uint8]:
    """Return the picture (h, w, 3) of a scene by the camera of a layout, before compression."""
    radiance = scene.photograph(sensor.pupil, spp=max(spp // SUBPIXELS**2, 1), subpixels=SUBPIXELS, seed=seed)
    return photograph(radiance, SUBPIXELS, layout.camera, sensor, noise)
