"""A tabletop scene with its light and the mirrors in Mitsuba, rendered via the mirrors or from pinholes.

Coordinates are in the rig frame, in mm.

Paths are traced in colour with next event estimation, through scenes of mirrors, glass and diffuse surfaces. The
variance is low, so few samples suffice. At every diffuse surface of a path, one point of each area light is
sampled. Cosine-weighted sampling continues the path, so a uniform environment lights unoccluded surfaces without
noise. One low-discrepancy sequence gives the position in the pixel and the random numbers of the first diffuse surface;
later bounces use independent numbers.

Caustics, from an area light via mirror or glass onto a diffuse surface, are not modelled, because their noise would
need thousands of samples. Glass therefore casts a shadow. Light is scattered by at most `MAX_MATTE_BOUNCES` diffuse
surfaces.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.pupil import Pupil
from mirrorcam.optics.light_field.light_field import Views
from mirrorcam.render_scenes.mirror_finish import MirrorFinish
from mirrorcam.render_scenes.reference.camera_sensor import sensor
from mirrorcam.render_scenes.reference.integrator import CLEARANCE_MM, additive_steps
from mirrorcam.render_scenes.reference.mirror_shapes import mirror_shapes
from mirrorcam.render_scenes.tabletop.objects import lights, shapes_of
from mirrorcam.render_scenes.tabletop.tabletop import Tabletop
from mirrorcam.render_scenes.variant import SCALAR, use_variant

RayThrough = Callable[[Any, Any, Any, Any], Any]
"""From x, y, u, v: the ray from the pupil point (u, v), 0 to 1, to the sensor point (x, y) in Mitsuba's pixels."""

MAX_MATTE_BOUNCES = 3
MAX_SEGMENTS = 12  # of a path, including those through glass and between mirrors
# Position in a pixel (2); at the first diffuse surface: lobe, direction (2), point of the area light (2); pupil (2).
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
    via_mirrors: bool,
    max_indirect: float = np.inf,
) -> NDArray[np.float32]:
    """Render a scene in colour; the same arguments give the same bits. Needs a compiled variant in colour.

    Parameters
    ----------
    scene
        Scene of the current variant.
    ray_through
        The camera: called with x, y, u, v.
    is_pinhole
        Whether the camera ignores u and v.
    size
        Width and height in pixels.
    subpixels
        Subpixels along each side of a pixel.
    spp
        Samples per subpixel.
    seed
        Seed of the sample pattern.
    via_mirrors
        Whether surfaces that the camera sees without a mirror are black.
    most_indirect
        Maximum of an area light's contribution to a sample via a scattering surface. It suppresses the brightest
        glints on other surfaces, whose noise would need thousands of samples.

    Returns
    -------
    NDArray[np.float32]
        Radiance (height * subpixels, width * subpixels, 3).
    """
    import drjit as dr
    import mitsuba as mi

    width, height = (length * subpixels for length in size)
    # Opaque values do not become constants of the kernel, which is therefore compiled once.
    opaque: list[Any] = [mi.UInt32(number) for number in (width, spp, seed, int(via_mirrors))]
    columns, samples, key, first_segment = opaque
    side = mi.Float(1.0 / subpixels)
    bound = mi.Float(max_indirect)
    dr.make_opaque(opaque, side, bound)
    subpixel: Any = dr.arange(mi.UInt32, width * height)
    left, top = mi.Float(subpixel % columns), mi.Float(subpixel // columns)
    dimensions = _NUMBERS - 2 if is_pinhole else _NUMBERS
    shifts = [bits for pair in range(5) for bits in mi.sample_tea_32(subpixel, key + (pair << 24))][:dimensions]
    steps = [round(step * 2.0**32) for step in additive_steps(dimensions)]

    def add_sample(total: Any, count: Any) -> tuple[Any, ...]:
        numbers = [_unit(shift + count * mi.UInt32(step)) for shift, step in zip(shifts, steps, strict=True)]
        u, v = (0.5, 0.5) if is_pinhole else numbers[7:]
        ray = ray_through((left + numbers[0]) * side, (top + numbers[1]) * side, u, v)
        sample_key = subpixel, key ^ (count * mi.UInt32(0x9E3779B9))
        radiance = _radiance(scene, mi.Ray3f(ray), numbers[2:7], first_segment, sample_key, bound)
        return total + radiance, count + 1

    start: Any = mi.Color3f(0.0), mi.UInt32(0)
    total: Any = dr.while_loop(start, lambda *state: state[1] < samples, add_sample)[0]
    pixels: Any = dr.ravel(total / mi.Float(samples))
    return np.asarray(pixels.numpy(), dtype=np.float32).reshape(height, width, 3)


def _unit(bits: Any) -> Any:
    """Convert 32 random bits to numbers in [0, 1)."""
    import mitsuba as mi

    return mi.Float(bits >> 8) * 2.0**-24


def _radiance(
    scene: Any, ray: Any, numbers: list[Any], first_segment: Any, key: tuple[Any, Any], max_indirect: Any
) -> Any:
    """Return the colour along rays.

    `numbers` are the five random numbers of the first diffuse surface; `key` generates those of later ones. Before
    segment `first_segment`, surfaces only reflect.
    """
    import drjit as dr
    import mitsuba as mi

    context, through = mi.BSDFContext(), mi.BSDFFlags.DeltaTransmission
    lamps = [emitter for emitter in scene.emitters() if not emitter.is_environment()]

    def bounce(
        ray: Any,
        colour: Any,
        throughput: Any,
        active: Any,
        is_direct: Any,
        first_numbers: Any,
        scattered: Any,
        segment: Any,
    ) -> tuple[Any, ...]:
        hit = scene.ray_intersect(ray, mi.RayFlags.All, True, active)
        visible = active & (segment >= first_segment)
        # A path that meets an area light after a diffuse surface has been counted there by direct sampling.
        counts = visible & (is_direct | ~hit.is_valid())
        colour += dr.select(counts, throughput * hit.emitter(scene).eval(hit, counts), 0.0)
        active &= hit.is_valid()
        bsdf = hit.bsdf(ray)
        later = [_unit(bits) for pair in range(3) for bits in mi.sample_tea_32(key[0], key[1] + segment * 4 + pair)]
        lobe, to_x, to_y, lamp_x, lamp_y = (
            dr.select(first_numbers, number, other) for number, other in zip(numbers, later, strict=False)
        )
        # A mirror uses no random numbers.
        first_numbers &= ~(mi.has_flag(bsdf.flags(), mi.BSDFFlags.Smooth) | mi.has_flag(bsdf.flags(), through))
        matte = visible & active & mi.has_flag(bsdf.flags(), mi.BSDFFlags.Smooth)
        for lamp in lamps:
            direction, weight = lamp.sample_direction(hit, mi.Point2f(lamp_x, lamp_y), matte)
            start = hit.p + CLEARANCE_MM * direction.d
            shadow_ray = mi.Ray3f(mi.Ray3f(start, direction.d), direction.dist - 2.0 * CLEARANCE_MM)
            value = bsdf.eval(context, hit, hit.to_local(direction.d), matte)
            lit = matte & (direction.pdf > 0.0) & dr.any(value > 0.0)
            lit &= ~scene.ray_test(shadow_ray, lit)
            added = dr.select(lit, throughput * value * weight, 0.0)
            colour += dr.select(scattered > 0, dr.minimum(added, max_indirect), added)
        sample, weight = bsdf.sample(context, hit, lobe, mi.Point2f(to_x, to_y), active)
        throughput *= weight
        delta = mi.has_flag(sample.sampled_type, mi.BSDFFlags.Delta)
        scattered = dr.select(delta, scattered, scattered + 1)
        active &= (delta | (segment >= first_segment)) & (scattered < MAX_MATTE_BOUNCES) & (segment + 1 < MAX_SEGMENTS)
        active &= dr.any(throughput > 0.0)
        direction_out = hit.to_world(sample.wo)
        ray = mi.Ray3f(hit.p + CLEARANCE_MM * direction_out, direction_out)
        return ray, colour, throughput, active, is_direct & delta, first_numbers, scattered, segment + 1

    zero = mi.UInt32(0)
    start = (ray, mi.Color3f(0.0), mi.Color3f(1.0), mi.Bool(True), mi.Bool(True), mi.Bool(True), zero, zero)
    return dr.while_loop(start, lambda *state: state[3], bounce)[1]


NOTHING = -1


@dataclass(frozen=True, eq=False)
class Hits:
    """First intersections of rays (...): points (..., 3), path lengths (...), mm, and indices (...) of the objects.

    A ray without an object has values that are not finite, and the index `NOTHING`.
    """

    points: FloatArray
    path_mm: FloatArray
    object_index: NDArray[np.int64]


class TabletopScene:
    """Objects and light sources in front of the mirrors of a layout.

    The mirrors are part of the scene: they occlude light and are reflected in glossy objects.

    Parameters
    ----------
    layout
        The device as built.
    tabletop
        The objects.
    mirror_reflectance
        Reflectance of all mirrors.
    variant
        Mitsuba's variant; by default the fastest in colour.

    Raises
    ------
    InputError
        If no backend compiles.
    """

    def __init__(self, layout: Layout, tabletop: Tabletop, mirror_reflectance: float, variant: str | None = None):
        self.variant = use_variant(variant, colour=True)
        if self.variant == SCALAR:
            raise InputError("a scene in colour needs a GPU or an LLVM that compiles: pip install karellen-llvm-core")
        import mitsuba as mi

        self.layout = layout
        view_from_rig = layout.view_from_rig
        shapes = {
            f"thing_{i}_{k}": shape
            for i, item in enumerate(tabletop.objects)
            for k, shape in enumerate(shapes_of(item, view_from_rig))
        }
        self._scene = mi.load_dict(
            {
                "type": "scene",
                **lights(tabletop.lamp_target_in_view_mm, tabletop.scale_mm, view_from_rig),
                **{
                    f"mirror_{index}_{face}": shape
                    for index, mirror in enumerate(layout.mirrors)
                    for face, shape in mirror_shapes(
                        mirror, MirrorFinish(reflectance=(mirror_reflectance,) * 3)
                    ).items()
                },
                **shapes,
            }
        )
        self._owners = [(shape, int(name.split("_")[1])) for name, shape in shapes.items()]

    def photograph(self, pupil: Pupil, *, spp: int, subpixels: int, seed: int) -> NDArray[np.float32]:
        """Render radiance (h * subpixels, w * subpixels, 3) of the sensor via the mirrors; the rest is black."""
        camera, lens = self.layout.camera, sensor(self.layout.camera, pupil=pupil)
        size = camera.width_px, camera.height_px
        options = {"spp": spp, "subpixels": subpixels, "seed": seed}
        return self._render(lens.ray_through, size, is_pinhole=lens.is_pinhole, via_mirrors=True, **options)

    def view(self, views: Views, t: int, s: int, start_depth_mm: float, *, spp: int, seed: int) -> NDArray[np.float32]:
        """Render the radiance (v, u, 3) of a pinhole at a view's position; objects nearer than a depth are ignored."""
        ray_through = pinhole(views, t, s, start_depth_mm)
        return self._render(
            ray_through,
            (views.width_px, views.height_px),
            is_pinhole=True,
            spp=spp,
            subpixels=1,
            seed=seed,
            via_mirrors=False,
        )

    def hits(self, start: FloatArray, direction: FloatArray) -> Hits:
        """Intersect rays from points (..., 3), mm, along unit vectors (..., 3) with the objects."""
        use_variant(self.variant)
        import drjit as dr
        import mitsuba as mi

        valid = np.isfinite(start).all(axis=-1) & np.isfinite(direction).all(axis=-1)
        # Start beyond the surface of the mirror.
        start_beyond = start + CLEARANCE_MM * direction
        rays = mi.Ray3f(
            *(mi.Point3f(np.float32(np.nan_to_num(vectors).reshape(-1, 3).T)) for vectors in (start_beyond, direction))
        )
        hit = self._scene.ray_intersect(rays, mi.Bool(valid.ravel()))
        item = mi.Int32(NOTHING)
        for shape, index in self._owners:
            item = dr.select(hit.shape == mi.ShapePtr(shape), index, item)
        path_mm = np.where(valid, np.array(hit.t, dtype=np.float64).reshape(valid.shape), np.inf)
        object_index = np.where(valid, np.array(item).reshape(valid.shape), NOTHING)
        length_mm = np.where(object_index == NOTHING, np.inf, CLEARANCE_MM + path_mm)
        with np.errstate(invalid="ignore"):
            points = start + length_mm[..., None] * direction
        return Hits(points, length_mm, object_index)

    def _render(self, ray_through: RayThrough, size: tuple[int, int], **options: Any) -> NDArray[np.float32]:
        use_variant(self.variant)
        return render_lit(self._scene, ray_through, size=size, **options)


def pinhole_rays(views: Views, t: int, s: int, start_depth_mm: float) -> tuple[FloatArray, FloatArray]:
    """Return points (v, u, 3), mm, at a depth on the rays of a view's pixel centres, and the rays' unit vectors."""
    centre = views.reference_view_in_rig_mm + views.positions_mm[t, s] @ views.view_from_rig
    direction = views.plane_points_in_rig(views.reference_depth_mm, views.pixel_grid()) - centre
    direction /= np.linalg.norm(direction, axis=-1, keepdims=True)
    forward = views.view_from_rig[2]
    return centre + direction * ((start_depth_mm - centre @ forward) / (direction @ forward))[..., None], direction


def pinhole(views: Views, t: int, s: int, start_depth_mm: float) -> RayThrough:
    """Return `pinhole_rays` as a Dr.Jit function of points in Mitsuba's pixels."""
    import drjit as dr
    import mitsuba as mi

    centre = views.reference_view_in_rig_mm + views.positions_mm[t, s] @ views.view_from_rig
    # Pixels are an even grid on the reference plane.
    corner, right, down = views.plane_points_in_rig(
        views.reference_depth_mm, np.array([[-0.5, -0.5], [0.5, -0.5], [-0.5, 0.5]])
    )
    numbers = [mi.Vector3f(*vector.tolist()) for vector in (centre, corner - centre, right - corner, down - corner)]
    forward = mi.Vector3f(*views.view_from_rig[2].tolist())
    start_z = mi.Float(float(start_depth_mm - centre @ views.view_from_rig[2]))
    dr.make_opaque(numbers, forward, start_z)

    def ray_through(x: Any, y: Any, u: Any, v: Any) -> Any:
        direction = numbers[1] + x * numbers[2] + y * numbers[3]
        return mi.Ray3f(
            mi.Point3f(numbers[0] + direction * (start_z / dr.dot(direction, forward))), dr.normalize(direction)
        )

    return ray_through
