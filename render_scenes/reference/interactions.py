"""Interactions of light with surfaces, in Dr.Jit, for any variant that has been set: emission, BSDFs, direct light."""

from __future__ import annotations

from typing import Any

# Along the reflected ray: far above the single precision of a hit (1e-5 mm), far below any gap of a real device.
CLEARANCE_MM = 0.02


def invert(condition: Any) -> Any:
    """Negate a mask; ~ of a bool of Python, in scalar variants, is no bool."""
    import drjit as dr
    import mitsuba as mi

    return dr.select(condition, mi.Bool(False), mi.Bool(True))


def has_flag(bsdf: Any, flag: Any, active: Any) -> Any:
    """Mask of the active lanes whose BSDF has a flag."""
    import mitsuba as mi

    return mi.Bool(False) if bsdf is None else active & mi.has_flag(bsdf.flags(), flag)


def emitted_radiance(scene: Any, hit: Any, active: Any) -> Any:
    """Radiance that an intersected emitter, or the environment, emits towards the ray."""
    import mitsuba as mi

    emitter = hit.emitter(scene)
    return mi.Spectrum(0.0) if emitter is None else emitter.eval(hit, active)  # None: scalar variants only


def sample_bsdf(bsdf: Any, hit: Any, one: Any, two: Any, active: Any) -> tuple[Any, Any]:
    """Sample the BSDF of a surface with one and two random numbers."""
    import mitsuba as mi

    if bsdf is None:
        return mi.BSDFSample3f(), mi.Spectrum(0.0)
    return bsdf.sample(mi.BSDFContext(), hit, one, two, active)


def power_heuristic(density: Any, other: Any) -> Any:
    """Weight of one of two sampling strategies in multiple importance sampling (Veach 1997)."""
    import drjit as dr

    return dr.select(density > 0.0, density * density / dr.maximum(density * density + other * other, 1e-30), 0.0)


def direct_light(scene: Any, hit: Any, bsdf: Any, random: Any, active: Any) -> Any:
    """Radiance that a surface scatters of one sampled point of each emitter (next event estimation).

    The environment is left to BSDF sampling, which is free of noise wherever nothing occludes a uniform environment.
    """
    import drjit as dr
    import mitsuba as mi

    smooth, total = has_flag(bsdf, mi.BSDFFlags.Smooth, active), mi.Spectrum(0.0)
    for emitter in scene.emitters():
        if emitter.is_environment():
            continue
        towards, light = emitter.sample_direction(hit, random, smooth)
        value, other = bsdf.eval_pdf(mi.BSDFContext(), hit, hit.to_local(towards.d), smooth)
        light *= value * dr.select(towards.delta, 1.0, power_heuristic(towards.pdf, other))
        lit = smooth & (towards.pdf > 0.0) & dr.any(light > 0.0)
        shadow = mi.Ray3f(mi.Ray3f(hit.p + CLEARANCE_MM * towards.d, towards.d), towards.dist - 2.0 * CLEARANCE_MM)
        total += dr.select(lit & invert(scene.ray_test(shadow, lit)), light, 0.0)
    return total
