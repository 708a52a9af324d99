"""Ray casts of the layout's light against meshes: an independent proof that nothing blocks it.

Light is traced from the pupil via the mirrors, including refraction in second-surface mirrors, by the code that
assesses layouts, not by the cones and beams that are subtracted from parts. All coordinates are in the rig frame, mm.

Two more checks cast rays. The first tests the camera's view in calibration pictures against the pieces assembled by
that step: pictures of the bare camera need a free view, and pictures via the mirrors need every mirror's part of
the frame. The second measures how much light from the surroundings reaches the mirrors past a hood.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import manifold3d
import numpy as np
from shapely import Polygon, contains_xy, get_coordinates

from mirrorcam.cad.assembly.build_steps import STEPS, Step, connected_to_camera
from mirrorcam.cad.assembly.components import item_names
from mirrorcam.cad.checks.clashes import is_mirror
from mirrorcam.cad.checks.exported_mesh import hits
from mirrorcam.cad.holder.stray_light import viewing_rays
from mirrorcam.cad.plan.hardware import Hardware
from mirrorcam.cad.plan.part_plan import PurchasedItem
from mirrorcam.cad.plan.seats import working_distance_mm
from mirrorcam.cad.write.part_export import STL_TOLERANCE_MM
from mirrorcam.core.values import FloatArray, Metric
from mirrorcam.optics.design.assess.chief_rays import sampled_light, traced
from mirrorcam.optics.geometry.layout import MAX_HIDDEN, Layout
from mirrorcam.optics.geometry.mirror import Mirror

# Distance from the mirror at which rays start, above the rounding of 1e-5 mm in an STL file.
SURFACE_MM = 1e-3
# Step of the grid of rays, which is finer on a mirror too small for `RAYS_PER_MIRROR` points at this step.
RAY_STEP_MM = 1.0
RAYS_PER_MIRROR = 200
# Upper limit of measured clearances.
MAX_GAP_MM = 10.0
# Number of pixels along an edge of a sub-image from which rays through the rim of the pupil are traced.
RIM_STEPS = 12


@dataclass(frozen=True)
class MirrorLight:
    """The light of one mirror: segments (2, n, 2, 3) from the mirror to the pupil, and to the working distance.

    The first `grid_count` segments pass through a grid on the mirror, the others through its edge.
    """

    rays: FloatArray
    grid_count: int

    @property
    def hulls(self) -> tuple[manifold3d.Manifold, manifold3d.Manifold]:
        """The light to the pupil and the light to the scene as convex solids."""
        return tuple(manifold3d.Manifold.hull_points(leg[self.grid_count :].reshape(-1, 3)) for leg in self.rays)


def light_of(layout: Layout, index: int, hardware: Hardware) -> MirrorLight:
    """Exact light from the centre of the pupil via the usable part of a mirror; empty if there is none."""
    mirror = layout.mirrors[index]
    points, grid_count = _grid(mirror, RAY_STEP_MM)
    if len(points) == 0:
        return MirrorLight(np.zeros((2, 0, 2, 3)), 0)
    points = _on_apparent(mirror, points)
    entries, exits, directions = traced(mirror, points[:, :2] / points[:, 2:])
    return MirrorLight(_segments(layout, hardware, entries, np.zeros_like(entries), exits, directions), grid_count)


def light_of_rim(layout: Layout, index: int, hardware: Hardware) -> FloatArray:
    """Segments (2, n, 2, 3) as in `light_of`, but from the full pupil, for unvignetted pixels."""
    mirror = layout.mirrors[index]
    pupil, rays = sampled_light(mirror, layout.camera.pupil, RIM_STEPS)
    entries, exits, directions = traced(mirror, rays, pupil)
    return _segments(layout, hardware, entries, pupil, exits, directions)


def _grid(mirror: Mirror, step_mm: float) -> tuple[FloatArray, int]:
    """Points (n, 2) on the apparent mirror, in its frame: first a grid, then the edge; and the number in the grid."""
    if len(mirror.usable_normalized) == 0:
        return np.zeros((0, 2)), 0
    apparent = mirror.apparent
    frame = apparent.rig_from_plane
    area = Polygon((apparent.intersect(mirror.usable_normalized) - frame[:3, 3]) @ frame[:3, :2])
    step = min(step_mm, float(np.sqrt(area.area / RAYS_PER_MIRROR)))
    left, bottom, right, top = area.bounds
    grid = np.stack(np.meshgrid(np.arange(left, right, step), np.arange(bottom, top, step)), axis=-1).reshape(-1, 2)
    grid = grid[contains_xy(area, grid[:, 0], grid[:, 1])]
    return np.concatenate([grid, get_coordinates(area.exterior.segmentize(step))]), len(grid)


def _on_apparent(mirror: Mirror, points: FloatArray) -> FloatArray:
    """Points (n, 3) in the rig frame from points (n, 2) in the frame of the apparent mirror."""
    frame = mirror.apparent.rig_from_plane
    return np.asarray(points @ frame[:3, :2].T + frame[:3, 3])


def _segments(
    layout: Layout,
    hardware: Hardware,
    entries: FloatArray,
    pupil: FloatArray,
    exits: FloatArray,
    directions: FloatArray,
) -> FloatArray:
    """Segments (2, n, 2, 3) from `SURFACE_MM` outside the mirror to points (n, 3) in the pupil, and to the scene."""
    forward = layout.view_from_rig[2]
    distance = (working_distance_mm(layout, hardware) - exits @ forward) / (directions @ forward)
    starts, ends = np.stack([entries, exits]), np.stack([pupil, exits + distance[:, None] * directions])
    units = (ends - starts) / np.linalg.norm(ends - starts, axis=-1, keepdims=True)
    return np.stack([starts + SURFACE_MM * units, ends], axis=-2)


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
        The camera's body. It contains the pupil, so only the light to the scene is cast against it.

    Returns
    -------
    dict of str to Metric
        Number of blocked rays; the gap between each part and the light, limited by the fit minus the tolerance of the
        meshes; the light that mirrors block for each other, with the limit for a layout as built.
    """
    lights = [light_of(layout, index, hardware) for index in range(len(layout.mirrors))]
    blockers = manifold3d.Manifold.compose(list(parts.values()))
    cast, blocked = _cast(lights, blockers, camera)
    min_rays = 2 * RAYS_PER_MIRROR * len(lights)
    return {
        "device.rays_cast": Metric(value=cast, unit="", limit=min_rays, lower_is_better=False),
        "device.rays_blocked": Metric(value=blocked, unit="", limit=0),
        "device.mirrors_without_light": Metric(value=sum(light.grid_count == 0 for light in lights), unit="", limit=0),
        "device.rim_light_stopped": Metric(
            value=_rim_light_stopped(layout, blockers, hardware), unit="of the light", limit=0.0
        ),
        "device.shade_of_sheets": Metric(
            value=shade_of_mirrors(lights, mirrors), unit="of the light", limit=MAX_HIDDEN
        ),
        **_light_gaps(lights, parts, hardware),
    }


def _cast(
    lights: Sequence[MirrorLight], parts: manifold3d.Manifold, camera: manifold3d.Manifold | None
) -> tuple[int, int]:
    """Number of rays cast, and number blocked by the parts or, between mirror and scene, by the camera."""
    rays = np.concatenate([light.rays.reshape(-1, 2, 3) for light in lights])
    blocked = hits(parts, rays)
    if camera is not None:
        blocked += hits(camera, np.concatenate([light.rays[1] for light in lights]))
    return len(rays), blocked


def _rim_light_stopped(layout: Layout, parts: manifold3d.Manifold, hardware: Hardware) -> float:
    """Largest fraction, over the mirrors, of the rays through the full pupil that the parts block."""
    rims = [light_of_rim(layout, index, hardware) for index in range(len(layout.mirrors))]
    return max((hits(parts, rim.reshape(-1, 2, 3)) / max(2 * rim.shape[1], 1) for rim in rims), default=0.0)


def _light_gaps(
    lights: Sequence[MirrorLight], parts: Mapping[str, manifold3d.Manifold], hardware: Hardware
) -> dict[str, Metric]:
    """Gap between each part and the light, limited by the fit minus the tolerance of the meshes."""
    hulls = [hull for light in lights if len(light.rays[0]) for hull in light.hulls]
    gaps = {name: min((part.min_gap(hull, MAX_GAP_MM) for hull in hulls), default=0.0) for name, part in parts.items()}
    min_gap = hardware.fit.light_mm - STL_TOLERANCE_MM
    return {
        f"{name}.light_gap_mm": Metric(value=round(gap, 4), unit="mm", limit=min_gap, lower_is_better=False)
        for name, gap in gaps.items()
    }


def shade_of_mirrors(lights: Sequence[MirrorLight], mirrors: Sequence[manifold3d.Manifold | None]) -> float:
    """Largest fraction of a mirror's light that the solids of other mirrors block: the cost of thick mirrors."""
    worst = 0.0
    for index, light in enumerate(lights):
        others = manifold3d.Manifold.compose([solid for other, solid in enumerate(mirrors) if solid and other != index])
        legs = light.rays[:, : light.grid_count]
        shaded = [any(others.ray_cast(*segment) for segment in pair) for pair in zip(*legs, strict=True)]
        worst = max(worst, float(np.mean(shaded)) if shaded else 0.0)
    return worst


# Length of viewing rays along the optical axis, beyond the device.
FAR_MM = 1000.0


def check_step_views(
    layout: Layout,
    items: Sequence[PurchasedItem],
    solids: Mapping[str, manifold3d.Manifold],
    steps: Sequence[Step] = STEPS,
) -> dict[str, Metric]:
    """Check that nothing blocks the camera's view in calibration pictures.

    Parameters
    ----------
    layout : Layout
        Camera and mirrors.
    items : sequence of PurchasedItem
        All purchased items of the device, in the order of their names.
    solids : mapping of str to Manifold
        The solids of the assembled device by name, in the rig frame, mm.
    steps : sequence of Step
        The steps of assembly.

    Returns
    -------
    dict of str to Metric
        For each step that takes pictures, named by their folder: the hidden fraction of the frame. Without mirrors, the
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
        names = connected_to_camera(steps, step, pieces, fastened)
        mirrors = {name for name in names if is_mirror(name)}
        others = manifold3d.Manifold.compose([solids[name] for name in sorted(names - mirrors) if name in solids])
        mirror_solids = {name: solids[name] for name in sorted(mirrors)}
        hidden = (
            _hidden_by_others(layout, rays, others, mirror_solids) if mirror_solids else _hidden_count(rays, others)
        )
        checks[f"device.{step.pictures}_pictures_hidden"] = Metric(
            value=round(hidden / len(rays), 4), unit="of the frame", limit=0.0
        )
    return checks


def _hidden_count(rays: FloatArray, solid: manifold3d.Manifold) -> int:
    """Number of viewing rays (n, 2), in normalized coordinates, that meet a solid."""
    return int(np.isfinite(_first_hit_mm(rays, solid)).sum())


def _hidden_by_others(
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
        obstacles = manifold3d.Manifold.compose([others, *(solid for solid in mirrors.values() if solid is not own)])
        depths = _first_hit_mm(usable, own)
        seen = np.isfinite(depths)
        ends = np.column_stack([usable[seen], np.ones(seen.sum())]) * depths[seen, None]
        count += int((~seen).sum()) + hits(obstacles, np.stack([np.zeros_like(ends), ends], axis=1))
    return count


def _first_hit_mm(rays: FloatArray, solid: manifold3d.Manifold) -> FloatArray:
    """z in mm (n,) of the first hits of normalized viewing rays (n, 2) on a solid; infinite for rays that miss."""
    depths = np.full(len(rays), np.inf)
    for index, ray in enumerate(rays):
        ray_hits = solid.ray_cast(np.zeros(3), np.array([*ray, 1.0]) * FAR_MM)
        if ray_hits:
            depths[index] = min(float(hit.position[2]) for hit in ray_hits)
    return depths


# Number of rays of a mirror towards the surroundings, and their length.
COSINE_RAYS = 400
SURROUNDINGS_MM = 400.0
# Distance in front of a mirror at which rays start.
START_MM = 0.5
GOLDEN_ANGLE = np.pi * (3.0 - np.sqrt(5.0))


def check_surrounding_light(layout: Layout, solids: Mapping[str, manifold3d.Manifold]) -> dict[str, Metric]:
    """The fraction of light from uniformly bright surroundings that reaches the centres of the mirrors.

    It is the cosine-weighted fraction of the mirrors' half-spaces that the device's solids (in the rig frame, mm) leave
    free; 1 for bare mirrors.
    """
    device = manifold3d.Manifold.compose(list(solids.values()))
    rays = np.concatenate([_cosine_rays(mirror) for mirror in layout.mirrors])
    fraction = 1.0 - hits(device, rays) / len(rays)
    return {"device.surroundings_on_mirrors": Metric(value=round(fraction, 4), unit="of the half-space")}


def _cosine_rays(mirror: Mirror) -> FloatArray:
    """Segments (n, 2, 3) in the rig frame from a mirror's centre, in cosine-weighted directions."""
    # Points on a spiral on the unit disc.
    index = np.arange(COSINE_RAYS) + 0.5
    radius, angle = np.sqrt(index / COSINE_RAYS), GOLDEN_ANGLE * index
    on_disc = np.column_stack([radius * np.cos(angle), radius * np.sin(angle)])
    directions = np.column_stack([on_disc, np.sqrt(np.maximum(1.0 - radius**2, 0.0))]) @ mirror.rig_from_plane[:3, :3].T
    start = mirror.outline_in_rig_mm.mean(axis=0) + (mirror.front_mm + START_MM) * mirror.normal_in_rig
    return np.stack([np.broadcast_to(start, directions.shape), start + SURROUNDINGS_MM * directions], axis=1)
