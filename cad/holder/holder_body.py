"""The solids of a mirror holder as plain numbers, and its body: their union, cut by the light."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from manifold3d import Manifold

from mirrorcam.cad.holder.pads import PADS
from mirrorcam.cad.holder.planar_csg import PlanarCsg
from mirrorcam.cad.holder.stray_light import Baffle
from mirrorcam.cad.plan.cuts import Cuts
from mirrorcam.cad.plan.hardware import Fastening
from mirrorcam.cad.plan.seats import Frustum
from mirrorcam.cad.splitting import fragments
from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray

# Overlap of joined solids: faces that only touch may not join.
OVERLAP_MM = 0.5


@dataclass(frozen=True)
class HolderPlan:
    """The solids of a mirror holder, in the rig frame, mm.

    Material:

    - `slab`, with a `flange` round it;
    - `cores` behind the mirrors, whose fronts are the seats, in the order of `mirror_names`;
    - `pads` on the cores, three for each mirror in that order, with their tops in the plane of the mirror's back;
    - `fillers` in the gaps around and between the mirrors, slightly further back;
    - `rims`, each followed by its ground, the foot of the rim widened to the mirror's edge;
    - `walls` on the flange: the baffle against stray light.

    Cuts, which spare the pads: the `keep_outs` (each mirror's pocket, camera cone and reflected beam), the `grooves` of
    the seats and, for nuts, the `slots` through which they slide in.

    `rig_from_mount` (4, 4) is the frame of the flat back: origin in the centre of the mount holes, x along the rig's x,
    z out of the back. `holes_in_mount_mm` (4, 2) are in its plane, with threads at depths `thread_mm` (from, to) and
    the depth `hole_depth_mm`. `size_mm` is the part's size along x, y and z of that frame, `printed_mm3` its plastic
    before it is grooved and drilled, with infill. `cuts_mm` are the positions
    along its x and y at which the part is cut to fit the bed. `planned_cover` is, for every mirror, the fraction of its
    back that its seat covers, and `glue_mm3` the volume of the gap between them.
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
    slots: tuple[Frustum, ...]
    rig_from_mount: FloatArray
    holes_in_mount_mm: FloatArray
    thread_mm: tuple[float, float]
    hole_depth_mm: float
    size_mm: tuple[float, float, float]
    printed_mm3: float
    cuts_mm: Cuts
    planned_cover: tuple[float, ...]
    glue_mm3: tuple[float, ...]
    mirror_names: tuple[str, ...]
    screw: Fastening
    wall_mm: float

    @property
    def corners_in_rig(self) -> FloatArray:
        """Corners (n, 3) of all material before the light is cut out; the part lies inside their hull."""
        solids = (self.slab, self.flange, *self.cores, *self.pads, *self.fillers, *self.rims)
        walls = (self.walls.outer_foot, self.walls.inner_foot, self.walls.outer_crest, self.walls.inner_crest)
        return np.vstack([*(np.vstack([solid.base, solid.top]) for solid in solids), *walls])

    @property
    def screws_mm3(self) -> float:
        """Volume of the shanks of the screws that hold the mirrors."""
        return 0.0

    @property
    def pads_of_mirrors(self) -> tuple[tuple[Frustum, ...], ...]:
        """The pads by mirror, in the order of `mirror_names`."""
        return tuple(self.pads[start : start + PADS] for start in range(0, len(self.pads), PADS))

    @property
    def slot_directions(self) -> FloatArray:
        """The directions (n, 3) in the rig frame of the slots for nuts, in the order of the holes; none for inserts."""
        directions = np.array([slot.top[0] - slot.base[0] for slot in self.slots]).reshape(-1, 3)
        return directions / np.linalg.norm(directions, axis=1, keepdims=True)

    @property
    def cuts_on_bed_mm(self) -> Cuts:
        """The cuts along x and y of the bed; y is reversed, since the part lies with its back down."""
        return self.cuts_mm[0], tuple(-cut for cut in reversed(self.cuts_mm[1]))


def body_of(csg: PlanarCsg, plan: HolderPlan) -> Manifold:
    """The holder without grooves and holes: all material outside the light."""
    normal = plan.rig_from_mount[:3, 2]
    down, up, zero = OVERLAP_MM * normal, -OVERLAP_MM * normal, np.zeros(3)
    body = csg.joined(
        [
            plan.slab.stretched(down, zero),
            plan.flange.stretched(down, zero),
            # A core extends into its mirror's pocket, whose floor is the seat.
            *(core.stretched(down, up) for core in plan.cores),
            *(filler.stretched(down, zero) for filler in plan.fillers),
            *plan.rims[::2],
            *(ground.stretched(down, zero) for ground in plan.rims[1::2]),
            plan.walls,
        ]
    )
    far = 10.0 * max(float(np.ptp(plan.slab.base, axis=0).max()), 1.0)
    square = np.array([[-far, -far, 0.0], [far, -far, 0.0], [far, far, 0.0], [-far, far, 0.0]])
    rotation, origin = plan.rig_from_mount[:3, :3], plan.rig_from_mount[:3, 3]
    behind = Frustum(square @ rotation.T + origin, (square + np.array([0.0, 0.0, far])) @ rotation.T + origin)
    body = csg.cut(body, [behind, *(volume for group in plan.keep_outs for volume in group)])
    return body + csg.joined(plan.pads) if plan.pads else body


def one_piece(body: Manifold, crumb_mm: float) -> Manifold:
    """The body without fragments too small to print; raises InputError if it is not connected."""
    pieces = fragments(body, crumb_mm)
    if len(pieces) != 1:
        raise InputError(f"mirror holder falls apart into {len(pieces)} pieces where the light passes, expected one")
    return pieces[0]
