"""The camera as somebody built it: a layout strayed from its design by drawn tolerances."""

from __future__ import annotations

import numpy as np
import shapely
from pydantic import ValidationError
from scipy.spatial.transform import Rotation

from optics.camera import Camera
from optics.layout import Layout
from optics.mirror import Mirror
from optics.values import InputError
from render_scenes.dataset import Tolerances
from render_scenes.truth import sub_image

DRAWS = 20  # attempts at mirrors that do not overlap in the image and a lens that covers the sensor


def _draw_camera(camera: Camera, tolerances: Tolerances, random: np.random.Generator) -> Camera:
    focal = 1.0 + tolerances.focal_percent / 100.0 * random.standard_normal()
    centre = tolerances.centre_px * random.standard_normal(2)
    lens = tolerances.distortion_mean + tolerances.distortion_sigma * random.standard_normal(5)
    return camera.replaced(
        fx_px=camera.fx_px * focal,
        fy_px=camera.fy_px * focal,
        cx_px=camera.cx_px + centre[0],
        cy_px=camera.cy_px + centre[1],
        distortion=camera.distortion + lens,
    )


def _draw_mirror(mirror: Mirror, tolerances: Tolerances, random: np.random.Generator) -> Mirror:
    """Tilted about the two axes of its own plane, then shifted along the normal it had."""
    tilts = np.deg2rad(tolerances.tilt_deg) * random.standard_normal(2)
    shift = tolerances.offset_mm * random.standard_normal()
    axes = mirror.rig_from_plane[:3, :2]
    return mirror.moved(Rotation.from_rotvec(axes @ tilts).as_matrix(), shift * mirror.normal_in_rig)


def _covers_sensor(camera: Camera) -> bool:
    """Whether every pixel at the border of the sensor has a viewing ray."""
    x, y = np.linspace(0.0, camera.width_px - 1.0, 33), np.linspace(0.0, camera.height_px - 1.0, 33)
    edges = [np.stack(np.broadcast_arrays(x, row), axis=1) for row in (y[0], y[-1])]
    edges += [np.stack(np.broadcast_arrays(column, y), axis=1) for column in (x[0], x[-1])]
    return bool(np.isfinite(camera.normalized_from_pixels(np.concatenate(edges))).all())


def _off_sensor(layout: Layout) -> int | None:
    """The first mirror of which the sensor shows nothing."""
    sensor = shapely.box(0.0, 0.0, layout.camera.width_px - 1.0, layout.camera.height_px - 1.0)
    shown = (sensor.intersects(sub_image(layout, index)) for index in range(len(layout.mirrors)))
    return next((index for index, is_shown in enumerate(shown) if not is_shown), None)


def draw_as_built(layout: Layout, tolerances: Tolerances, random: np.random.Generator) -> Layout:
    """A layout of kind "as-built", drawn around `layout`; drawn again (up to 20 times) when it could not exist.

    Raises InputError that names the tolerance when no draw can exist.
    """
    for _ in range(DRAWS):
        try:
            built = layout.replaced(
                kind="as-built",
                camera=_draw_camera(layout.camera, tolerances, random),
                mirrors=tuple(_draw_mirror(mirror, tolerances, random) for mirror in layout.mirrors),
                metrics={},
                verdict={},
                provenance={"drawn_from": layout.identity},
                uncertainty=None,
            )
        except ValidationError as error:
            reason = error.errors(include_url=False)[0]["msg"].removeprefix("Value error, ")
            blame = f"tilt_deg {tolerances.tilt_deg}, offset_mm {tolerances.offset_mm}: {reason}"
            if error.title == Camera.__name__:
                blame = f"focal_percent {tolerances.focal_percent}: {reason}"
            continue
        if not _covers_sensor(built.camera):
            blame = (
                f"distortion_mean {tolerances.distortion_mean.tolist()}: the lens model folds before the sensor ends"
            )
        elif (lost := _off_sensor(built)) is not None:
            blame = (
                f"tilt_deg {tolerances.tilt_deg}, focal_percent {tolerances.focal_percent}, "
                f"centre_px {tolerances.centre_px}: mirror {lost} lies outside the sensor"
            )
        else:
            return built
    raise InputError(f"tolerances {blame} (in each of {DRAWS} draws), expected smaller ones")
