"""What the camera sees when calibration pictures are taken: rays from the pupil against the pieces built so far.

The pictures of the bare camera need a free view; those through the mirrors, every mirror's part of the frame.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import manifold3d
import numpy as np
from shapely import Polygon, contains_xy

from mirrorcam.cad.assembly.build_steps import STEPS, Step, with_camera
from mirrorcam.cad.assembly.pieces import item_names
from mirrorcam.cad.checks.clashes import is_mirror
from mirrorcam.cad.holder.stray_light import viewing_rays
from mirrorcam.cad.plan.part_plan import BoughtItem
from mirrorcam.core.values import FloatArray, Metric
from mirrorcam.optics.geometry.layout import Layout

# Rays end here: beyond the device.
FAR_MM = 1000.0


def check_step_views(
    layout: Layout,
    items: Sequence[BoughtItem],
    solids: Mapping[str, manifold3d.Manifold],
    steps: Sequence[Step] = STEPS,
) -> dict[str, Metric]:
    """Check that nothing hides what calibration pictures must show.

    Parameters
    ----------
    layout : Layout
        Camera and mirrors.
    items : sequence of BoughtItem
        All bought items of the device, in the order of their names.
    solids : mapping of str to Manifold
        The solids of the assembled device by name, in rig, mm.
    steps : sequence of Step
        How it is put together.

    Returns
    -------
    dict of str to Metric
        For each step that takes pictures, named by their folder: the share of the frame that is hidden. Without mirrors
        before the camera all of the frame counts, with them the usable parts of their sub-images, and each mirror's
        share of the frame is hidden where another piece is met before that mirror.
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
    return int(np.isfinite(_met_at(rays, solid)).sum())


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
        at_own = _met_at(usable, own)
        count += int((~np.isfinite(at_own) | (_met_at(usable, rest) < at_own)).sum())
    return count


def _met_at(rays: FloatArray, solid: manifold3d.Manifold) -> FloatArray:
    """Where viewing rays (n, 2), normalized, from the pupil first meet a solid, as z in mm (n,); infinite where not."""
    met = np.full(len(rays), np.inf)
    for index, ray in enumerate(rays):
        hits = solid.ray_cast(np.zeros(3), np.array([*ray, 1.0]) * FAR_MM)
        if hits:
            met[index] = min(float(hit.position[2]) for hit in hits)
    return met
