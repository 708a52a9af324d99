"""Arms with a flange across their axis: a bracket whose plate lies on it, the views along the axis.

ISO 9409-1-50-4-M6, and Kinova's Gen3. The Gen3 is measured in sections of `bracelet_no_vision_link.STL` of ros2_kortex,
kortex_description/arms/gen3/7dof/meshes, commit 1fdbef34 (Kinova inc., BSD-3-Clause): the face lies 61.525 mm before
the link's origin, where `end_effector_link` is; four core holes of 4.2 mm at (+-27, +-16) mm, a hole of 4 mm at
(30.5, 0) mm, and a rim from 35.4 to 37.5 mm that stands out by 2.9 mm.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mirrorcam.cad.backs.back import BACK_DOWN, RGB, SECOND_RGB, Back, BackPart, Carrier, RobotLink
from mirrorcam.cad.backs.blocks import ALONG_Y, BlocksPlan, Disc, faceted, ring
from mirrorcam.cad.backs.bracket import Bracket, plan_bracket, plate_neck
from mirrorcam.cad.backs.load import Load
from mirrorcam.cad.parts.foot import foot_stack
from mirrorcam.cad.parts.mount import MountPlan
from mirrorcam.cad.plan.back_table import Gen3Back, Iso9409Back
from mirrorcam.cad.plan.fasteners import OUTSIDE_MM, Bore, along, thread_of
from mirrorcam.cad.plan.hardware import Hardware
from mirrorcam.cad.plan.part_plan import BoughtItem, Connection
from mirrorcam.cad.plan.seats import Frustum
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.transforms import rigid

BRACKET, CENTRING = Iso9409Back.parts
_, SPACER = Gen3Back.parts
# The centring ring is loose in the plate and in the flange by this much on each side, so that it goes in by hand.
LOOSE_MM = 0.2
RING_WALL_MM = 4.0
EXPLODE = np.array([0.0, -60.0, -45.0])
INNER = np.array([0.0, -110.0, -45.0])


def plan_iso9409(table: Iso9409Back, mount: MountPlan, load: Load, hardware: Hardware) -> Back:
    """Lay out the bracket of a flange ISO 9409-1-50-4-M6, and a ring that centres it."""
    at = table.circle_mm / 2.0 / np.sqrt(2.0)
    spots = np.array([(x, z) for x in (-at, at) for z in (-at, at)])
    centre, thick = table.centre_mm / 2.0, table.plate_mm
    cuts = (
        *_holes(spots, thread_of("M6").clearance_mm / 2.0, thick),
        *_holes(np.zeros((1, 2)), centre, thick),
        *_holes(np.array([[table.circle_mm / 2.0, 0.0]]), table.pin_mm / 2.0 + hardware.fit.press_mm, thick),
    )
    half = table.flange_mm / 2.0 + 2.0
    bracket = plan_bracket(
        BRACKET, table.below_mm, (half, half, thick), half - 5.0, cuts, table.grip_mm, mount, hardware
    )
    face = bracket.middle
    radius, deep = centre - LOOSE_MM, table.centre_deep_mm
    low = face - deep * ALONG_Y
    hole = Bore(low - OUTSIDE_MM * ALONG_Y, ALONG_Y, radius - RING_WALL_MM, deep + thick + 2.0 * OUTSIDE_MM)
    centring = BlocksPlan(CENTRING, (), (hole,), discs=(Disc(low, radius, deep + thick),))
    flange = ring(face - 6.0 * ALONG_Y, (centre, table.flange_mm / 2.0), 6.0)
    arm = faceted(Disc(face - 46.0 * ALONG_Y, table.arm_mm / 2.0, 40.0))
    back = _back_of(table, bracket, centring, "Centring ring", spots, "M6", hardware)
    return replace(
        back,
        carriers=(Carrier("flange", (*flange, arm)),),
        robot=RobotLink(
            parent=table.link,
            xyz_mm=(0.0, 0.0, 0.0),
            rpy=(0.0, -np.pi / 2.0, 0.0),
            origin_in_rig=face,
            arms="any with a flange ISO 9409-1-50-4-M6, such as UR3e, UR5e, UR10e and UR16e",
        ),
    )


def plan_gen3(table: Gen3Back, mount: MountPlan, load: Load, hardware: Hardware) -> Back:
    """Lay out the bracket of a Kinova Gen3, and a disc that bridges the rim round its face."""
    x, z = table.holes_mm
    spots = np.array([(a, b) for a in (-x, x) for b in (-z, z)])
    thick, (disc_radius, disc_thick) = table.plate_mm, table.spacer_mm
    clearance = thread_of("M5").clearance_mm / 2.0
    half = x + 11.0
    cuts = _holes(spots, clearance, thick)
    bracket = plan_bracket(
        BRACKET, table.below_mm, (half, 36.0, thick), half - 5.0, cuts, table.grip_mm, mount, hardware
    )
    face = bracket.middle - disc_thick * ALONG_Y
    holes = (replace(hole, mouth=hole.mouth + face) for hole in _holes(spots, clearance, disc_thick))
    # Between a hole and the rim there is no space for a wall: it is a slot, open to the edge.
    slots = (_slot(spot, clearance, disc_thick, face) for spot in spots)
    spacer = BlocksPlan(SPACER, (), (*holes, *slots), discs=(Disc(face, disc_radius, disc_thick),))
    inner, outer, high = table.rim_mm
    module = faceted(Disc(face - 40.0 * ALONG_Y, outer, 40.0))
    back = _back_of(table, bracket, spacer, "Spacer", spots, "M5", hardware)
    return replace(
        back,
        carriers=(Carrier("arm", (*ring(face, (inner, outer), high), module)),),
        # Away from the vision module, which is on the side of the link's y.
        robot=RobotLink(
            parent=table.link,
            xyz_mm=(0.0, 0.0, 0.0),
            rpy=(np.pi / 2.0, -np.pi / 2.0, 0.0),
            origin_in_rig=face,
            arms="Kinova Gen3 with 6 or 7 joints",
        ),
    )


def _back_of(
    table: Iso9409Back | Gen3Back,
    bracket: Bracket,
    behind: BlocksPlan,
    title: str,
    spots: FloatArray,
    size: str,
    hardware: Hardware,
) -> Back:
    """The back of a bracket with a part behind its plate, and screws of a size at spots (n, 2; x and z) in its front.

    What it is fastened to is not among it.
    """
    middle, front, thick = bracket.middle, bracket.front_mm, table.plate_mm
    places = [np.array([x, front, middle[2] + z]) for x, z in spots]
    out = EXPLODE + 40.0 * ALONG_Y
    width = float(np.ptp(bracket.plan.corners[:, 0]))
    joint = rigid(np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]), middle)
    return Back(
        table=table,
        parts=(
            BackPart(BRACKET, "Flange bracket", bracket.plan, BACK_DOWN, EXPLODE, RGB),
            BackPart(behind.name, title, behind, BACK_DOWN, INNER, SECOND_RGB),
        ),
        foot=foot_stack(table.grip_mm, hardware),
        foot_heads=bracket.heads,
        items=tuple(
            BoughtItem("screw", size, table.screw_mm, along(place, ALONG_Y), out, (BRACKET,)) for place in places
        ),
        connections=(Connection(behind.name.removeprefix("adapter_"), BRACKET, behind.name, joint, joint),),
        necks=(bracket.neck, plate_neck(bracket, width, thick, float(spots[:, 1].max()) + 5.0)),
    )


def _slot(spot: FloatArray, radius_mm: float, thick_mm: float, face: FloatArray) -> Frustum:
    """What opens a hole at a spot (2,; x and z) outwards, in a disc on a face about a point (3,)."""
    out = spot / np.linalg.norm(spot)
    side = radius_mm * np.array([-out[1], out[0]])
    corners = np.array([spot - side, spot + side, spot + side + 20.0 * out, spot - side + 20.0 * out])
    base = face + np.column_stack([corners[:, 0], np.full(4, -1.0), corners[:, 1]])
    return Frustum(base, base + (thick_mm + 2.0) * ALONG_Y)


def _holes(spots: FloatArray, radius_mm: float, thick_mm: float) -> tuple[Bore, ...]:
    """Holes along y through a plate, at spots (n, 2; x and z) about the middle of its back."""
    return tuple(Bore(np.array([x, -OUTSIDE_MM, z]), ALONG_Y, radius_mm, thick_mm + 2.0 * OUTSIDE_MM) for x, z in spots)
