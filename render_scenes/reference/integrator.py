"""Path tracing via mirrors: an integrator without the bias of Mitsuba's ray offset, and the loop over pixels.

`SurfaceInteraction.spawn_ray` moves the origin of a reflected ray along the *normal* to leave the surface. The ray is
then parallel to the true one, and corners seen via a mirror move by hundredths of a pixel (by tenths where the
unit is metres). Moving the origin along the *reflected direction* leaves the surface too and does not change the ray.

Where the front of a plate splits light, no branch is chosen at random. A path is traced once per branch and the
radiances are added, so plates add no noise. Branch 0 is reflected by the front; branch k continues to the coating
and leaves the plate when it meets the front for the k-th time.

Interactions of light with surfaces (emission, BSDFs, direct light) are in Dr.Jit, for any variant.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray


@cache
def additive_steps(dimensions: int) -> tuple[float, ...]:
    """Return steps 1/g, 1/g^2, ... of an additive recurrence; g is the positive root of x^(dimensions + 1) = x + 1."""
    root = 2.0
    while (closer := (1.0 + root) ** (1.0 / (dimensions + 1))) < root:
        root = closer
    return tuple(root**-number for number in range(1, dimensions + 1))


# Along the reflected ray: far above the single precision of a hit (1e-5 mm), far below any gap of a real device.
CLEARANCE_MM = 0.02


def logical_not(condition: Any) -> Any:
    """Negate a mask; in scalar variants, ~ of a Python bool is not a bool."""
    import drjit as dr
    import mitsuba as mi

    return dr.select(condition, mi.Bool(False), mi.Bool(True))


def has_flag(bsdf: Any, flag: Any, active: Any) -> Any:
    """Return the mask of active lanes whose BSDF has a flag."""
    import mitsuba as mi

    return mi.Bool(False) if bsdf is None else active & mi.has_flag(bsdf.flags(), flag)


def emitted_radiance(scene: Any, hit: Any, active: Any) -> Any:
    """Return the radiance that an intersected emitter, or the environment, emits against the ray."""
    import mitsuba as mi

    emitter = hit.emitter(scene)
    return mi.Spectrum(0.0) if emitter is None else emitter.eval(hit, active)  # None: scalar variants only


def sample_bsdf(bsdf: Any, hit: Any, sample1: Any, sample2: Any, active: Any) -> tuple[Any, Any]:
    """Sample the BSDF of a surface with `sample1`, one random number, and `sample2`, two."""
    import mitsuba as mi

    if bsdf is None:
        return mi.BSDFSample3f(), mi.Spectrum(0.0)
    return bsdf.sample(mi.BSDFContext(), hit, sample1, sample2, active)


def power_heuristic(density: Any, other: Any) -> Any:
    """Return the weight of one of two sampling strategies in multiple importance sampling (Veach 1997)."""
    import drjit as dr

    return dr.select(density > 0.0, density * density / dr.maximum(density * density + other * other, 1e-30), 0.0)


def direct_light(scene: Any, hit: Any, bsdf: Any, random: Any, active: Any) -> Any:
    """Return the radiance scattered from one sampled point of each emitter (next event estimation).

    BSDF sampling covers the environment, without noise where a uniform environment is unoccluded.
    """
    import drjit as dr
    import mitsuba as mi

    smooth, total = has_flag(bsdf, mi.BSDFFlags.Smooth, active), mi.Spectrum(0.0)
    for emitter in scene.emitters():
        if emitter.is_environment():
            continue
        direction, light = emitter.sample_direction(hit, random, smooth)
        value, other = bsdf.eval_pdf(mi.BSDFContext(), hit, hit.to_local(direction.d), smooth)
        light *= value * dr.select(direction.delta, 1.0, power_heuristic(direction.pdf, other))
        lit = smooth & (direction.pdf > 0.0) & dr.any(light > 0.0)
        shadow = mi.Ray3f(
            mi.Ray3f(hit.p + CLEARANCE_MM * direction.d, direction.d), direction.dist - 2.0 * CLEARANCE_MM
        )
        total += dr.select(lit & logical_not(scene.ray_test(shadow, lit)), light, 0.0)
    return total


PLATE_BRANCHES = 4  # light with four or more reflections at the coating is less than 0.02 % in acrylic
NUMBERS = 8  # random numbers reserved for each bounce


@dataclass(frozen=True)
class PathOptions:
    """Options of the integrator; disabled effects cost no time.

    Attributes
    ----------
    mirrors_only
        Surfaces that the camera sees without a mirror are black.
    branches
        Number of branches traced through the first plate: 1 if nothing is transparent.
    lit
        Surfaces scatter light, which is sampled by the Monte Carlo method.
    colour
        Three channels instead of one.
    max_bounces
        Maximum number of bounces of a path.
    """

    mirrors_only: bool = False
    branches: int = 1
    lit: bool = False
    colour: bool = False
    max_bounces: int = 8


@cache
def _plugin(variant: str) -> str:
    """Register the integrator for the current variant (its base class belongs to that variant) and return its name."""
    import drjit as dr
    import mitsuba as mi

    delta, through = mi.BSDFFlags.Delta, mi.BSDFFlags.DeltaTransmission

    class LightPaths(mi.SamplingIntegrator):
        """Plugin "light_paths": emission at the ends of paths, as in `PathOptions`."""

        def __init__(self, props: mi.Properties) -> None:
            super().__init__(props)
            # Opaque, so that other scenes do not compile other kernels.
            self.first_bounce = mi.UInt32(1 if props.get("mirrors_only", False) else 0)
            self.last_bounce = mi.UInt32(props.get("max_bounces", 8))
            self.branches: Any = props.get("branches", 1)
            self.lit = props.get("lit", False)
            self.channels = 3 if props.get("colour", False) else 1
            dr.make_opaque(self.first_bounce, self.last_bounce)

        def radiance(self, scene: Any, ray: Any, active: Any, branch: Any = 0, key: Any = 0, number: Any = 0) -> Any:
            """Return the radiance along rays in one branch, with the random numbers of a key from index `number` on."""
            if self.lit or self.branches > 1:
                return self._by_branch(scene, ray, active, mi.UInt32(branch), mi.UInt32(key), mi.UInt32(number))

            def bounce(ray: Any, colour: Any, throughput: Any, active: Any, bounces: Any) -> tuple[Any, ...]:
                hit = scene.ray_intersect(ray, mi.RayFlags.All, True, active)
                active &= hit.is_valid()
                colour += throughput * emitted_radiance(scene, hit, active & (bounces >= self.first_bounce))
                # A perfect reflection takes no random numbers.
                bsdf = hit.bsdf(ray) if hit.shape is not None else None
                sample, weight = sample_bsdf(bsdf, hit, 0.5, mi.Point2f(0.5), active)
                throughput *= weight
                active &= mi.has_flag(sample.sampled_type, delta) & (bounces < self.last_bounce)
                active &= dr.any(throughput > 0.0)
                direction = hit.to_world(sample.wo)
                ray = mi.Ray3f(hit.p + CLEARANCE_MM * direction, direction)
                return ray, colour, throughput, active, bounces + 1

            start = (mi.Ray3f(ray), mi.Spectrum(0.0), mi.Spectrum(1.0), mi.Bool(active), mi.UInt32(0))
            end = dr.while_loop(start, lambda ray, colour, throughput, active, bounces: active, bounce)
            return end[1]

        def _by_branch(self, scene: Any, ray: Any, active: Any, branch: Any, key: Any, number: Any) -> Any:
            """Return the radiance with plates and scattering surfaces.

            Within the first plate, a path follows its branch; `passes` counts its passes to the coating. When the path
            has left that plate, `out` is true. All later interactions are sampled at random.
            """

            def bounce(
                ray: Any,
                colour: Any,
                throughput: Any,
                active: Any,
                bounces: Any,
                passes: Any,
                out: Any,
                last_hit: Any,
                density: Any,
            ) -> tuple[Any, ...]:
                hit = scene.ray_intersect(ray, mi.RayFlags.All, True, active)
                # A path without a plate is the same in all branches and counts in one of them.
                counts = active & (out | (branch == 0))
                light = throughput * emitted_radiance(scene, hit, counts & (bounces >= self.first_bounce))
                emitter = hit.emitter(scene)
                if self.lit and emitter is not None:
                    # An emitter that the last surface has also sampled directly.
                    sampled = counts & (density > 0.0) & hit.is_valid()
                    light_density = emitter.pdf_direction(last_hit, mi.DirectionSample3f(scene, hit, last_hit), sampled)
                    light *= dr.select(sampled, power_heuristic(density, light_density), 1.0)
                colour += light
                active &= hit.is_valid()
                random = [
                    mi.sample_tea_float32(key, number + NUMBERS * bounces + k) for k in range(5 if self.lit else 1)
                ]
                bsdf = hit.bsdf(ray) if hit.shape is not None else None
                if self.lit and bsdf is not None:
                    colour += throughput * direct_light(
                        scene, hit, bsdf, mi.Point2f(random[1], random[2]), active & counts
                    )
                is_glass = has_flag(bsdf, through, active)
                outside = hit.wi.z > 0.0
                passes = dr.select(is_glass & logical_not(outside), passes + 1, passes)
                reflects = dr.select(outside, branch == 0, passes < branch)
                first_plate = is_glass & logical_not(out)
                sample1 = dr.select(first_plate, dr.select(reflects, mi.Float(0.0), mi.Float(2.0)), random[0])
                sample2 = mi.Point2f(random[3], random[4]) if self.lit else mi.Point2f(0.5)
                sample, weight = sample_bsdf(bsdf, hit, sample1, sample2, active)
                throughput *= weight * dr.select(first_plate, sample.pdf, 1.0)
                out |= first_plate & dr.select(outside, reflects, logical_not(reflects))
                singular = mi.has_flag(sample.sampled_type, delta)
                active &= (bounces < self.last_bounce) & (sample.pdf > 0.0)
                if not self.lit:
                    active &= singular
                active &= dr.any(throughput > 0.0)
                density = dr.select(singular, mi.Float(0.0), sample.pdf)
                direction = hit.to_world(sample.wo)
                ray = mi.Ray3f(hit.p + CLEARANCE_MM * direction, direction)
                return ray, colour, throughput, active, bounces + 1, passes, out, mi.Interaction3f(hit), density

            start = (
                mi.Ray3f(ray),
                mi.Spectrum(0.0),
                mi.Spectrum(1.0),
                mi.Bool(active),
                mi.UInt32(0),
                mi.UInt32(0),
                mi.Bool(False),
                dr.zeros(mi.Interaction3f),
                mi.Float(0.0),
            )
            return dr.while_loop(start, lambda *state: state[3], bounce)[1]

        def means(self, scene: Any, sensor: Any, x: Any, y: Any, side: Any, spp: Any, seed: Any) -> list[Any]:
            """Return the mean radiance of squares (x, y) of `side` x `side` pixels, by channel; each lane is a square.

            Samples run in sequence: memory is constant, and the order of sums does not depend on threads.
            """
            # One pattern of samples, with a different shift in each square: unbiased, and the pattern is not visible.
            bits: list[Any] = [*mi.sample_tea_32(y * 65536 + x, seed)]
            if not sensor.is_pinhole:
                bits += mi.sample_tea_32(bits[0], bits[1])
            steps = additive_steps(len(bits))
            shifts = [mi.Float(number) * 2.0**-32 for number in bits]
            left, top = mi.Float(x), mi.Float(y)
            per_sample = NUMBERS * (self.last_bounce + 1)

            def add_sample(count: Any, *totals: Any) -> tuple[Any, ...]:
                sample, branch = (count // self.branches, count % self.branches) if self.branches > 1 else (count, 0)
                coordinates = [shift + mi.Float(sample) * step for shift, step in zip(shifts, steps, strict=True)]
                u, v, *on_pupil = (value - dr.floor(value) for value in coordinates)
                ray = sensor.ray_through((left + u) * side, (top + v) * side, *on_pupil)
                light = self.radiance(scene, ray, mi.Bool(True), branch, bits[0], count * per_sample)
                return count + 1, *(total + light[k] for k, total in enumerate(totals))

            start: tuple[Any, ...] = (mi.UInt32(0), *(mi.Float(0.0) for _ in range(self.channels)))
            _, *totals = dr.while_loop(start, lambda count, *totals: count < spp * self.branches, add_sample)
            return [total / mi.Float(spp) for total in totals]

        def sample(self, scene: Any, sampler: Any, ray: Any, medium: Any = None, active: Any = True) -> Any:
            key = mi.UInt32(sampler.next_1d(active) * 2.0**24) if self.lit or self.branches > 1 else 0
            light = sum(self.radiance(scene, ray, active, branch, key) for branch in range(self.branches))
            return light, mi.Bool(True), []

    name = "light_paths"
    mi.register_integrator(name, LightPaths)
    return name


def integrator(light: PathOptions) -> Any:
    """Return the integrator for the current variant."""
    import mitsuba as mi

    return mi.load_dict({"type": _plugin(mi.variant()), **vars(light)})


def render(
    scene: Any,
    sensor: Any,
    paths: Any,
    *,
    crop: tuple[int, int, int, int],
    subpixels: int,
    spp: int,
    seed: int,
) -> NDArray[np.float32]:
    """Render a window of a sensor; the same arguments give the same bits.

    Parameters
    ----------
    scene
        Scene of the current variant.
    sensor
        Has `ray_through(x, y, u, v)`, the ray from the pupil point (u, v), 0 to 1, to a sensor point in Mitsuba's
        pixels, and `is_pinhole`, true if u and v are ignored.
    paths
        The integrator.
    crop
        x, y, width, height in pixels.
    subpixels
        Subpixels along each side of a pixel.
    spp
        Samples per subpixel.
    seed
        Seed of the sample pattern.

    Returns
    -------
    NDArray[np.float32]
        Radiance (height * subpixels, width * subpixels) or, in colour, (height * subpixels, width * subpixels, 3).
    """
    import drjit as dr
    import mitsuba as mi

    x, y, width, height = (number * subpixels for number in crop)
    side = 1.0 / subpixels
    if not dr.is_jit_v(mi.Float):
        squares = [
            paths.means(scene, sensor, column, row, side, spp, seed)
            for row in range(y, y + height)
            for column in range(x, x + width)
        ]
        means = np.array(squares, dtype=np.float32)
    else:
        # Opaque, so that other numbers do not compile other kernels.
        left, top, columns, samples, key = opaque = [mi.UInt32(number) for number in (x, y, width, spp, seed)]
        scale = mi.Float(side)
        dr.make_opaque(opaque, scale)
        index = dr.arange(mi.UInt32, width * height)
        channels = paths.means(scene, sensor, left + index % columns, top + index // columns, scale, samples, key)
        dr.eval(channels)
        means = np.stack([channel.numpy() for channel in channels], axis=-1)
    return means.reshape(height, width, *([] if means.shape[-1] == 1 else [means.shape[-1]]))
