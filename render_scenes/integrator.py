"""Light along mirrors: an integrator without the bias of Mitsuba's ray offset, and the pixel loop around it.

`SurfaceInteraction.spawn_ray` moves the origin of a reflected ray along the *normal* to leave the surface. The ray is
then no longer the true one but a parallel of it, and corners seen by way of a mirror move by hundredths of a pixel (by
tenths where the unit is metres). Moving it along the *reflected direction* leaves the surface too and changes nothing.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

# Along the reflected ray: far above the single precision of a hit (1e-5 mm), far below any gap of a real device.
CLEARANCE_MM = 0.02
# Steps of the R2 sequence (Roberts): 1/g and 1/g^2 with g^3 = g + 1, the plane's best-spread additive recurrence.
R2_STEPS = (0.7548776662466927, 0.5698402909959032)


@cache
def _plugin(variant: str) -> str:
    """Register the integrator for the current variant (its base class belongs to that variant) and return its name."""
    import drjit as dr
    import mitsuba as mi

    def emitted(scene: Any, hit: Any, active: Any) -> Any:
        emitter = hit.emitter(scene)
        return mi.Spectrum(0.0) if emitter is None else emitter.eval(hit, active)  # None: scalar variants only

    def reflected(ray: Any, hit: Any, active: Any) -> tuple[Any, Any]:
        # A perfect reflection takes no random numbers.
        bsdf = hit.bsdf(ray) if hit.shape is not None else None
        if bsdf is None:
            return mi.BSDFSample3f(), mi.Spectrum(0.0)
        return bsdf.sample(mi.BSDFContext(), hit, 0.5, mi.Point2f(0.5), active)

    class SpecularIntegrator(mi.SamplingIntegrator):
        """Plugin "specular": emission at the end of a chain of perfect reflections.

        `max_bounces` bounds the chain; with `mirrors_only` what the camera sees directly is black.
        """

        def __init__(self, props: mi.Properties) -> None:
            super().__init__(props)
            # Opaque, so that other scenes do not compile other kernels.
            self.first = mi.UInt32(1 if props.get("mirrors_only", False) else 0)
            self.last = mi.UInt32(props.get("max_bounces", 8))
            dr.make_opaque(self.first, self.last)

        def radiance(self, scene: Any, ray: Any, active: Any) -> Any:
            """Radiance along rays (one colour per ray): follows mirrors until something else is hit."""

            def bounce(ray: Any, colour: Any, throughput: Any, active: Any, bounces: Any) -> tuple[Any, ...]:
                hit = scene.ray_intersect(ray, mi.RayFlags.All, True, active)
                active &= hit.is_valid()
                colour += throughput * emitted(scene, hit, active & (bounces >= self.first))
                sample, weight = reflected(ray, hit, active)
                throughput *= weight
                active &= mi.has_flag(sample.sampled_type, mi.BSDFFlags.Delta) & (bounces < self.last)
                active &= dr.any(throughput > 0.0)
                direction = hit.to_world(sample.wo)
                ray = mi.Ray3f(hit.p + CLEARANCE_MM * direction, direction)
                return ray, colour, throughput, active, bounces + 1

            start = (mi.Ray3f(ray), mi.Spectrum(0.0), mi.Spectrum(1.0), mi.Bool(active), mi.UInt32(0))
            end = dr.while_loop(start, lambda ray, colour, throughput, active, bounces: active, bounce)
            return end[1]

        def means(self, scene: Any, sensor: Any, x: Any, y: Any, side: Any, spp: Any, seed: Any) -> Any:
            """Mean radiance of squares (x, y) of `side` pixels: one lane each, its samples one after the other.

            So memory does not grow with the samples, and sums are formed in one order whatever the number of threads.
            """
            # One pattern of samples, shifted in each square by its place on the sensor: unbiased, and no pattern shows.
            bits_x, bits_y = mi.sample_tea_32(y * 65536 + x, seed)
            shift_x, shift_y = mi.Float(bits_x) * 2.0**-32, mi.Float(bits_y) * 2.0**-32
            left, top = mi.Float(x), mi.Float(y)

            def take(total: Any, taken: Any) -> tuple[Any, ...]:
                at_x, at_y = shift_x + mi.Float(taken) * R2_STEPS[0], shift_y + mi.Float(taken) * R2_STEPS[1]
                at_x, at_y = left + at_x - dr.floor(at_x), top + at_y - dr.floor(at_y)
                ray = sensor.ray_through(at_x * side, at_y * side)
                return total + self.radiance(scene, ray, mi.Bool(True))[0], taken + 1

            total, _ = dr.while_loop((mi.Float(0.0), mi.UInt32(0)), lambda total, taken: taken < spp, take)
            return total / mi.Float(spp)

        def sample(self, scene: Any, sampler: Any, ray: Any, medium: Any = None, active: Any = True) -> Any:
            return self.radiance(scene, ray, active), mi.Bool(True), []

    name = "specular"
    mi.register_integrator(name, SpecularIntegrator)
    return name


def integrator(*, mirrors_only: bool, max_bounces: int = 8) -> Any:
    """The integrator for the current variant; with `mirrors_only` whatever the camera sees directly is black."""
    import mitsuba as mi

    return mi.load_dict({"type": _plugin(mi.variant()), "mirrors_only": mirrors_only, "max_bounces": max_bounces})


def render(
    scene: Any,
    sensor: Any,
    specular: Any,
    *,
    crop: tuple[int, int, int, int],
    subpixels: int,
    spp: int,
    seed: int,
) -> NDArray[np.float32]:
    """Radiance (height * subpixels, width * subpixels), float32, of the pixels in `crop` = x, y, width, height.

    Each pixel is cut into subpixels x subpixels squares of `spp` samples each. Same arguments, same bits.
    """
    import drjit as dr
    import mitsuba as mi

    x, y, width, height = (number * subpixels for number in crop)
    side = 1.0 / subpixels
    if not dr.is_jit_v(mi.Float):
        means = [
            specular.means(scene, sensor, column, row, side, spp, seed)
            for row in range(y, y + height)
            for column in range(x, x + width)
        ]
        return np.array(means, dtype=np.float32).reshape(height, width)
    # Opaque, so that other numbers do not compile other kernels.
    left, top, columns, samples, key = opaque = [mi.UInt32(number) for number in (x, y, width, spp, seed)]
    scale = mi.Float(side)
    dr.make_opaque(opaque, scale)
    index = dr.arange(mi.UInt32, width * height)
    found = specular.means(scene, sensor, left + index % columns, top + index // columns, scale, samples, key)
    return np.asarray(found.numpy(), dtype=np.float32).reshape(height, width)
