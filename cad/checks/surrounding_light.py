"""How much of the light round the device falls on its mirrors: what a hood shades, and dust falls with it."""

from __future__ import annotations

from collections.abc import Mapping

import manifold3d
import numpy as np

from mirrorcam.cad.checks.exported_mesh import hits
from mirrorcam.core.values import FloatArray, Metric
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror import Mirror

RAYS = 400
FAR_MM = 400.0
# Rays begin so far before a mirror.
BEFORE_MM = 0.5
GOLDEN = np.pi * (3.0 - np.sqrt(5.0))


def check_surrounding_light(layout: Layout, solids: Mapping[str, manifold3d.Manifold]) -> dict[str, Metric]:
    """The share of surroundings, equally bright on all sides, whose light reaches the middles of the mirrors.

    Of each mirror's half-space, by rays that are as dense as they illuminate it (cosine), past the solids of the device
    in rig, mm: 1 for bare mirrors.
    """
    together = manifold3d.Manifold.compose(list(solids.values()))
    rays = np.concatenate([_rays(mirror) for mirror in layout.mirrors])
    share = 1.0 - hits(together, rays) / len(rays)
    return {"device.surroundings_on_mirrors": Metric(value=round(share, 4), unit="of the half-space")}


def _rays(mirror: Mirror) -> FloatArray:
    """Segments (n, 2, 3) in rig from the middle of a mirror, spread evenly over the disc below their directions."""
    place = np.arange(RAYS) + 0.5
    radius, turn = np.sqrt(place / RAYS), GOLDEN * place
    flat = np.column_stack([radius * np.cos(turn), radius * np.sin(turn)])
    directions = np.column_stack([flat, np.sqrt(np.maximum(1.0 - radius**2, 0.0))]) @ mirror.rig_from_plane[:3, :3].T
    start = mirror.outline_in_rig_mm.mean(axis=0) + (mirror.front_mm + BEFORE_MM) * mirror.normal_in_rig
    return np.stack([np.broadcast_to(start, directions.shape), start + FAR_MM * directions], axis=1)
