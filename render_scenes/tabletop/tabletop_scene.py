"""A tabletop scene with its light and the mirrors in Mitsuba, seen via the mirrors or by pinholes. In rig, mm."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.values import FloatArray, InputError
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.pupil import Pupil
from mirrorcam.optics.light_field.light_field import Views
from mirrorcam.render_scenes.mirror_finish import MirrorFinish
from mirrorcam.render_scenes.reference.camera_sensor import sensor
from mirrorcam.render_scenes.reference.interactions import CLEARANCE_MM
from mirrorcam.render_scenes.reference.mirror_shapes import mirror_shapes
from mirrorcam.render_scenes.tabletop.lit_integrator import RayThrough, render_lit
from mirrorcam.render_scenes.tabletop.objects import lights, shapes_of
from mirrorcam.render_scenes.tabletop.tabletop import Tabletop
from mirrorcam.render_scenes.variant import SCALAR, use_variant

NOTHING = -1


@dataclass(frozen=True, eq=False)
class Hits:
    """First intersections of rays (...): points (..., 3) in rig, mm, path lengths, mm, and indices of the objects.

    Not finite, and `NOTHING`, where a ray meets no object.
    """

    points: FloatArray
    path_mm: FloatArray
    object_index: NDArray[np.int64]


class TabletopScene:
    """Objects and light sources before the mirrors of a layout.

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
        No backend compiles.
    """

    def __init__(self, layout: Layout, tabletop: Tabletop, mirror_reflectance: float, variant: str | None = None):
        self.variant = use_variant(variant, colour=True)
        if self.variant == SCALAR:
            raise InputError("a scene in colour needs a GPU or an LLVM that compiles: pip install karellen-llvm-core")
        import mitsuba as mi

        self.layout = layout
        turn = layout.view_from_rig
        shapes = {f"thing_{i}_{k}": s for i, t in enumerate(tabletop.objects) for k, s in enumerate(shapes_of(t, turn))}
        self._scene = mi.load_dict(
            {
                "type": "scene",
                **lights(tabletop.lit_in_view, tabletop.reach_mm, turn),
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
        """Render radiance (h * subpixels, w * subpixels, 3) of the sensor via the mirrors; all else is black."""
        camera, lens = self.layout.camera, sensor(self.layout.camera, pupil=pupil)
        size = camera.width_px, camera.height_px
        how = {"spp": spp, "subpixels": subpixels, "seed": seed}
        return self._render(lens.ray_through, size, is_pinhole=lens.is_pinhole, by_mirrors=True, **how)

    def view(self, views: Views, t: int, s: int, start_depth_mm: float, *, spp: int, seed: int) -> NDArray[np.float32]:
        """Render the radiance (v, u, 3) in a pinhole at a view's position, of what lies beyond a depth."""
        through = pinhole(views, t, s, start_depth_mm)
        return self._render(
            through,
            (views.width_px, views.height_px),
            is_pinhole=True,
            spp=spp,
            subpixels=1,
            seed=seed,
            by_mirrors=False,
        )

    def hits(self, start: FloatArray, direction: FloatArray) -> Hits:
        """Intersect rays from points (..., 3), mm, along unit vectors (..., 3), in rig, with the objects."""
        use_variant(self.variant)
        import drjit as dr
        import mitsuba as mi

        known = np.isfinite(start).all(axis=-1) & np.isfinite(direction).all(axis=-1)
        # Off the mirrors that they leave, along the ray.
        leaves = start + CLEARANCE_MM * direction
        rays = mi.Ray3f(*(mi.Point3f(np.float32(np.nan_to_num(a).reshape(-1, 3).T)) for a in (leaves, direction)))
        hit = self._scene.ray_intersect(rays, mi.Bool(known.ravel()))
        item = mi.Int32(NOTHING)
        for shape, index in self._owners:
            item = dr.select(hit.shape == mi.ShapePtr(shape), index, item)
        path_mm = np.where(known, np.array(hit.t, dtype=np.float64).reshape(known.shape), np.inf)
        found = np.where(known, np.array(item).reshape(known.shape), NOTHING)
        met = np.where(found == NOTHING, np.inf, CLEARANCE_MM + path_mm)
        with np.errstate(invalid="ignore"):
            points = start + met[..., None] * direction
        return Hits(points, met, found)

    def _render(self, through: RayThrough, size: tuple[int, int], **how: Any) -> NDArray[np.float32]:
        use_variant(self.variant)
        return render_lit(self._scene, through, size=size, **how)


def pinhole_rays(views: Views, t: int, s: int, start_depth_mm: float) -> tuple[FloatArray, FloatArray]:
    """Points (v, u, 3), mm, where the rays of a view's pixel centres pass a depth, and their unit vectors, in rig."""
    centre = views.reference_view_in_rig_mm + views.positions_mm[t, s] @ views.view_from_rig
    direction = views.plane_points_in_rig(views.reference_depth_mm, views.pixel_grid()) - centre
    direction /= np.linalg.norm(direction, axis=-1, keepdims=True)
    forward = views.view_from_rig[2]
    return centre + direction * ((start_depth_mm - centre @ forward) / (direction @ forward))[..., None], direction


def pinhole(views: Views, t: int, s: int, start_depth_mm: float) -> RayThrough:
    """`pinhole_rays` for points of the view in Mitsuba's pixels, in Dr.Jit."""
    import drjit as dr
    import mitsuba as mi

    centre = views.reference_view_in_rig_mm + views.positions_mm[t, s] @ views.view_from_rig
    # Every pixel looks at a point of the reference plane: a step of a pixel is a step on that plane.
    corner, right, down = views.plane_points_in_rig(
        views.reference_depth_mm, np.array([[-0.5, -0.5], [0.5, -0.5], [-0.5, 0.5]])
    )
    numbers = [mi.Vector3f(*vector.tolist()) for vector in (centre, corner - centre, right - corner, down - corner)]
    forward = mi.Vector3f(*views.view_from_rig[2].tolist())
    before = mi.Float(float(start_depth_mm - centre @ views.view_from_rig[2]))
    dr.make_opaque(numbers, forward, before)

    def ray_through(x: Any, y: Any, u: Any, v: Any) -> Any:
        direction = numbers[1] + x * numbers[2] + y * numbers[3]
        return mi.Ray3f(
            mi.Point3f(numbers[0] + direction * (before / dr.dot(direction, forward))), dr.normalize(direction)
        )

    return ray_through
