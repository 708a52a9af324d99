"""The play of each mirror in its seat: how far it slides before a rim, or a mirror that is already in, stops it.

A slide in its own plane does not change what a mirror shows, only its edges in the picture; it must neither cover a
neighbour's light nor clash with it. So mirrors that rims hold go in first, and the others are centred between them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import manifold3d
import numpy as np

from mirrorcam.cad.assembly.build_steps import SeatOrder
from mirrorcam.cad.assembly.components import Component
from mirrorcam.cad.assembly.device_plan import Device
from mirrorcam.cad.checks.clashes import overlap_mm3
from mirrorcam.cad.checks.exported_mesh import is_manifold, solid_of
from mirrorcam.cad.plan.device_names import HOLDER
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror import Mirror

# Directions in which mirrors slide, and the distances at which an obstacle is sought.
DIRECTIONS = 16
SLIDES_MM = (0.5, 1.0, 1.5, 2.0, 3.0)
# Height over its pads at which a mirror slides.
LIFT_MM = 0.02


def seat_order(device: Device, components: Sequence[Component]) -> SeatOrder:
    """The order by repeatedly choosing the mirror with the least play, the outermost first among equals.

    Empty for mirrors on carriers, which have no rims. A mirror is loose if it slides by more than `SLIDES_MM[0]` beyond
    the clearance of its seat, past those that are already in; its play is at most `SLIDES_MM[-1]`.
    """
    if device.mirror_carriers:
        return SeatOrder()
    layout, free_mm = device.layout, device.hardware.fit.free_mm
    solids = {component.name: solid_of(component.mesh) for component in components}
    holder = manifold3d.Manifold.compose(
        [solid for name, solid in solids.items() if name.startswith(HOLDER) and is_manifold(solid)]
    )
    mirrors = {name: solids[f"mirror_{name}"] for name in layout.mirror_names}
    near = {name: holder ^ _surroundings(mirror) for name, mirror in mirrors.items()}
    radii = _radii(layout)
    placed: dict[str, manifold3d.Manifold] = {}
    loose = []
    while len(placed) < len(mirrors):
        plays = {
            name: play_mm(mirror, mirrors[name], [near[name], *placed.values()])
            for name, mirror in zip(layout.mirror_names, layout.mirrors, strict=True)
            if name not in placed
        }
        name = min(plays, key=lambda name: (plays[name], -radii[name]))
        placed[name] = mirrors[name]
        if plays[name] > free_mm + SLIDES_MM[0]:
            loose.append((name, plays[name]))
    return SeatOrder(tuple(placed), tuple(loose))


def _surroundings(mirror: manifold3d.Manifold) -> manifold3d.Manifold:
    """The box that a mirror stays in while it slides."""
    low, high = np.array(mirror.bounding_box()).reshape(2, 3) + np.array([[-1.0], [1.0]]) * (SLIDES_MM[-1] + 1.0)
    return manifold3d.Manifold.cube(tuple(high - low)).translate(tuple(low))


def play_mm(mirror: Mirror, solid: manifold3d.Manifold, obstacles: Sequence[manifold3d.Manifold]) -> float:
    """The largest of `SLIDES_MM` (0 if none) by which a mirror slides in its freest direction."""
    return float(max(slides_mm(mirror, solid, obstacles)))


def slides_mm(mirror: Mirror, solid: manifold3d.Manifold, obstacles: Sequence[manifold3d.Manifold]) -> FloatArray:
    """The largest of `SLIDES_MM` (0 if none) by which a mirror slides in each of `DIRECTIONS` (n,), from its x axis."""
    obstacle = manifold3d.Manifold.compose(list(obstacles))
    lifted = solid.translate(tuple(LIFT_MM * mirror.normal_in_rig))
    x, y = mirror.rig_from_plane[:3, 0], mirror.rig_from_plane[:3, 1]
    slides = []
    for angle in 2.0 * np.pi / DIRECTIONS * np.arange(DIRECTIONS):
        direction = np.cos(angle) * x + np.sin(angle) * y
        free = 0.0
        for distance in SLIDES_MM:
            if overlap_mm3(obstacle, lifted.translate(tuple(distance * direction))) > 0.0:
                break
            free = distance
        slides.append(free)
    return np.array(slides)


def _radii(layout: Layout) -> Mapping[str, float]:
    """Distance of each mirror's centre from the mean of all centres."""
    centres = np.array([mirror.outline_in_rig_mm.mean(axis=0) for mirror in layout.mirrors])
    distances = np.linalg.norm(centres - centres.mean(axis=0), axis=1)
    return dict(zip(layout.mirror_names, distances.tolist(), strict=True))
