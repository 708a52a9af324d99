"""Path tracing with next event estimation: lit scenes of mirrors, glass and diffuse surfaces, in colour.

The variance is kept low, so that few samples suffice. Every diffuse surface of a path is lit by a sampled point of each
area light; the path goes on by cosine-weighted sampling, so that a uniform environment lights unoccluded surfaces
without noise. The position in the pixel and the random numbers of the first such surface come from one low-discrepancy
sequence in all these dimensions; later bounces take independent numbers.

Left out: light of an area light via mirror or glass onto a diffuse surface (caustics, whose noise would need
thousands of samples), so that glass casts a shadow; and light scattered by more than `MATTE_BOUNCES` diffuse surfaces.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mirrorcam.render_scenes.low_discrepancy import additive_steps
from mirrorcam.render_scenes.reference.interactions import CLEARANCE_MM

RayThrough = Callable[[Any, Any, Any, Any], Any]
"""The ray from a point of the pupil, u and v in 0..1, through one of the sensor, x and y in Mitsuba's pixels."""

MATTE_BOUNCES = 3
SEGMENTS = 12  # largest number of path segments, with those through glass and between mirrors
# Place in a pixel (2); at the first diffuse surface: lobe, direction (2), point of the area light (2); pupil (2).
_NUMBERS = 9


def render_lit(
    scene: Any,
    ray_through: RayThrough,
    *,
    is_pinhole: bool,
    size: tuple[int, int],
    subpixels: int,
    spp: int,
    seed: int,
    by_mirrors: bool,
    most_indirect: float = np.inf,
) -> NDArray[np.float32]:
    """Render a scene in colour; the same arguments give the same bits. Needs a compiled variant in colour.

    Parameters
    ----------
    scene
        Scene of the current variant.
    ray_through
        The camera: called with x, y, u, v.
    is_pinhole
        Whether u and v are not used.
    size
        Width and height in pixels.
    subpixels
        Squares along each side of a pixel.
    spp
        Samples per square.
    seed
        Seed of the sample pattern.
    by_mirrors
        What the camera sees without a mirror is black.
    most_indirect
        Upper bound of what an area light adds to a sample by way of a surface that scatters. A bound leaves out the
        brightest glints on other surfaces, whose noise would need thousands of samples.

    Returns
    -------
    NDArray[np.float32]
        Radiance (height * subpixels, width * subpixels, 3).
    """
    import drjit as dr
    import mitsuba as mi

    width, height = (length * subpixels for length in size)
    # Opaque, so that other numbers do not compile other kernels.
    opaque: list[Any] = [mi.UInt32(number) for number in (width, spp, seed, int(by_mirrors))]
    columns, samples, key, first = opaque
    side = mi.Float(1.0 / subpixels)
    bound = mi.Float(most_indirect)
    dr.make_opaque(opaque, side, bound)
    square: Any = dr.arange(mi.UInt32, width * height)
    left, top = mi.Float(square % columns), mi.Float(square // columns)
    count = _NUMBERS - 2 if is_pinhole else _NUMBERS
    shifts = [bits for pair in range(5) for bits in mi.sample_tea_32(square, key + (pair << 24))][:count]
    steps = [round(step * 2.0**32) for step in additive_steps(count)]

    def take(total: Any, taken: Any) -> tuple[Any, ...]:
        numbers = [_unit(shift + taken * mi.UInt32(step)) for shift, step in zip(shifts, steps, strict=True)]
        u, v = (0.5, 0.5) if is_pinhole else numbers[7:]
        ray = ray_through((left + numbers[0]) * side, (top + numbers[1]) * side, u, v)
        own_key = square, key ^ (taken * mi.UInt32(0x9E3779B9))
        found = _radiance(scene, mi.Ray3f(ray), numbers[2:7], first, own_key, bound)
        return total + found, taken + 1

    start: Any = mi.Color3f(0.0), mi.UInt32(0)
    total: Any = dr.while_loop(start, lambda *state: state[1] < samples, take)[0]
    pixels: Any = dr.ravel(total / mi.Float(samples))
    return np.asarray(pixels.numpy(), dtype=np.float32).reshape(height, width, 3)


def _unit(bits: Any) -> Any:
    """Convert 32 random bits to numbers in [0, 1)."""
    import mitsuba as mi

    return mi.Float(bits >> 8) * 2.0**-24


def _radiance(scene: Any, ray: Any, numbers: list[Any], first: Any, key: tuple[Any, Any], most_indirect: Any) -> Any:
    """Colour along rays.

    `numbers` are the five random numbers of the first diffuse surface; `key` generates those of later ones. Surfaces
    met before segment `first` only reflect.
    """
    import drjit as dr
    import mitsuba as mi

    context, through = mi.BSDFContext(), mi.BSDFFlags.DeltaTransmission
    lamps = [emitter for emitter in scene.emitters() if not emitter.is_environment()]

    def bounce(
        ray: Any, colour: Any, throughput: Any, active: Any, straight: Any, fresh: Any, scattered: Any, segment: Any
    ) -> tuple[Any, ...]:
        hit = scene.ray_intersect(ray, mi.RayFlags.All, True, active)
        shown = active & (segment >= first)
        # A path that meets an area light after a diffuse surface has been counted there by direct sampling.
        seen = shown & (straight | ~hit.is_valid())
        colour += dr.select(seen, throughput * hit.emitter(scene).eval(hit, seen), 0.0)
        active &= hit.is_valid()
        bsdf = hit.bsdf(ray)
        later = [_unit(bits) for turn in range(3) for bits in mi.sample_tea_32(key[0], key[1] + segment * 4 + turn)]
        lobe, to_x, to_y, lamp_x, lamp_y = (
            dr.select(fresh, number, other) for number, other in zip(numbers, later, strict=False)
        )
        # A mirror consumes no random numbers.
        fresh &= ~(mi.has_flag(bsdf.flags(), mi.BSDFFlags.Smooth) | mi.has_flag(bsdf.flags(), through))
        matte = shown & active & mi.has_flag(bsdf.flags(), mi.BSDFFlags.Smooth)
        for lamp in lamps:
            direction, weight = lamp.sample_direction(hit, mi.Point2f(lamp_x, lamp_y), matte)
            start = hit.p + CLEARANCE_MM * direction.d
            way = mi.Ray3f(mi.Ray3f(start, direction.d), direction.dist - 2.0 * CLEARANCE_MM)
            value = bsdf.eval(context, hit, hit.to_local(direction.d), matte)
            lit = matte & (direction.pdf > 0.0) & dr.any(value > 0.0)
            lit &= ~scene.ray_test(way, lit)
            added = dr.select(lit, throughput * value * weight, 0.0)
            colour += dr.select(scattered > 0, dr.minimum(added, most_indirect), added)
        sample, weight = bsdf.sample(context, hit, lobe, mi.Point2f(to_x, to_y), active)
        throughput *= weight
        delta = mi.has_flag(sample.sampled_type, mi.BSDFFlags.Delta)
        scattered = dr.select(delta, scattered, scattered + 1)
        active &= (delta | (segment >= first)) & (scattered < MATTE_BOUNCES) & (segment + 1 < SEGMENTS)
        active &= dr.any(throughput > 0.0)
        direction_on = hit.to_world(sample.wo)
        ray = mi.Ray3f(hit.p + CLEARANCE_MM * direction_on, direction_on)
        return ray, colour, throughput, active, straight & delta, fresh, scattered, segment + 1

    none = mi.UInt32(0)
    start = (ray, mi.Color3f(0.0), mi.Color3f(1.0), mi.Bool(True), mi.Bool(True), mi.Bool(True), none, none)
    return dr.while_loop(start, lambda *state: state[3], bounce)[1]
