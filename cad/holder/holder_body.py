"""The solids of a mirror holder as plain numbers, and its body: these joined, and cut by the light."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from manifold3d import Manifold

from mirrorcam.cad.holder.pads import PADS
from mirrorcam.cad.holder.planar_csg import PlanarCsg
from mirrorcam.cad.holder.stray_light import Baffle
from mirrorcam.cad.holder.webs import Hollow
from mirrorcam.cad.plan.cuts import Cuts
from mirrorcam.cad.plan.hardware import Fastening
from mirrorcam.cad.plan.seats import Frustum
from mirrorcam.cad.splitting import fragments
from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray

# Solids that are joined reach into each other by this much: faces that only touch need not join.
OVERLAP_MM = 0.5


@dataclass(frozen=True)
class HolderPlan:
    """The solids of a mirror holder, in rig, mm.

    Material: `slab`, a `flange` round it, `cores` (right behind a mirror, their fronts the seats, in the order of
    `mirror_names`), the `pads` on them (three for each mirror, in that order, their tops in the plane of its back),
    `fillers` (in the gaps around and between the mirrors, a little further back), `rims` (each with the ground it
    stands on after it) and, on the flange, `walls`: the baffle against stray light. Cut out of all of it but the pads
    are the `keep_outs` (each mirror's pocket, camera cone and reflected beam), the `grooves` of the seats, the
    `hollows` and, for nuts, the `slots` that they are put in by.

    `rig_from_mount` (4, 4) is the frame of the flat back: origin in the middle of the mount holes, x along the rig's x,
    z out of the back. `holes_in_mount_mm` (4, 2) are on it; the thread of insert or nut lies `thread_mm` (from, to)
    deep, and a screw may reach `hole_depth_mm`. `size_mm` is the part's along x, y and z of that frame; `cuts_mm` are
    the positions along its x and y at which the part is cut to fit the bed. `planned_cover` is the share of every
    mirror's back that its seat faces at the distance of the glue, and `glue_mm3` the volume of the gap between them.
    """

    slab: Frustum
    flange: Frustum
    cores: tuple[Frustum, ...]
    pads: tuple[Frustum, ...]
    fillers: tuple[Frustum, ...]
    rims: tuple[Frustum, ...]
    walls: Baffle
    keep_outs: tuple[tuple[Frustum, ...], ...]
    grooves: tuple[Frustum, ...]
    hollows: tuple[Hollow, ...]
    slots: tuple[Frustum, ...]
    rig_from_mount: FloatArray
    holes_in_mount_mm: FloatArray
    thread_mm: tuple[float, float]
    hole_depth_mm: float
    size_mm: tuple[float, float, float]
    cuts_mm: Cuts
    planned_cover: tuple[float, ...]
    glue_mm3: tuple[float, ...]
    mirror_names: tuple[str, ...]
    screw: Fastening
    wall_mm: float

    @property
    def corners_in_rig(self) -> FloatArray:
        """Corners (n, 3) of all the material, before light is taken away: the part lies inside their hull."""
        solids = (self.slab, self.flange, *self.cores, *self.pads, *self.fillers, *self.rims)
        walls = (self.walls.outer_foot, self.walls.inner_foot, self.walls.outer_crest, self.walls.inner_crest)
        return np.vstack([*(np.vstack([solid.base, solid.top]) for solid in solids), *walls])

    @property
    def bulk(self) -> tuple[Frustum, ...]:
        """What most of its mass is in, with all that it carries but the mirrors."""
        return (self.slab, *self.cores)

    @property
    def pads_of_mirrors(self) -> tuple[tuple[Frustum, ...], ...]:
        """The pads by mirror, in the order of `mirror_names`."""
        return tuple(self.pads[start : start + PADS] for start in range(0, len(self.pads), PADS))

    @property
    def slot_ways(self) -> FloatArray:
        """The directions (n, 3) in rig of the slots for nuts, in the order of the holes; none for inserts."""
        ways = np.array([slot.top[0] - slot.base[0] for slot in self.slots]).reshape(-1, 3)
        return ways / np.linalg.norm(ways, axis=1, keepdims=True)

    @property
    def cuts_on_bed_mm(self) -> Cuts:
        """The cuts along x and y of the bed, on which the part lies by its back: y is the mount's, turned round."""
        return self.cuts_mm[0], tuple(-cut for cut in reversed(self.cuts_mm[1]))


def body_of(csg: PlanarCsg, plan: HolderPlan) -> Manifold:
    """The holder without hollows, grooves and holes: all material that is in no light."""
    away = plan.rig_from_mount[:3, 2]
    down, up, still = OVERLAP_MM * away, -OVERLAP_MM * away, np.zeros(3)
    body = csg.joined(
        [
            plan.slab.stretched(down, still),
            plan.flange.stretched(down, still),
            # A core reaches into its pocket, whose floor is the seat.
            *(core.stretched(down, up) for core in plan.cores),
            *(filler.stretched(down, still) for filler in plan.fillers),
            *plan.rims[::2],
            *(ground.stretched(down, still) for ground in plan.rims[1::2]),
            plan.walls,
        ]
    )
    far = 10.0 * max(float(np.ptp(plan.slab.base, axis=0).max()), 1.0)
    square = np.array([[-far, -far, 0.0], [far, -far, 0.0], [far, far, 0.0], [-far, far, 0.0]])
    turn, origin = plan.rig_from_mount[:3, :3], plan.rig_from_mount[:3, 3]
    under = Frustum(square @ turn.T + origin, (square + np.array([0.0, 0.0, far])) @ turn.T + origin)
    body = csg.cut(body, [under, *(volume for group in plan.keep_outs for volume in group)])
    return body + csg.joined(plan.pads) if plan.pads else body


def one_piece(body: Manifold, crumb_mm: float) -> Manifold:
    """The body, without fragments where seats meet that are too small to print; InputError where it falls apart."""
    pieces = fragments(body, crumb_mm)
    if len(pieces) != 1:
        raise InputError(f"mirror holder falls apart into {len(pieces)} pieces where the light passes, expected one")
    return pieces[0]
