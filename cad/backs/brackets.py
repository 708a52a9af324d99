"""Bracket adapters, for arms with a flange normal to their axis, and for monitor stands.

The bracket has a vertical plate behind the mount's foot, a shelf and two ribs; it is printed with its rear face down.

Two are for arms whose axis is the view axis: ISO 9409-1-50-4-M6, and Kinova's Gen3. The Gen3 was measured in sections
of `bracelet_no_vision_link.STL` of ros2_kortex, kortex_description/arms/gen3/7dof/meshes, commit 1fdbef34 (Kinova inc.,
BSD-3-Clause). Its face, at `end_effector_link`, is 61.525 mm in front of the origin of the mesh's link. In the face are
four tap-drill holes of 4.2 mm at (+-27, +-16) mm and a hole of 4 mm at (30.5, 0) mm; a rim, with radii from 35.4 to
37.5 mm, protrudes by 2.9 mm.

The third is for monitor stands and arms (VESA MIS-D): four M4 nuts in the front of the bracket's plate.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from mirrorcam.cad.backs.back import (
    BACK_DOWN,
    RGB,
    SECOND_RGB,
    Back,
    BackPart,
    CriticalSection,
    Load,
    RobotLink,
    Support,
    link_at,
)
from mirrorcam.cad.backs.blocks import ALONG_X, ALONG_Y, BlocksPlan, Disc, faceted, ring
from mirrorcam.cad.parts.camera_box import ABOVE
from mirrorcam.cad.parts.truss import FOOT_DEPTH_MM, Foot, foot_stack
from mirrorcam.cad.plan.back_table import Gen3Back, Iso9409Back, VesaBack
from mirrorcam.cad.plan.dimension import length
from mirrorcam.cad.plan.fasteners import NUT_FIT_MM, OUTSIDE_MM, Bore, Hexagon, frame_along
from mirrorcam.cad.plan.hardware import Hardware
from mirrorcam.cad.plan.part_plan import Connection, PurchasedItem
from mirrorcam.cad.plan.prisms import box, prism_along_x
from mirrorcam.cad.plan.seats import Frustum
from mirrorcam.cad.plan.threads import thread_of
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.transforms import rigid

RIB_MM = 5.0


@dataclass(frozen=True)
class Bracket:
    """A bracket in the stand frame, mm: its plan, and the positions of the plate and of the foot's screws.

    `back_centre` (3,) is the centre of the plate's rear face, y = `front_mm` its front; the screws' heads are at
    `heads`.
    """

    plan: BlocksPlan
    back_centre: FloatArray
    front_mm: float
    heads: FloatArray
    critical_section: CriticalSection


def plan_bracket(
    name: str,
    below_mm: float,
    plate_mm: tuple[float, float, float],
    rib_x_mm: float,
    cuts: tuple[Frustum | Bore | Hexagon, ...],
    grip_mm: float,
    foot: Foot,
    hardware: Hardware,
    extra_dimensions: tuple[tuple[FloatArray, FloatArray], ...] = (),
) -> Bracket:
    """Lay out a bracket whose plate has its centre `below_mm` under the mount's foot.

    `plate_mm` holds the plate's half width, its extent below its centre, and its thickness. The ribs extend from
    `rib_x_mm` outwards on both sides. The origin of the plate's `cuts`, and of the ends (3,) of `extra_dimensions`,
    is the centre of its rear face. The shelf is `grip_mm` thick, with the screws' heads under it.
    """
    half, down, thickness = plate_mm
    foot_z, slide = foot.z_mm, foot.front_y_mm
    front = slide - FOOT_DEPTH_MM
    back, centre_z = front - thickness, foot_z - below_mm
    centre, outer_x = np.array([0.0, back, centre_z]), rib_x_mm + RIB_MM
    heads = foot.screws - grip_mm * ABOVE
    rib = np.array(
        [(front - 1.0, centre_z - down / 2.0), (front - 1.0, foot_z), (slide, foot_z), (slide, foot_z - grip_mm)]
    )
    rib = np.vstack([rib, [(front, centre_z - down / 2.0)]])
    pieces = [
        box((-half, back, centre_z - down), (half, front, foot_z)),
        box((-outer_x, back, foot_z - grip_mm), (outer_x, slide, foot_z)),
        *(prism_along_x(rib, low, low + RIB_MM) for low in (-outer_x, rib_x_mm)),
    ]
    clearance = hardware.screw.clearance_hole_mm / 2.0
    all_cuts = [_translated(cut, centre) for cut in cuts]
    all_cuts += [
        Bore(head - OUTSIDE_MM * ABOVE, ABOVE, clearance, grip_mm + 2.0 * OUTSIDE_MM, ALONG_Y) for head in heads
    ]
    shelf = np.array([-outer_x, slide, foot_z])
    lengths = [
        length(np.array([-half, back, foot_z]), np.array([-half, front, foot_z])),
        length(shelf, shelf - grip_mm * ABOVE),
        length(shelf, shelf + RIB_MM * ALONG_X),
        length(np.array([-outer_x, front, foot_z]), np.array([-outer_x, front, centre_z - down / 2.0])),
    ]
    if outer_x < half:
        lengths.append(length(shelf, shelf + 2.0 * outer_x * ALONG_X))
    # The section of the ribs alone, at the root of the shelf.
    height = below_mm + down / 2.0
    critical_section = CriticalSection(
        "ribs at the plate", np.array([0.0, front, foot_z - height / 2.0]), ALONG_Y, ABOVE, (height, 2.0 * RIB_MM)
    )
    lengths += [length(start + centre, end + centre) for start, end in extra_dimensions]
    return Bracket(
        BlocksPlan(name, tuple(pieces), tuple(all_cuts), tuple(lengths)), centre, front, heads, critical_section
    )


def plate_section(bracket: Bracket, width_mm: float, thickness_mm: float, height_mm: float) -> CriticalSection:
    """The section of the plate `height_mm` above its centre, above its screws."""
    centre = bracket.back_centre + np.array([0.0, thickness_mm / 2.0, height_mm])
    return CriticalSection("plate over its screws", centre, ABOVE, ALONG_X, (width_mm, thickness_mm))


def _translated(cut: Frustum | Bore | Hexagon, shift: FloatArray) -> Frustum | Bore | Hexagon:
    if isinstance(cut, Bore):
        return Bore(cut.mouth + shift, cut.axis, cut.radius_mm, cut.depth_mm, cut.up)
    if isinstance(cut, Hexagon):
        return Hexagon(cut.mouth + shift, cut.axis, cut.up, cut.flats_mm, cut.depth_mm)
    return Frustum(cut.base + shift, cut.top + shift)


BRACKET, CENTRING = Iso9409Back.parts
_, SPACER = Gen3Back.parts
# Clearance of the centring ring on each side in the plate and in the flange, for mounting by hand.
RING_GAP_MM = 0.2
RING_WALL_MM = 4.0
EXPLODE = np.array([0.0, -60.0, -45.0])
SECOND_EXPLODE = np.array([0.0, -110.0, -45.0])


def plan_iso9409(table: Iso9409Back, foot: Foot, load: Load, hardware: Hardware) -> Back:
    """Lay out the bracket for a flange ISO 9409-1-50-4-M6, and a ring that centres the bracket."""
    offset = table.circle_mm / 2.0 / np.sqrt(2.0)
    points = np.array([(x, z) for x in (-offset, offset) for z in (-offset, offset)])
    recess_radius, thickness = table.centre_mm / 2.0, table.plate_mm
    cuts = (
        *_holes(points, thread_of("M6").clearance_mm / 2.0, thickness),
        *_holes(np.zeros((1, 2)), recess_radius, thickness),
        *_holes(np.array([[table.circle_mm / 2.0, 0.0]]), table.pin_mm / 2.0 + hardware.fit.press_mm, thickness),
    )
    half = table.flange_mm / 2.0 + 2.0
    bracket = plan_bracket(
        BRACKET, table.below_mm, (half, half, thickness), half - 5.0, cuts, table.grip_mm, foot, hardware
    )
    face = bracket.back_centre
    radius, ring_depth = recess_radius - RING_GAP_MM, table.centre_deep_mm
    low = face - ring_depth * ALONG_Y
    hole = Bore(low - OUTSIDE_MM * ALONG_Y, ALONG_Y, radius - RING_WALL_MM, ring_depth + thickness + 2.0 * OUTSIDE_MM)
    centring = BlocksPlan(CENTRING, (), (hole,), discs=(Disc(low, radius, ring_depth + thickness),))
    flange = ring(face - 6.0 * ALONG_Y, (recess_radius, table.flange_mm / 2.0), 6.0)
    arm = faceted(Disc(face - 46.0 * ALONG_Y, table.arm_mm / 2.0, 40.0))
    back = _flange_back(table, bracket, centring, "Centring ring", points, "M6", hardware)
    return replace(
        back,
        fits=f"The arm must have a flange ISO 9409-1-50-4-M6: four M6 threads on a circle of {table.circle_mm:g} mm, "
        f"with a recess of {table.centre_mm:g} mm at its centre. Threads must be at least "
        f"{table.screw_mm - table.plate_mm:g} mm deep. The large screws hide the small ones: put the small ones in "
        "first.",
        steps=(
            f"Push the centring ring into the bracket, flush with its front. A pin of {table.pin_mm:g} mm (ISO 2338) "
            "in the hole beside it, if the flange has one, keeps the device from rotating; its position depends on "
            "the arm's manufacturer.",
            "Hold the ring into the flange's recess and turn in the M6 screws with a 5 mm hex key, crosswise.",
        ),
        supports=(Support("flange", (*flange, arm)),),
        robot=RobotLink(
            parent=table.link,
            xyz_mm=(0.0, 0.0, 0.0),
            rpy=(0.0, -np.pi / 2.0, 0.0),
            rig_from_link=link_at(face),
            arms="any with a flange ISO 9409-1-50-4-M6, such as UR3e, UR5e, UR10e and UR16e",
            attached="the views along its z, the device upright towards its -x. For one of the three other "
            "orientations in which it can be screwed on, rotate the origin about z",
        ),
    )


def plan_gen3(table: Gen3Back, foot: Foot, load: Load, hardware: Hardware) -> Back:
    """Lay out the bracket for a Kinova Gen3, and a spacer disc inside the rim round its face."""
    x, z = table.holes_mm
    points = np.array([(a, b) for a in (-x, x) for b in (-z, z)])
    thickness, (disc_radius, disc_thickness) = table.plate_mm, table.spacer_mm
    clearance = thread_of("M5").clearance_mm / 2.0
    half = x + 11.0
    cuts = _holes(points, clearance, thickness)
    bracket = plan_bracket(
        BRACKET, table.below_mm, (half, 36.0, thickness), half - 5.0, cuts, table.grip_mm, foot, hardware
    )
    face = bracket.back_centre - disc_thickness * ALONG_Y
    holes = (replace(hole, mouth=hole.mouth + face) for hole in _holes(points, clearance, disc_thickness))
    # Without space for a wall between a hole and the rim, each hole is a slot, open to the edge.
    slots = (_slot(point, clearance, disc_thickness, face) for point in points)
    spacer = BlocksPlan(SPACER, (), (*holes, *slots), discs=(Disc(face, disc_radius, disc_thickness),))
    inner, outer, rim_height = table.rim_mm
    module = faceted(Disc(face - 40.0 * ALONG_Y, outer, 40.0))
    back = _flange_back(table, bracket, spacer, "Spacer", points, "M5", hardware)
    return replace(
        back,
        fits="The positions of the holes were measured in the published mesh of the Kinova Gen3 with 6 or 7 joints. "
        "Their M5 threads are a guess from the core holes, so try one screw by hand first.",
        steps=(
            "Lay the spacer on the face of the arm's interface module, inside its rim, its four slots over the "
            "threads.",
            "Screw the bracket on with the M5 screws and a 4 mm hex key, crosswise, the device away from the vision "
            "module.",
        ),
        supports=(Support("arm", (*ring(face, (inner, outer), rim_height), module)),),
        # Away from the vision module, which is on the +y side of the link.
        robot=RobotLink(
            parent=table.link,
            xyz_mm=(0.0, 0.0, 0.0),
            rpy=(np.pi / 2.0, -np.pi / 2.0, 0.0),
            rig_from_link=link_at(face),
            arms="Kinova Gen3 with 6 or 7 joints",
            attached="the views along its z",
        ),
    )


def _flange_back(
    table: Iso9409Back | Gen3Back,
    bracket: Bracket,
    rear_part: BlocksPlan,
    title: str,
    points: FloatArray,
    size: str,
    hardware: Hardware,
) -> Back:
    """An adapter with a bracket, a part behind its plate, and screws of a size at points (n, 2; x and z) in its front.

    The caller adds the support.
    """
    centre, front, thickness = bracket.back_centre, bracket.front_mm, table.plate_mm
    heads = [np.array([x, front, centre[2] + z]) for x, z in points]
    screw_explode = EXPLODE + 40.0 * ALONG_Y
    width = float(np.ptp(bracket.plan.corners[:, 0]))
    joint = rigid(np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]), centre)
    return Back(
        table=table,
        parts=(
            BackPart(BRACKET, "Flange bracket", bracket.plan, BACK_DOWN, EXPLODE, RGB),
            BackPart(rear_part.name, title, rear_part, BACK_DOWN, SECOND_EXPLODE, SECOND_RGB),
        ),
        foot=foot_stack(hardware),
        foot_heads=bracket.heads,
        heading="screw the device to the arm",
        items=tuple(
            PurchasedItem("screw", size, table.screw_mm, frame_along(head, ALONG_Y), screw_explode, (BRACKET,))
            for head in heads
        ),
        connections=(Connection(rear_part.name.removeprefix("adapter_"), BRACKET, rear_part.name, joint, joint),),
        critical_sections=(
            bracket.critical_section,
            plate_section(bracket, width, thickness, float(points[:, 1].max()) + 5.0),
        ),
    )


def _slot(point: FloatArray, radius_mm: float, thickness_mm: float, face: FloatArray) -> Frustum:
    """The cut that opens a hole at a point (2,; x and z) outwards, in a disc whose face is centred on a point (3,)."""
    outward = point / np.linalg.norm(point)
    side = radius_mm * np.array([-outward[1], outward[0]])
    corners = np.array([point - side, point + side, point + side + 20.0 * outward, point - side + 20.0 * outward])
    base = face + np.column_stack([corners[:, 0], np.full(4, -1.0), corners[:, 1]])
    return Frustum(base, base + (thickness_mm + 2.0) * ALONG_Y)


def _holes(points: FloatArray, radius_mm: float, thickness_mm: float) -> tuple[Bore, ...]:
    """Holes along y through a plate, at points (n, 2; x and z) about the centre of its rear face."""
    return tuple(
        Bore(np.array([x, -OUTSIDE_MM, z]), ALONG_Y, radius_mm, thickness_mm + 2.0 * OUTSIDE_MM) for x, z in points
    )


(NAME,) = VesaBack.parts
# Distances of a screw from the plate's edge, of the upper screws from the shelf, and of the ribs from x = 0.
EDGE_MM, SHELF_GAP_MM, RIB_X_MM = 8.0, 14.0, 26.0


def plan_vesa(table: VesaBack, foot: Foot, load: Load, hardware: Hardware) -> Back:
    """Lay out the bracket for VESA, with a window in its plate."""
    m4, offset, thickness = thread_of("M4"), table.square_mm / 2.0, table.plate_mm
    points = [(x, z) for x in (-offset, offset) for z in (-offset, offset)]
    depth = m4.nut_height_mm + NUT_FIT_MM
    cuts: list[Frustum | Bore | Hexagon] = []
    for x, z in points:
        mouth = np.array([x, thickness + OUTSIDE_MM, z])
        cuts.append(Bore(mouth, -ALONG_Y, m4.clearance_mm / 2.0, thickness + 2.0 * OUTSIDE_MM))
        cuts.append(Hexagon(mouth, -ALONG_Y, None, m4.nut_flats_mm + NUT_FIT_MM, depth + OUTSIDE_MM))
    window, low, high = RIB_X_MM - 6.0, -offset + 4.0, offset - 12.0
    cuts.append(box((-window, -1.0, low), (window, thickness + 1.0, high)))
    corner, upper = np.array([-window, thickness, low]), np.array([-window, thickness, high])
    extra_dimensions = (
        (corner, corner + 2.0 * window * ALONG_X),
        (corner, upper),
        (upper, np.array([-window, thickness, offset + SHELF_GAP_MM])),
    )
    half = offset + EDGE_MM
    bracket = plan_bracket(
        NAME,
        offset + SHELF_GAP_MM,
        (half, half, thickness),
        RIB_X_MM,
        tuple(cuts),
        table.grip_mm,
        foot,
        hardware,
        extra_dimensions,
    )
    centre, items = bracket.back_centre, []
    for x, z in points:
        head = centre + np.array([x, -table.arm_mm, z])
        items.append(
            PurchasedItem("screw", "M4", table.screw_mm, frame_along(head, -ALONG_Y), EXPLODE - 30.0 * ALONG_Y, (NAME,))
        )
        frame, exit_mm = frame_along(centre + np.array([x, thickness - depth, z]), -ALONG_Y), 25.0 * ALONG_Y
        items.append(PurchasedItem("nut", "M4", m4.nut_height_mm, frame, EXPLODE + exit_mm, (NAME,), exit_mm[None]))
    arm = box(
        (-half, float(centre[1]) - table.arm_mm, float(centre[2]) - half),
        (half, float(centre[1]), float(centre[2]) + half),
    )
    return Back(
        table=table,
        parts=(BackPart(NAME, "VESA bracket", bracket.plan, BACK_DOWN, EXPLODE, RGB),),
        foot=foot_stack(hardware),
        foot_heads=bracket.heads,
        heading="screw the device to a VESA arm",
        fits=f"The arm's plate must have holes on a square of {table.square_mm:g} mm; for 100 mm, set `square_mm = "
        "100` under `[back]` in a hardware file and build again.",
        steps=(
            "Lay the M4 nuts into their pockets in the front of the bracket's plate.",
            "Put the M4 screws through the arm's plate from behind into the nuts. They must not protrude from the "
            "nuts by more than 2 mm.",
        ),
        items=tuple(items),
        supports=(Support("arm", (arm,)),),
        critical_sections=(bracket.critical_section, plate_section(bracket, 2.0 * half, thickness, offset + 5.0)),
    )
