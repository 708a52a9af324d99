"""The layout's light, ray-cast against meshes: an independent proof that nothing blocks it.

Light is traced from the pupil over the mirrors, through the glass of second-surface ones, by the code that judges
layouts; the cones and beams that parts are cut with are not used. All in rig, mm.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import manifold3d
import numpy as np
from shapely import Polygon, contains_xy, get_coordinates

from mirrorcam.cad.checks.exported_mesh import hits
from mirrorcam.cad.plan.hardware import Hardware
from mirrorcam.cad.plan.seats import working_distance_mm
from mirrorcam.cad.write.part_export import STL_TOLERANCE_MM
from mirrorcam.core.values import FloatArray, Metric
from mirrorcam.optics.design.assess.chief_rays import sampled_light, traced
from mirrorcam.optics.geometry.layout import SLIVER, Layout
from mirrorcam.optics.geometry.mirror import Mirror

# Rays stop this far from the mirror that they leave: the rounding of the STL's 32-bit numbers is 1e-5 mm.
SURFACE_MM = 1e-3
# Rays go through a grid of this step, or a finer one that has this many points on a small mirror.
RAY_STEP_MM = 1.0
RAYS_OF_MIRROR = 200
# Clearances larger than this are not measured.
NEAR_MM = 10.0
# Pixels along an edge of a sub-image whose light through the rim of the pupil is cast.
RIM_STEPS = 12


@dataclass(frozen=True)
class MirrorLight:
    """The light of one mirror: segments (2, n, 2, 3) from the mirror to the pupil and from it to the working distance.

    The first `inner` of them go through a grid on the mirror, the others through its edge.
    """

    rays: FloatArray
    inner: int

    @property
    def hulls(self) -> tuple[manifold3d.Manifold, manifold3d.Manifold]:
        """The light to the pupil and to the scene as convex solids."""
        return tuple(manifold3d.Manifold.hull_points(leg[self.inner :].reshape(-1, 3)) for leg in self.rays)


def light_of(layout: Layout, index: int, hardware: Hardware) -> MirrorLight:
    """Exact light from the middle of the pupil over the usable part of a mirror, if it has any."""
    mirror = layout.mirrors[index]
    flat, inner = _grid(mirror, RAY_STEP_MM)
    if len(flat) == 0:
        return MirrorLight(np.zeros((2, 0, 2, 3)), 0)
    points = _on_apparent(mirror, flat)
    met, leaving, directions = traced(mirror, points[:, :2] / points[:, 2:])
    return MirrorLight(_segments(layout, hardware, met, np.zeros_like(met), leaving, directions), inner)


def light_of_rim(layout: Layout, index: int, hardware: Hardware) -> FloatArray:
    """Segments (2, n, 2, 3) as in `light_of`, but from all over the pupil, of pixels whose whole pupil is served."""
    mirror = layout.mirrors[index]
    starts, rays = sampled_light(mirror, layout.camera.pupil, RIM_STEPS)
    met, leaving, directions = traced(mirror, rays, starts)
    return _segments(layout, hardware, met, starts, leaving, directions)


def _grid(mirror: Mirror, step_mm: float) -> tuple[FloatArray, int]:
    """Points (n, 2) on the apparent mirror, in its frame: first a grid, then the edge; and how many the grid has."""
    if len(mirror.usable_normalized) == 0:
        return np.zeros((0, 2)), 0
    apparent = mirror.apparent
    frame = apparent.rig_from_plane
    area = Polygon((apparent.cut(mirror.usable_normalized) - frame[:3, 3]) @ frame[:3, :2])
    step = min(step_mm, float(np.sqrt(area.area / RAYS_OF_MIRROR)))
    left, bottom, right, top = area.bounds
    grid = np.stack(np.meshgrid(np.arange(left, right, step), np.arange(bottom, top, step)), axis=-1).reshape(-1, 2)
    grid = grid[contains_xy(area, grid[:, 0], grid[:, 1])]
    return np.concatenate([grid, get_coordinates(area.exterior.segmentize(step))]), len(grid)


def _on_apparent(mirror: Mirror, flat: FloatArray) -> FloatArray:
    frame = mirror.apparent.rig_from_plane
    return np.asarray(flat @ frame[:3, :2].T + frame[:3, 3])


def _segments(
    layout: Layout,
    hardware: Hardware,
    met: FloatArray,
    pupil: FloatArray,
    leaving: FloatArray,
    directions: FloatArray,
) -> FloatArray:
    """Segments (2, n, 2, 3), mirror first, that begin `SURFACE_MM` before it."""
    forward = layout.view_from_rig[2]
    reach = (working_distance_mm(layout, hardware) - leaving @ forward) / (directions @ forward)
    near, far = np.stack([met, leaving]), np.stack([pupil, leaving + reach[:, None] * directions])
    towards = (far - near) / np.linalg.norm(far - near, axis=-1, keepdims=True)
    return np.stack([near + SURFACE_MM * towards, far], axis=-2)


def check_light(
    layout: Layout,
    hardware: Hardware,
    parts: Mapping[str, manifold3d.Manifold],
    mirrors: Sequence[manifold3d.Manifold | None],
    camera: manifold3d.Manifold | None,
) -> dict[str, Metric]:
    """Check that no part blocks the light.

    Parameters
    ----------
    layout : Layout
        Camera and mirrors.
    hardware : Hardware
        The gap between parts and light, and the working distance of a layout without a spec.
    parts : mapping of str to Manifold
        Solids that must not stand in the light, by name: the printed parts and what carries the device.
    mirrors : sequence of Manifold or None
        Solids of the mirrors in the layout's order, None where one is missing.
    camera : Manifold or None
        The camera's body. It holds the pupil, so only the light on its way out is cast against it.

    Returns
    -------
    dict of str to Metric
        Rays that are blocked, the gap between each part and the light (as wide as parts are cut, less the tolerance of
        their meshes), and the light that mirrors hide from each other (limited as in a layout as built).
    """
    lights = [light_of(layout, index, hardware) for index in range(len(layout.mirrors))]
    together = manifold3d.Manifold.compose(list(parts.values()))
    cast, blocked = _cast(lights, together, camera)
    least = 2 * RAYS_OF_MIRROR * len(lights)
    return {
        "device.rays_cast": Metric(value=cast, unit="", limit=least, lower_is_better=False),
        "device.rays_blocked": Metric(value=blocked, unit="", limit=0),
        "device.mirrors_without_light": Metric(value=sum(light.inner == 0 for light in lights), unit="", limit=0),
        "device.rim_light_stopped": Metric(
            value=_rim_light_stopped(layout, together, hardware), unit="of the light", limit=0.0
        ),
        "device.shade_of_sheets": Metric(value=shade_of_mirrors(lights, mirrors), unit="of the light", limit=SLIVER),
        **_light_gaps(lights, parts, hardware),
    }


def _cast(
    lights: Sequence[MirrorLight], parts: manifold3d.Manifold, camera: manifold3d.Manifold | None
) -> tuple[int, int]:
    """Numbers of rays that are cast against the parts, and that those, or the camera on the way out, block."""
    rays = np.concatenate([light.rays.reshape(-1, 2, 3) for light in lights])
    blocked = hits(parts, rays)
    if camera is not None:
        blocked += hits(camera, np.concatenate([light.rays[1] for light in lights]))
    return len(rays), blocked


def _rim_light_stopped(layout: Layout, parts: manifold3d.Manifold, hardware: Hardware) -> float:
    """Share of the rays of the worst mirror, of whole pupils, that the parts block."""
    rims = [light_of_rim(layout, index, hardware) for index in range(len(layout.mirrors))]
    return max((hits(parts, rim.reshape(-1, 2, 3)) / max(2 * rim.shape[1], 1) for rim in rims), default=0.0)


def _light_gaps(
    lights: Sequence[MirrorLight], parts: Mapping[str, manifold3d.Manifold], hardware: Hardware
) -> dict[str, Metric]:
    """Gap between each part and the light: as wide as parts are cut, less the tolerance of their meshes."""
    hulls = [hull for light in lights if len(light.rays[0]) for hull in light.hulls]
    gaps = {name: min((part.min_gap(hull, NEAR_MM) for hull in hulls), default=0.0) for name, part in parts.items()}
    least = hardware.fit.light_mm - STL_TOLERANCE_MM
    return {
        f"{name}.light_gap_mm": Metric(value=round(gap, 4), unit="mm", limit=least, lower_is_better=False)
        for name, gap in gaps.items()
    }


def shade_of_mirrors(lights: Sequence[MirrorLight], mirrors: Sequence[manifold3d.Manifold | None]) -> float:
    """Share of the light of the worst mirror that the other mirrors' solids stop: the cost of thick mirrors."""
    worst = 0.0
    for index, light in enumerate(lights):
        others = manifold3d.Manifold.compose([solid for place, solid in enumerate(mirrors) if solid and place != index])
        legs = light.rays[:, : light.inner]
        shaded = [bool(others.ray_cast(*a)) or bool(others.ray_cast(*b)) for a, b in zip(*legs, strict=True)]
        worst = max(worst, float(np.mean(shaded)) if shaded else 0.0)
    return worst
