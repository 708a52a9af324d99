"""Arms with a flange across their axis: a bracket whose plate lies on it, the views along the axis.

ISO 9409-1-50-4-M6, and Kinova's Gen3. The Gen3 is measured in sections of `bracelet_no_vision_link.STL` of ros2_kortex,
kortex_description/arms/gen3/7dof/meshes, commit 1fdbef34 (Kinova inc., BSD-3-Clause): the face lies 61.525 mm before
the link's origin, where `end_effector_link` is; four core holes of 4.2 mm at (+-27, +-16) mm, a hole of 4 mm at
(30.5, 0) mm, and a rim from 35.4 to 37.5 mm that stands out by 2.9 mm.
"""

from __future__ import annotations

import numpy as np

from mirrorcam.cad.backs.back import BACK_DOWN, Back, BackPart, Carrier, RobotLink
from mirrorcam.cad.backs.blocks import ALONG_Y, BlocksPlan, disc, ring
from mirrorcam.cad.backs.bracket import Bracket, plan_bracket, plate_neck
from mirrorcam.cad.backs.desk import RGB
from mirrorcam.cad.backs.load import Load
from mirrorcam.cad.parts.clip import ClipPlan
from mirrorcam.cad.parts.foot import foot_stack
from mirrorcam.cad.parts.mount import MountPlan
from mirrorcam.cad.plan.back_table import Gen3Back, Iso9409Back
from mirrorcam.cad.plan.connection import Connection
from mirrorcam.cad.plan.fasteners import OUTSIDE_MM, Bore
from mirrorcam.cad.plan.hardware import Hardware
from mirrorcam.cad.plan.item_frames import along
from mirrorcam.cad.plan.part_plan import BoughtItem
from mirrorcam.cad.plan.seats import Frustum
from mirrorcam.cad.plan.threads import thread_of
from mirrorcam.optics.base.values import FloatArray
from mirrorcam.optics.geometry.transforms import rigid

RING_RGB = (0.55, 0.74, 0.52)
# The centring ring is loose in the plate and in the flange by this much on each side, so that it goes in by hand.
LOOSE_MM = 0.2
RING_WALL_MM = 4.0
EXPLODE = np.array([0.0, -60.0, -45.0])
INNER = np.array([0.0, -110.0, -45.0])


def plan_iso9409(table: Iso9409Back, clip: ClipPlan, mount: MountPlan, load: Load, hardware: Hardware) -> Back:
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
        "adapter_flange", table.below_mm, (half, half, thick), half - 5.0, cuts, table.grip_mm, clip, hardware
    )
    face = bracket.middle
    radius, deep = centre - LOOSE_MM, table.centre_deep_mm
    low = face - deep * ALONG_Y
    hole = Bore(low - OUTSIDE_MM * ALONG_Y, ALONG_Y, radius - RING_WALL_MM, deep + thick + 2.0 * OUTSIDE_MM)
    centring = BlocksPlan("adapter_centring", (disc(low, radius, deep + thick),), (hole,))
    flange = ring(face - 6.0 * ALONG_Y, (centre, table.flange_mm / 2.0), 6.0)
    arm = disc(face - 46.0 * ALONG_Y, table.arm_mm / 2.0, 40.0)
    return Back(
        table=table,
        parts=(
            BackPart("adapter_flange", "Flange bracket", bracket.plan, BACK_DOWN, EXPLODE, RGB),
            BackPart("adapter_centring", "Centring ring", centring, BACK_DOWN, INNER, RING_RGB),
        ),
        foot=foot_stack(table.grip_mm, hardware),
        foot_heads=bracket.heads,
        items=_screws(bracket, spots, "M6", table.screw_mm, "adapter_flange"),
        connections=(_behind("centre", "adapter_flange", "adapter_centring", face),),
        carriers=(Carrier("flange", (*flange, arm)),),
        necks=(bracket.neck, plate_neck(bracket, 2.0 * half, thick, at + 5.0)),
        robot=RobotLink(
            parent=table.link,
            xyz_mm=(0.0, 0.0, 0.0),
            rpy=(0.0, -np.pi / 2.0, 0.0),
            origin_in_rig=face,
            arms="any with a flange ISO 9409-1-50-4-M6, such as UR3e, UR5e, UR10e and UR16e",
        ),
    )


def plan_gen3(table: Gen3Back, clip: ClipPlan, mount: MountPlan, load: Load, hardware: Hardware) -> Back:
    """Lay out the bracket of a Kinova Gen3, and a disc that bridges the rim round its face."""
    x, z = table.holes_mm
    spots = np.array([(a, b) for a in (-x, x) for b in (-z, z)])
    thick, (disc_radius, disc_thick) = table.plate_mm, table.spacer_mm
    clearance = thread_of("M5").clearance_mm / 2.0
    half = x + 11.0
    bracket = plan_bracket(
        "adapter_flange",
        table.below_mm,
        (half, 36.0, thick),
        half - 5.0,
        tuple(_holes(spots, clearance, thick)),
        table.grip_mm,
        clip,
        hardware,
    )
    face = bracket.middle - disc_thick * ALONG_Y
    holes = tuple(
        Bore(hole.mouth + face, hole.axis, hole.radius_mm, hole.depth_mm)
        for hole in _holes(spots, clearance, disc_thick)
    )
    # Between a hole and the rim there is no room for a wall: it is a slot, open to the edge.
    slots = tuple(_slot(spot, clearance, disc_thick, face) for spot in spots)
    spacer = BlocksPlan("adapter_spacer", (disc(face, disc_radius, disc_thick),), (*holes, *slots))
    inner, outer, high = table.rim_mm
    module = disc(face - 40.0 * ALONG_Y, outer, 40.0)
    return Back(
        table=table,
        parts=(
            BackPart("adapter_flange", "Flange bracket", bracket.plan, BACK_DOWN, EXPLODE, RGB),
            BackPart("adapter_spacer", "Spacer", spacer, BACK_DOWN, INNER, RING_RGB),
        ),
        foot=foot_stack(table.grip_mm, hardware),
        foot_heads=bracket.heads,
        items=_screws(bracket, spots, "M5", table.screw_mm, "adapter_flange"),
        connections=(_behind("spacer", "adapter_flange", "adapter_spacer", bracket.middle),),
        carriers=(Carrier("arm", (*ring(face, (inner, outer), high), module)),),
        necks=(bracket.neck, plate_neck(bracket, 2.0 * half, thick, z + 5.0)),
        # Away from the vision module, which is on the side of the link's y.
        robot=RobotLink(
            parent=table.link,
            xyz_mm=(0.0, 0.0, 0.0),
            rpy=(np.pi / 2.0, -np.pi / 2.0, 0.0),
            origin_in_rig=face,
            arms="Kinova Gen3 with 6 or 7 joints",
        ),
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


def _screws(bracket: Bracket, spots: FloatArray, size: str, length_mm: float, part: str) -> tuple[BoughtItem, ...]:
    """Screws with their heads on the front of a bracket's plate."""
    out = EXPLODE + 40.0 * ALONG_Y
    places = [np.array([x, bracket.front_mm, bracket.middle[2] + z]) for x, z in spots]
    return tuple(BoughtItem("screw", size, length_mm, along(place, ALONG_Y), out, (part,)) for place in places)


def _behind(name: str, parent: str, child: str, at: FloatArray) -> Connection:
    """The joint of a part behind a plate's back, at a point (3,)."""
    frame = rigid(np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]), at)
    return Connection(name, parent, child, frame, frame)
