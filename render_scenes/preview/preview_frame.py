"""A small picture of what a layout sees, in a fraction of a second: for interactive design.

Rays are traced through the mirrors as flat ones, to the objects of `mirrorcam scene` or to a board, with the same
geometry as the reference has. Shading is an approximation: of light that surfaces throw at each other there is a rough
share, glossy objects and glass reflect once, mirrors are not seen in them, and there are no ghosts of plates.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.bounds import Bounds
from mirrorcam.core.values import InputError
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.targets import Target, default_board
from mirrorcam.render_scenes.preview.arranged import Subject, arranged_tabletop, view_from_board
from mirrorcam.render_scenes.preview.focus_blur import out_of_focus
from mirrorcam.render_scenes.preview.mirror_views import mirror_views
from mirrorcam.render_scenes.preview.sensor_light import SensorLight, sensor_light
from mirrorcam.render_scenes.preview.traced_scene import traced_board, traced_tabletop
from mirrorcam.render_scenes.sets.sensor_model import photograph
from mirrorcam.render_scenes.settings import SENSORS, RenderSettings, SensorModel

WIDTH_PX = Bounds(64, 4096)
"""Width of a preview."""
REFLECTANCE = 0.92
SENSOR = SENSORS["c920"].replaced(tone_curve="srgb", exposure=0.75)
"""A webcam whose grey levels are those of screens."""


@dataclass(frozen=True, eq=False)
class PreviewFrame:
    """A preview of what a layout sees.

    Attributes
    ----------
    layout
        The layout with its pixels binned to those of the picture.
    picture
        (h, w, 3), uint8, RGB.
    sensor
        Lens and sensor that took it, of these pixels.
    light
        Light before lens and sensor, and what each pixel shows.
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
    target: Target | None = None,
    sensor: SensorModel = SENSOR,
    seed: int = 0,
) -> PreviewFrame:
    """Render a small picture of a scene via the mirrors of a layout.

    The same arguments give the same picture. The first call of an installation compiles, which takes half a minute;
    the first of a process loads that and draws textures, which takes a second.

    Parameters
    ----------
    layout
        Any layout, verified or not.
    subject
        `tabletop`: the objects of `mirrorcam scene`, at the depths that the layout was designed for; `board`: a
        calibration board at the middle depth.
    width_px
        Width of the picture; at most that of the camera's.
    arranged_for
        The layout whose field of view the tabletop fills; by default `layout`. Pictures by several layouts show the
        same objects, in the middle of their fields, if these are arranged for the same one.
    target
        The board; by default `default_board()`.
    sensor
        Lens and sensor at full resolution; the pupil is that of the camera. What it does to raw pictures (colour
        filters, denoising, sharpening, compression), rolling shutter and waves of the lens are left out.
    seed
        Seed of textures, small shifts of objects, and noise.

    Raises
    ------
    InputError
        For a subject or a width that is not offered.
    """
    if subject not in ("tabletop", "board"):
        raise InputError(f"subject is {subject!r}, expected tabletop or board")
    if not WIDTH_PX.least <= width_px <= WIDTH_PX.most:
        raise InputError(f"width of {width_px} px, expected {WIDTH_PX}")
    factor = min(width_px / layout.camera.width_px, 1.0)
    camera = layout.camera.binned(factor)
    small = layout.replaced(camera=camera)
    if subject == "tabletop":
        scene = traced_tabletop(arranged_tabletop(small, seed, arranged_for))
    else:
        board = default_board() if target is None else target
        scene = traced_board(board, view_from_board(small, board), RenderSettings())
    light = sensor_light(camera, mirror_views(small, camera.pupil, REFLECTANCE), scene)
    radiance = out_of_focus(light.radiance, light.along_axis_mm, camera)
    noise = np.random.default_rng(np.random.SeedSequence((seed, 1)))
    model = binned_sensor(sensor, factor)
    picture = np.atleast_3d(photograph(radiance, 1, camera, model, noise))
    return PreviewFrame(small, np.broadcast_to(picture, (*picture.shape[:2], 3)), model, light)


def binned_sensor(sensor: SensorModel, factor: float) -> SensorModel:
    """The lens and the sensor whose pixels are binned to `factor` of their number along an axis.

    The mean of n pixels has the noise of n times the electrons, and 1 / sqrt(n) of the read noise and of the scatter of
    sensitivities.
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
