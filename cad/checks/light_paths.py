"""Ray casts of the layout's light against meshes: an independent proof that nothing blocks it.

Light is traced from the pupil over the mirrors, including refraction in second-surface mirrors, by the code that
assesses layouts. The cones and beams with which parts are cut are not used. All coordinates are in rig, mm.

Two more checks use such rays. The first tests the camera's view in calibration pictures against the pieces built by
then: pictures of the bare camera need a free view, and pictures through the mirrors need every mirror's part of the
frame. The second measures how much light of the surroundings reaches the mirrors, past a hood that also keeps off dust.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import manifold3d
import numpy as np
from shapely import Polygon, contains_xy, get_coordinates

from mirrorcam.cad.assembly.build_steps import STEPS, Step, with_camera
from mirrorcam.cad.assembly.pieces import item_names
from mirrorcam.cad.checks.clashes import is_mirror
from mirrorcam.cad.checks.exported_mesh import hits
from mirrorcam.cad.holder.stray_light import viewing_rays
from mirrorcam.cad.plan.hardware import Hardware
from mirrorcam.cad.plan.part_plan import BoughtItem
from mirrorcam.cad.plan.seats import working_distance_mm
from mirrorcam.cad.write.part_export import STL_TOLERANCE_MM
from mirrorcam.core.values import FloatArray, Metric
from mirrorcam.optics.design.assess.chief_rays import sampled_light, traced
from mirrorcam.optics.geometry.layout import MAX_HIDDEN, Layout
from mirrorcam.optics.geometry.mirror import Mirror

# Rays start this far from the mirror: the rounding of the STL's 32-bit numbers is 1e-5 mm.
SURFACE_MM = 1e-3
# Step of the grid of rays; a small mirror has a finer grid with this number of points.
RAY_STEP_MM = 1.0
RAYS_OF_MIRROR = 200
# Larger clearances are not measured.
NEAR_MM = 10.0
# Number of pixels along an edge of a sub-image for rays through the rim of the pupil.
RIM_STEPS = 12


@dataclass(frozen=True)
class MirrorLight:
    """The light of one mirror: segments (2, n, 2, 3) from the mirror to the pupil, and to the working distance.

    The first `inner` segments pass through a grid on the mirror, the others through its edge.
    """

    rays: FloatArray
    inner: int

    @property
    def hulls(self) -> tuple[manifold3d.Manifold, manifold3d.Manifold]:
        """The light to the pupil and the light to the scene as convex solids."""
        return tuple(manifold3d.Manifold.hull_points(leg[self.inner :].reshape(-1, 3)) for leg in self.rays)


def light_of(layout: Layout, index: int, hardware: Hardware) -> MirrorLight:
    """Exact light from the middle of the pupil over the usable part of a mirror; empty if it has none."""
    mirror = layout.mirrors[index]
    flat, inner = _grid(mirror, RAY_STEP_MM)
    if len(flat) == 0:
        return MirrorLight(np.zeros((2, 0, 2, 3)), 0)
    points = _on_apparent(mirror, flat)
    met, leaving, directions = traced(mirror, points[:, :2] / points[:, 2:])
    return MirrorLight(_segments(layout, hardware, met, np.zeros_like(met), leaving, directions), inner)


def light_of_rim(layout: Layout, index: int, hardware: Hardware) -> FloatArray:
    """Segments (2, n, 2, 3) as in `light_of`, but from the full pupil, for unvignetted pixels."""
    mirror = layout.mirrors[index]
    starts, rays = sampled_light(mirror, layout.camera.pupil, RIM_STEPS)
    met, leaving, directions = traced(mirror, rays, starts)
    return _segments(layout, hardware, met, starts, leaving, directions)


def _grid(mirror: Mirror, step_mm: float) -> tuple[FloatArray, int]:
    """Points (n, 2) on the apparent mirror, in its frame: first a grid, then the edge; and the number in the grid."""
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
    """Segments (2, n, 2, 3), mirror first, that start `SURFACE_MM` from it."""
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
        Solids that must not block light, by name: the printed parts and the device's support.
    mirrors : sequence of Manifold or None
        Solids of the mirrors in the layout's order, None for a missing one.
    camera : Manifold or None
        The camera's body. It contains the pupil, so that only the light to the scene is cast against it.

    Returns
    -------
    dict of str to Metric
        Number of blocked rays; the gap between each part and the light, limited by the fit minus the tolerance of the
        meshes; the light that mirrors block for each other, with the limit for a layout as built.
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
        "device.shade_of_sheets": Metric(
            value=shade_of_mirrors(lights, mirrors), unit="of the light", limit=MAX_HIDDEN
        ),
        **_light_gaps(lights, parts, hardware),
    }


def _cast(
    lights: Sequence[MirrorLight], parts: manifold3d.Manifold, camera: manifold3d.Manifold | None
) -> tuple[int, int]:
    """Number of rays cast, and number of those that the parts, or on the way to the scene the camera, block."""
    rays = np.concatenate([light.rays.reshape(-1, 2, 3) for light in lights])
    blocked = hits(parts, rays)
    if camera is not None:
        blocked += hits(camera, np.concatenate([light.rays[1] for light in lights]))
    return len(rays), blocked


def _rim_light_stopped(layout: Layout, parts: manifold3d.Manifold, hardware: Hardware) -> float:
    """Largest share, over the mirrors, of the rays through the full pupil that the parts block."""
    rims = [light_of_rim(layout, index, hardware) for index in range(len(layout.mirrors))]
    return max((hits(parts, rim.reshape(-1, 2, 3)) / max(2 * rim.shape[1], 1) for rim in rims), default=0.0)


def _light_gaps(
    lights: Sequence[MirrorLight], parts: Mapping[str, manifold3d.Manifold], hardware: Hardware
) -> dict[str, Metric]:
    """Gap between each part and the light, limited by the fit minus the tolerance of the meshes."""
    hulls = [hull for light in lights if len(light.rays[0]) for hull in light.hulls]
    gaps = {name: min((part.min_gap(hull, NEAR_MM) for hull in hulls), default=0.0) for name, part in parts.items()}
    least = hardware.fit.light_mm - STL_TOLERANCE_MM
    return {
        f"{name}.light_gap_mm": Metric(value=round(gap, 4), unit="mm", limit=least, lower_is_better=False)
        for name, gap in gaps.items()
    }


def shade_of_mirrors(lights: Sequence[MirrorLight], mirrors: Sequence[manifold3d.Manifold | None]) -> float:
    """Largest share of a mirror's light that the other mirrors' solids block: the cost of thick mirrors."""
    worst = 0.0
    for index, light in enumerate(lights):
        others = manifold3d.Manifold.compose([solid for place, solid in enumerate(mirrors) if solid and place != index])
        legs = light.rays[:, : light.inner]
        shaded = [bool(others.ray_cast(*a)) or bool(others.ray_cast(*b)) for a, b in zip(*legs, strict=True)]
        worst = max(worst, float(np.mean(shaded)) if shaded else 0.0)
    return worst


# Length of rays, beyond the device.
FAR_MM = 1000.0


def check_step_views(
    layout: Layout,
    items: Sequence[BoughtItem],
    solids: Mapping[str, manifold3d.Manifold],
    steps: Sequence[Step] = STEPS,
) -> dict[str, Metric]:
    """Check that nothing blocks the camera's view in calibration pictures.

    Parameters
    ----------
    layout : Layout
        Camera and mirrors.
    items : sequence of BoughtItem
        All bought items of the device, in the order of their names.
    solids : mapping of str to Manifold
        The solids of the assembled device by name, in rig, mm.
    steps : sequence of Step
        The steps of assembly.

    Returns
    -------
    dict of str to Metric
        For each step that takes pictures, named by their folder: the hidden share of the frame. Without mirrors, the
        full frame counts. With mirrors, the usable parts of the sub-images count, and are hidden where another piece is
        in front of the mirror.
    """
    fastened = {name: item.joins for name, item in zip(item_names(items), items, strict=True)}
    pieces = [name for name in solids if name not in fastened]
    rays = viewing_rays(layout.camera)
    checks = {}
    for step in steps:
        if not step.pictures:
            continue
        names = with_camera(steps, step, pieces, fastened)
        mirrors = {name for name in names if is_mirror(name)}
        others = manifold3d.Manifold.compose([solids[name] for name in sorted(names - mirrors) if name in solids])
        seen = {name: solids[name] for name in sorted(mirrors)}
        hidden = _hidden_before_mirrors(layout, rays, others, seen) if seen else _hidden(rays, others)
        checks[f"device.{step.pictures}_pictures_hidden"] = Metric(
            value=round(hidden / len(rays), 4), unit="of the frame", limit=0.0
        )
    return checks


def _hidden(rays: FloatArray, solid: manifold3d.Manifold) -> int:
    """Number of viewing rays (n, 2), normalized, that meet a solid."""
    return int(np.isfinite(_first_hit_mm(rays, solid)).sum())


def _hidden_before_mirrors(
    layout: Layout, rays: FloatArray, others: manifold3d.Manifold, mirrors: Mapping[str, manifold3d.Manifold]
) -> int:
    """Number of viewing rays (n, 2) in usable parts of sub-images that do not meet their mirror first."""
    count = 0
    for name, mirror in zip(layout.mirror_names, layout.mirrors, strict=True):
        if not len(mirror.usable_normalized):
            continue
        usable = rays[contains_xy(Polygon(mirror.usable_normalized), rays[:, 0], rays[:, 1])]
        own = mirrors.get(f"mirror_{name}")
        if own is None:
            count += len(usable)
            continue
        rest = manifold3d.Manifold.compose([others, *(solid for other, solid in mirrors.items() if solid is not own)])
        at_own = _first_hit_mm(usable, own)
        count += int((~np.isfinite(at_own) | (_first_hit_mm(usable, rest) < at_own)).sum())
    return count


def _first_hit_mm(rays: FloatArray, solid: manifold3d.Manifold) -> FloatArray:
    """z in mm (n,) of the first hits of viewing rays (n, 2), normalized, on a solid; infinite for rays that miss."""
    depths = np.full(len(rays), np.inf)
    for index, ray in enumerate(rays):
        hits = solid.ray_cast(np.zeros(3), np.array([*ray, 1.0]) * FAR_MM)
        if hits:
            depths[index] = min(float(hit.position[2]) for hit in hits)
    return depths


RAYS = 400
SURROUNDINGS_MM = 400.0
# Distance in front of a mirror at which rays start.
BEFORE_MM = 0.5
GOLDEN = np.pi * (3.0 - np.sqrt(5.0))


def check_surrounding_light(layout: Layout, solids: Mapping[str, manifold3d.Manifold]) -> dict[str, Metric]:
    """The share of light from uniformly bright surroundings that reaches the middles of the mirrors.

    It is a cosine-weighted share of each mirror's half-space that the device's solids (in rig, mm) leave free; 1 for
    bare mirrors.
    """
    together = manifold3d.Manifold.compose(list(solids.values()))
    rays = np.concatenate([_rays(mirror) for mirror in layout.mirrors])
    share = 1.0 - hits(together, rays) / len(rays)
    return {"device.surroundings_on_mirrors": Metric(value=round(share, 4), unit="of the half-space")}


def _rays(mirror: Mirror) -> FloatArray:
    """Segments (n, 2, 3) in rig from the middle of a mirror, with cosine-weighted directions (a spiral on a disc)."""
    place = np.arange(RAYS) + 0.5
    radius, turn = np.sqrt(place / RAYS), GOLDEN * place
    flat = np.column_stack([radius * np.cos(turn), radius * np.sin(turn)])
    directions = np.column_stack([flat, np.sqrt(np.maximum(1.0 - radius**2, 0.0))]) @ mirror.rig_from_plane[:3, :3].T
    start = mirror.outline_in_rig_mm.mean(axis=0) + (mirror.front_mm + BEFORE_MM) * mirror.normal_in_rig
    return np.stack([np.broadcast_to(start, directions.shape), start + SURROUNDINGS_MM * directions], axis=1)
