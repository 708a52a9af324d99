"""The registry of adapters: the planner of each table of dimensions, and the maker of each plan's solid."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from build123d import BuildPart, BuildSketch, Circle, Locations, Mode, Part, Plane, Rectangle, Solid, extrude, insert
from OCP.BRepBuilderAPI import BRepBuilderAPI_Transform

from mirrorcam.cad.backs.back import Back, RotatedPlan, carried_load, in_rig
from mirrorcam.cad.backs.blocks import ALONG_Y, BlocksPlan
from mirrorcam.cad.backs.brackets import plan_gen3, plan_iso9409, plan_vesa
from mirrorcam.cad.backs.kinova_gen2 import RingPlan, plan_gen2
from mirrorcam.cad.backs.monitor import plan_monitor
from mirrorcam.cad.backs.own_back import OwnPlan, make_own, plan_own
from mirrorcam.cad.backs.plates import plan_arca, plan_desk, plan_profile, plan_tripod
from mirrorcam.cad.holder.holder_solid import solid_of
from mirrorcam.cad.parts.clip import ClipPlan
from mirrorcam.cad.parts.mount import MountPlan
from mirrorcam.cad.parts.part_solids import cut_solid, one_solid
from mirrorcam.cad.plan.back_table import FileBack
from mirrorcam.cad.plan.hardware import Hardware
from mirrorcam.cad.plan.part_plan import recipe
from mirrorcam.cad.plan.seats import Frustum


@recipe("cad.parts.solids.make_ring")
def make_ring(plan: RingPlan) -> Part:
    """Half of the clamp round the wrist."""
    side = 1.0 if plan.above else -1.0
    # Viewed along +y, with x to the left and z up.
    plane = Plane(origin=(0.0, plan.band_mm[0], plan.axis_z_mm), x_dir=(-1.0, 0.0, 0.0), z_dir=(0.0, 1.0, 0.0))
    outer, far = plan.radius_mm + plan.ring_mm, 2.0 * (plan.radius_mm + plan.ring_mm)
    with BuildPart() as part:
        insert([solid_of(piece) for piece in plan.pieces])
        # Cut to half the thickness of the ring, which is added afterwards, so that no two round faces coincide.
        with BuildSketch(plane.offset(-far)):
            Circle(plan.radius_mm + plan.ring_mm / 2.0)
        extrude(amount=2.0 * far, mode=Mode.SUBTRACT)
        with BuildSketch(plane):
            Circle(outer)
            Circle(plan.radius_mm, mode=Mode.SUBTRACT)
            with Locations((0.0, -side * (far - plan.gap_mm) / 2.0)):
                Rectangle(2.0 * far, far, mode=Mode.SUBTRACT)
        extrude(amount=plan.band_mm[1] - plan.band_mm[0])
        insert([cut_solid(cut) for cut in plan.cuts], mode=Mode.SUBTRACT)
    return one_solid(plan.name, part)


@recipe("cad.backs.back_solids.make_blocks")
def make_blocks(plan: BlocksPlan) -> Part:
    """A part of an adapter, from blocks, discs and holes."""
    with BuildPart() as part:
        insert([solid_of(piece) for piece in plan.pieces])
        for disc in plan.discs:
            insert(
                Solid.make_cylinder(
                    disc.radius_mm, disc.thickness_mm, Plane(tuple(disc.face_centre), z_dir=tuple(ALONG_Y))
                )
            )
        insert([cut_solid(cut) for cut in plan.cuts], mode=Mode.SUBTRACT)
    return one_solid(plan.name, part)


MAKERS: dict[type, Callable[[Any], Part]] = {RingPlan: make_ring, BlocksPlan: make_blocks, OwnPlan: make_own}
"""The function that makes a solid from each type of plan."""


@recipe("cad.backs.plan_backs.make_adapter")
def make_adapter(plan: RotatedPlan) -> Part:
    """A part of an adapter in the rig frame."""
    part = MAKERS[type(plan.plan)](plan.plan)
    x_axis, _, z_axis = (tuple(axis) for axis in plan.rig_from_stand.T)
    location = Plane(origin=(0.0, 0.0, 0.0), x_dir=x_axis, z_dir=z_axis).location
    # Baked into the geometry, as in other parts: a location would make the STEP file an assembly of one part.
    return Part(BRepBuilderAPI_Transform(part.wrapped, location.wrapped.Transformation(), theCopyGeom=True).Shape())


PLANNERS: dict[str, Any] = {
    "none": plan_desk,
    "tripod": plan_tripod,
    "arca": plan_arca,
    "iso9409": plan_iso9409,
    "gen3": plan_gen3,
    "gen2": plan_gen2,
    "profile20": plan_profile,
    "vesa": plan_vesa,
    "monitor": plan_monitor,
}


def plan_back(clip: ClipPlan, mount: MountPlan, hardware: Hardware, light: tuple[Frustum, ...] = ()) -> Back:
    """Plan the hardware's adapter under a mount, for the load that it carries, in the rig frame.

    `light` are the volumes in the rig frame that a back of your own may not enter. Raises InputError with the dimension
    if it cannot be made.
    """
    table, foot, load = hardware.back, mount.foot, carried_load(mount, clip, hardware)
    if isinstance(table, FileBack):
        back = plan_own(table, foot, load, light, hardware)
    else:
        back = PLANNERS[table.kind](table, foot, load, hardware)
    return in_rig(back, foot.rig_from_stand)
