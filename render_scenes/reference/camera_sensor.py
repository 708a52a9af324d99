"""The base camera as a Mitsuba sensor: a thin lens; the distortion is inverted for the chief ray of each ray.

A Brown-Conrady lens is inverted by its formula, any other by a table of all pixels.

Mitsuba's world is the rig frame in mm, with the camera at the origin, where single precision is finest. Mitsuba's pixel
(0, 0) has its centre at (0.5, 0.5), ours at (0, 0).
"""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mirrorcam.optics.geometry.camera import PLAIN_LENS, Camera
from mirrorcam.optics.geometry.pupil import Pupil
from mirrorcam.render_scenes.lens import PERIODS, WavyCamera, undistorted_pixels

NEWTON_STEPS = 4  # residual below 1e-4 px at the corners of a C920 with k1 = .08, k2 = -.18


def normalized_from_mitsuba(x: Any, y: Any, intrinsics: list[Any]) -> tuple[Any, Any]:
    """Undistort Dr.Jit pixel coordinates (Mitsuba's convention) to x/z, y/z by unrolled Newton steps.

    `intrinsics` are the nine intrinsics of a Brown-Conrady `Camera`, in OpenCV's model; its Jacobian is symmetric.
    """
    fx, fy, cx, cy, k1, k2, p1, p2, k3 = intrinsics
    u, v = (x - 0.5 - cx) / fx, (y - 0.5 - cy) / fy
    x, y = u, v
    for _ in range(NEWTON_STEPS):
        r2 = x * x + y * y
        radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
        d_radial = k1 + r2 * (2.0 * k2 + r2 * 3.0 * k3)
        error_x = u - (x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x))
        error_y = v - (y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y)
        xx = radial + 2.0 * x * x * d_radial + 2.0 * p1 * y + 6.0 * p2 * x
        yy = radial + 2.0 * y * y * d_radial + 6.0 * p1 * y + 2.0 * p2 * x
        xy = 2.0 * x * y * d_radial + 2.0 * p1 * x + 2.0 * p2 * y
        determinant = xx * yy - xy * xy
        x = x + (yy * error_x - xy * error_y) / determinant
        y = y + (xx * error_y - xy * error_x) / determinant
    return x, y


@cache
def _plugin(variant: str) -> str:
    """Register the sensor for the current variant (its base class belongs to that variant) and return its name."""
    import drjit as dr
    import mitsuba as mi

    class LensSensor(mi.Sensor):
        """Plugin "lens_camera": a camera at the origin of the rig; `intrinsics` are nine comma-separated numbers.

        With a `table` (h + 1, w + 1, 2) from `_distortion_table`, they define only its pinhole.

        The rays of a sensor point start in a pupil of `aperture_mm` and meet on the chief ray, in the plane
        z = `focus_mm`. Surfaces nearer than the plane z = `near_mm` are ignored.
        """

        def __init__(self, props: mi.Properties) -> None:
            super().__init__(props)
            # Opaque, so that another camera does not compile another kernel.
            self.intrinsics = [mi.Float(float(number)) for number in str(props["intrinsics"]).split(",")]
            self.table: Any = None
            if "table" in props:
                table: Any = props["table"]
                size = table.shape
                self.nodes = mi.Float(float(size[1])), mi.Float(float(size[0]))
                linear, clamp = dr.FilterMode.Linear, dr.WrapMode.Clamp
                # Without hardware, which has only eight bits between two nodes.
                texture: Any = mi.Texture2f
                self.table = texture(table, use_accel=False, filter_mode=linear, wrap_mode=clamp)
            self.near_mm = mi.Float(props.get("near_mm", 0.0))
            aperture_mm, focus_mm = (float(str(props[name])) for name in ("aperture_mm", "focus_mm"))
            walk_mm = float(str(props["walk_mm"]))
            self.waves_px, self.waves_per_px = (
                mi.Float(float(str(props[name]))) for name in ("waves_px", "waves_per_px")
            )
            self.is_pinhole, self.is_fixed_pupil = aperture_mm == 0.0, walk_mm == 0.0
            self.is_wavy = float(str(props["waves_px"])) > 0.0
            self.radius_mm, self.inverse_focus = mi.Float(aperture_mm / 2.0), mi.Float(1.0 / focus_mm)
            self.walk_mm = mi.Float(walk_mm)
            dr.make_opaque(self.intrinsics, self.near_mm, self.radius_mm, self.inverse_focus, self.walk_mm)
            dr.make_opaque(self.waves_px, self.waves_per_px)

        def chief_ray(self, x: Any, y: Any) -> tuple[Any, Any]:
            """Return x/z and y/z of the ray through the centre of the pupil."""
            if self.table is None:
                return normalized_from_mitsuba(x, y, self.intrinsics)
            offset = self.table.eval(mi.Point2f((x + 0.5) / self.nodes[0], (y + 0.5) / self.nodes[1]))
            fx, fy, cx, cy = self.intrinsics[:4]
            return (x - 0.5 - cx) / fx + offset[0], (y - 0.5 - cy) / fy + offset[1]

        def ray_through(self, x: Any, y: Any, u: Any = 0.5, v: Any = 0.5) -> Any:
            """Return the ray from the pupil point (u, v), 0 to 1, to the sensor point (x, y) in Mitsuba's pixels."""
            if self.is_wavy:
                sine_x, cosine_x = dr.sincos(self.waves_per_px * (x - 0.5))
                sine_y, cosine_y = dr.sincos(self.waves_per_px * (y - 0.5))
                x = x - self.waves_px * sine_x * cosine_y
                y = y - self.waves_px * cosine_x * sine_y
            chief_x, chief_y = self.chief_ray(x, y)
            if self.is_pinhole:
                start_x = start_y = mi.Float(0.0)
            else:
                pupil_point = self.radius_mm * mi.warp.square_to_uniform_disk_concentric(mi.Point2f(u, v))
                start_x, start_y = pupil_point.x, pupil_point.y
            if not self.is_fixed_pupil:
                pupil_z = self.walk_mm * (chief_x * chief_x + chief_y * chief_y)
                shift = pupil_z / (1.0 - pupil_z * self.inverse_focus)
                start_x, start_y = start_x - shift * chief_x, start_y - shift * chief_y
            direction: Any = mi.Vector3f(
                chief_x - start_x * self.inverse_focus, chief_y - start_y * self.inverse_focus, 1.0
            )
            start = mi.Point3f(start_x, start_y, 0.0) + self.near_mm * direction
            return mi.RayDifferential3f(mi.Ray3f(start, dr.normalize(direction)))

        def sample_ray_differential(
            self, time: Any, wavelength_sample: Any, position_sample: Any, aperture_sample: Any, active: Any = True
        ) -> Any:
            film = self.film()  # position_sample is relative to the film's crop
            size, offset = film.crop_size(), film.crop_offset()
            x, y = position_sample.x * size[0] + offset[0], position_sample.y * size[1] + offset[1]
            ray = self.ray_through(x, y, aperture_sample.x, aperture_sample.y)
            ray.time = time
            return ray, mi.Spectrum(1.0)

        def sample_ray(
            self, time: Any, wavelength_sample: Any, position_sample: Any, aperture_sample: Any, active: Any = True
        ) -> Any:
            ray, weight = self.sample_ray_differential(
                time, wavelength_sample, position_sample, aperture_sample, active
            )
            return mi.Ray3f(ray), weight

    name = "lens_camera"
    mi.register_sensor(name, LensSensor)
    return name


def sensor(
    camera: Camera,
    *,
    pupil: Pupil | None = None,
    crop: tuple[int, int, int, int] | None = None,
    near_mm: float = 0.0,
) -> Any:
    """Return a Mitsuba sensor for a camera, with a box-filtered film of one channel.

    The variant must have been set (`variant.use_variant`).

    Parameters
    ----------
    camera
        The camera, at the origin of the rig frame.
    pupil
        Pupil of the lens; by default a pinhole.
    crop
        Window of the film: x, y, width, height in pixels.
    near_mm
        Surfaces nearer than the plane z = `near_mm` are ignored: the camera's own body contains the pupil.
    """
    import mitsuba as mi

    lens, is_formula = pupil or Pupil(), camera.lens_model == PLAIN_LENS
    film: dict[str, Any] = {
        "type": "hdrfilm",
        "width": camera.width_px,
        "height": camera.height_px,
        "pixel_format": "luminance",
        "component_format": "float32",
        "filter": {"type": "box"},
    }
    if crop is not None:
        names = ("crop_offset_x", "crop_offset_y", "crop_width", "crop_height")
        film |= dict(zip(names, crop, strict=True))
    return mi.load_dict(
        {
            "type": _plugin(mi.variant()),
            # As text, because a property stores single floats in full precision, but no list of floats.
            "intrinsics": ",".join(repr(float(number)) for number in _intrinsics(camera)),
            "near_mm": near_mm,
            "aperture_mm": lens.aperture_mm,
            "focus_mm": lens.focus_mm,
            "walk_mm": lens.walk_mm,
            "waves_px": 2.0 * camera.waves_px if isinstance(camera, WavyCamera) else 0.0,
            "waves_per_px": 2.0 * math.pi * PERIODS / camera.width_px,
            "film": film,
            "sampler": {"type": "independent"},
            **({} if is_formula else {"table": mi.TensorXf(_distortion_table(camera))}),
        }
    )


def _intrinsics(camera: Camera) -> list[float]:
    """Return focal lengths, principal point and five distortion coefficients, 0 unless the lens is Brown-Conrady."""
    lens = camera.distortion if camera.lens_model == PLAIN_LENS else np.zeros(5)
    return [*camera.intrinsics[:4].tolist(), *lens.tolist()]


def _distortion_table(camera: Camera) -> NDArray[np.float32]:
    """Return the differences (h + 1, w + 1, 2) of undistorted pixel corners from those of the pinhole.

    Linear interpolation between them is accurate to 1e-4 px.
    """
    model = camera.model if isinstance(camera, WavyCamera) else camera
    u, v = (np.arange(length + 1.0) - 0.5 for length in (camera.width_px, camera.height_px))
    pinhole = np.stack(np.meshgrid((u - camera.cx_px) / camera.fx_px, (v - camera.cy_px) / camera.fy_px), axis=-1)
    return (undistorted_pixels(model, u, v) - pinhole).astype(np.float32)
