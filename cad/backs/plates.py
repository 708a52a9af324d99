"""Adapters of one plate under the mount's foot: for a desk, a tripod, an Arca-Swiss clamp or a profile.

- Desk and tripod: a plate with a nut for a tripod's screw; for a desk it is larger, so that the device stands.
- Arca-Swiss: a dovetail across the device, which prints standing on its end.
- Aluminium profile of 20 mm: a plate over its slot, with a T-nut on each side of the mount.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from mirrorcam.cad.backs.back import (
    RGB,
    SIDE_DOWN,
    UPRIGHT,
    Back,
    BackPart,
    CriticalSection,
    Load,
    Stand,
    Support,
    in_sentence,
)
from mirrorcam.cad.backs.blocks import (
    ALONG_X,
    ALONG_Y,
    BlocksPlan,
    countersunk_hole,
    head_cuts,
    tripod_cuts,
    tripod_depth_mm,
    tripod_nut,
)
from mirrorcam.cad.parts.camera_box import ABOVE
from mirrorcam.cad.parts.truss import Foot, foot_stack
from mirrorcam.cad.plan.back_table import ArcaBack, DeskBack, ProfileBack, TripodBack
from mirrorcam.cad.plan.dimension import Length, length
from mirrorcam.cad.plan.fasteners import OUTSIDE_MM, Bore, frame_along
from mirrorcam.cad.plan.hardware import Hardware
from mirrorcam.cad.plan.part_plan import PurchasedItem
from mirrorcam.cad.plan.prisms import box, prism_along_x
from mirrorcam.cad.plan.seats import Frustum
from mirrorcam.cad.plan.threads import COUNTERSUNK, thread_of
from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray

REAR_MM = 2.0
"""Extent of a plate behind the mount: the wall of the nut's pocket."""

EXPLODE = np.array([0.0, 0.0, -45.0])


@dataclass(frozen=True)
class FootPlate:
    """The position of a plate under the mount's foot, in the stand frame, mm.

    Its lower face is at `low_z_mm`, and the heads of its screws are at points (4, 3). `nut_mouth` (3,) is the centre of
    the nut's pocket in the upper face: between the rear screws, where the mount's foot covers the nut.
    """

    low_z_mm: float
    thickness_mm: float
    heads: FloatArray
    nut_mouth: FloatArray


def foot_plate(table: DeskBack | TripodBack, foot: Foot, hardware: Hardware) -> FootPlate:
    """A plate thick enough for the nut and for the countersunk heads of the foot's screws."""
    foot_z = foot.z_mm
    thickness = max(tripod_depth_mm(table.nut), table.grip_mm + hardware.fit.free_mm)
    heads = foot.screws - table.grip_mm * ABOVE
    return FootPlate(foot_z - thickness, thickness, heads, np.array([0.0, float(heads[:, 1].min()), foot_z]))


def back_of_plate(
    table: DeskBack | TripodBack,
    name: str,
    title: str,
    plate: FootPlate,
    outline: FloatArray,
    hardware: Hardware,
    lengths: tuple[Length, ...] = (),
) -> Back:
    """An adapter of one plate with an outline (n, 2; x and y); the caller adds critical sections, stand or support."""
    base = np.column_stack([outline, np.full(len(outline), plate.low_z_mm)])
    sink = plate.thickness_mm - table.grip_mm
    cuts = (
        *(cut for head in plate.heads for cut in countersunk_hole(head, table.grip_mm, sink, hardware.screw.thread)),
        *tripod_cuts(plate.nut_mouth, plate.thickness_mm, table.nut),
    )
    plan = BlocksPlan(name, (Frustum(base, base + plate.thickness_mm * ABOVE),), cuts, lengths)
    return Back(
        table=table,
        parts=(BackPart(name, title, plan, UPRIGHT, EXPLODE, RGB),),
        foot=foot_stack(hardware),
        foot_heads=plate.heads,
        heading=f"screw on the {in_sentence(title)}",
        foot_form=COUNTERSUNK,
        items=(tripod_nut(plate.nut_mouth, plate.thickness_mm, table.nut, name, EXPLODE),),
    )


(DESK,) = DeskBack.parts


def plan_desk(table: DeskBack, foot: Foot, load: Load, hardware: Hardware) -> Back:
    """Lay out a plate on which the device does not fall over at a tilt of `tip_deg` + `spare_deg`."""
    plate = foot_plate(table, foot, hardware)
    outline = _outline(table, foot, load, plate.low_z_mm)
    left, back = outline.min(axis=0)
    corner = np.array([left, back, plate.low_z_mm])
    chamfer = length(corner, corner + table.corner_mm * ALONG_X, "x 45°", before=f"{len(outline) // 2}x ")
    return replace(
        back_of_plate(table, DESK, "Desk foot", plate, outline, hardware, (chamfer,)),
        critical_sections=_edge_sections(foot, outline, plate),
        stand=Stand(outline, plate.low_z_mm, table.tip_deg),
    )


def _edge_sections(foot: Foot, outline: FloatArray, plate: FootPlate) -> tuple[CriticalSection, ...]:
    """The plate's sections at the front and the rear of the mount, which bend when the device leans on those edges."""
    width, z = float(np.ptp(outline[:, 0])), plate.low_z_mm + plate.thickness_mm / 2.0
    low, high = float(outline[:, 1].min()), float(outline[:, 1].max())
    edges = (("before", foot.front_y_mm, high - foot.front_y_mm), ("behind", foot.back_y_mm, foot.back_y_mm - low))
    return tuple(
        CriticalSection(
            f"plate {place} the mount", np.array([0.0, y, z]), ALONG_Y, ALONG_X, (width, plate.thickness_mm), arm
        )
        for place, y, arm in edges
    )


def _outline(table: DeskBack, foot: Foot, load: Load, low_z: float) -> FloatArray:
    """The plate's outline (n, 2; x and y): under all of the mount's foot, and round the load for the required tilt."""
    margin = float((load.centre[2] - low_z) * np.tan(np.radians(table.tip_deg + table.spare_deg)))
    # No chamfer is nearer to the load than the sides.
    chamfer = table.corner_mm
    half = max(foot.half_width_mm, abs(float(load.centre[0])) + margin)
    back = min(foot.back_y_mm - REAR_MM, float(load.centre[1]) - margin)
    front = max(foot.edge_y_mm, float(load.centre[1]) + margin)
    corners = []
    for (x, y), reverse in (((half, front), 0), ((-half, front), 1), ((-half, back), 0), ((half, back), 1)):
        ends = [(x, y - np.sign(y - (front + back) / 2.0) * chamfer), (x - np.sign(x) * chamfer, y)]
        corners += ends[::-1] if reverse else ends
    return np.array(corners)


(TRIPOD,) = TripodBack.parts
# Side and height of the space for the tripod's head: a common ball head.
HEAD_MM = (50.0, 20.0)
# Extent of the plate in front of the mount: the wall of the countersinks.
FRONT_MM = 1.0


def plan_tripod(table: TripodBack, foot: Foot, load: Load, hardware: Hardware) -> Back:
    """Lay out a plate under all of the mount's foot."""
    plate = foot_plate(table, foot, hardware)
    half, front = foot.half_width_mm, foot.front_y_mm + FRONT_MM
    back = foot.back_y_mm - REAR_MM
    outline = np.array([(half, back), (half, front), (-half, front), (-half, back)])
    low_z, y = plate.low_z_mm, float(plate.nut_mouth[1])
    side, height = HEAD_MM[0] / 2.0, HEAD_MM[1]
    head = box((-side, y - side, low_z - height), (side, y + side, low_z))
    # A force over the edge of the tripod's head bends the plate at the nut's pocket.
    section = CriticalSection(
        "plate beside the nut",
        np.array([0.0, y, low_z + plate.thickness_mm / 2.0]),
        ALONG_Y,
        ALONG_X,
        (2.0 * half - table.nut.pocket_mm, plate.thickness_mm),
        front - back,
    )
    return replace(
        back_of_plate(table, TRIPOD, "Tripod plate", plate, outline, hardware),
        supports=(Support("tripod", (head,)),),
        critical_sections=(section,),
    )


(DOVETAIL,) = ArcaBack.parts


def plan_arca(table: ArcaBack, foot: Foot, load: Load, hardware: Hardware) -> Back:
    """Lay out the dovetail; raises InputError if its slope does not end between its lip and its top."""
    half, foot_z = foot.half_width_mm, foot.z_mm
    lip_half, neck_half = table.width_mm / 2.0 - table.fit_mm, table.neck_mm / 2.0
    heads = foot.screws - table.grip_mm * ABOVE
    # The dovetail is under the centre of the screws.
    y, low = float(heads[:, 1].mean()), foot_z - table.height_mm
    edge = low + table.lip_mm
    top = edge + lip_half - neck_half
    if not edge < top < foot_z:
        raise InputError(
            f"dovetail's slope ends {top - low:.1f} mm above its lower face, expected less than its height, "
            f"{table.height_mm:g} mm, and more than its lip, {table.lip_mm:g} mm"
        )
    tail = np.array(
        [(-lip_half, low), (lip_half, low), (lip_half, edge), (neck_half, top), (-neck_half, top), (-lip_half, edge)]
    )
    stem = np.array([(-neck_half, edge), (neck_half, edge), (neck_half, foot_z), (-neck_half, foot_z)])
    pieces = tuple(prism_along_x(outline + np.array([y, 0.0]), -half, half) for outline in (tail, stem))
    lip = np.array([[half, y - lip_half, low], [half, y + lip_half, low]])
    plan = BlocksPlan(
        DOVETAIL,
        pieces,
        tuple(head_cuts(heads, table.grip_mm, ALONG_X, hardware)),
        (
            length(lip[0], lip[1], "dovetail"),
            length(np.array([half, y - neck_half, top]), np.array([half, y + neck_half, top])),
            length(lip[1], np.array([half, y + lip_half, edge])),
            length(lip[1], np.array([half, y + neck_half, top]), "", ABOVE),
        ),
    )
    return Back(
        table=table,
        parts=(BackPart(DOVETAIL, "Dovetail", plan, SIDE_DOWN, np.array([0.0, 0.0, -45.0]), RGB),),
        foot=foot_stack(hardware),
        foot_heads=heads,
        heading="screw on the dovetail",
        steps=(
            "Put it into the clamp, its long side along the jaws, and close them. No standard defines this dovetail, "
            f"and clamps vary: it is drawn {table.width_mm:g} mm wide with sides of 45°, less {table.fit_mm:g} mm on "
            "each side. If the clamp does not close, or does not hold, change `fit_mm` under `[back]` in a hardware "
            "file and print it again.",
        ),
        critical_sections=(
            CriticalSection("over the slope", np.array([0.0, y, top]), ABOVE, ALONG_X, (2.0 * half, 2.0 * neck_half)),
        ),
    )


(PROFILE,) = ProfileBack.parts
T_NUT = "M5 T-slot"
# Distances from the mount to a screw's axis, from there to the end of the plate, and from the mount to the plate's
# front and rear edges.
SCREW_GAP_MM, SCREW_TO_END_MM, EDGE_MM = 9.0, 8.0, 3.0
# Half length of the profile in pictures.
HALF_PROFILE_MM = 120.0
# The heads are deep below the face, so wider holes still leave a wall between them.
FLARE_MM = 0.6


def plan_profile(table: ProfileBack, foot: Foot, load: Load, hardware: Hardware) -> Back:
    """Lay out the plate over a profile along x, with its slot under the rear screws of the mount's foot."""
    foot_z, m5 = foot.z_mm, thread_of("M5")
    low_z, front = foot_z - table.plate_mm, foot.front_y_mm
    heads = foot.screws - table.grip_mm * ABOVE
    y, x = float(heads[:, 1].min()), foot.half_width_mm + SCREW_GAP_MM
    end, back = x + SCREW_TO_END_MM, foot.back_y_mm
    sink = table.plate_mm - table.grip_mm
    cuts = [
        cut for head in heads for cut in countersunk_hole(head, table.grip_mm, sink, hardware.screw.thread, FLARE_MM)
    ]
    grip = table.plate_mm - table.sunk_mm
    explode, items = np.array([0.0, 0.0, -45.0]), []
    for side in (-x, x):
        top = np.array([side, y, foot_z])
        cuts.append(Bore(top + OUTSIDE_MM * ABOVE, -ABOVE, m5.clearance_mm / 2.0, table.plate_mm + 1.0))
        cuts.append(
            Bore(
                top + OUTSIDE_MM * ABOVE,
                -ABOVE,
                m5.head_mm / 2.0 + 2.0 * hardware.fit.free_mm,
                table.sunk_mm + OUTSIDE_MM,
            )
        )
        head = top - table.sunk_mm * ABOVE
        items.append(
            PurchasedItem("screw", "M5", table.screw_mm, frame_along(head, ABOVE), explode + 30.0 * ABOVE, (PROFILE,))
        )
        nut = np.array([side, y, low_z - table.lip_mm])
        down = -30.0 * ABOVE
        items.append(
            PurchasedItem("nut", T_NUT, table.nut_mm, frame_along(nut, ABOVE), explode + down, (PROFILE,), down[None])
        )
    plan = BlocksPlan(PROFILE, (box((-end, back - EDGE_MM, low_z), (end, front + EDGE_MM, foot_z)),), tuple(cuts))
    half = table.profile_mm / 2.0
    profile = box((-HALF_PROFILE_MM, y - half, low_z - table.profile_mm), (HALF_PROFILE_MM, y + half, low_z))
    depth = front - back + 2.0 * EDGE_MM
    # Both sides of the mount share the load.
    section = CriticalSection(
        "plate beside the mount",
        np.array([0.0, y, low_z + grip / 2.0]),
        ALONG_X,
        ALONG_Y,
        (2.0 * depth, table.plate_mm),
    )
    return Back(
        table=table,
        parts=(BackPart(PROFILE, "Profile plate", plan, UPRIGHT, explode, RGB),),
        foot=foot_stack(hardware),
        foot_heads=heads,
        heading="screw the device to a profile",
        fits=f"It fits aluminium profiles of {table.profile_mm:g} mm with slots of 6 mm (type I).",
        steps=(
            "Hang the T-nuts on the M5 screws by two turns, lay the plate on the profile and the nuts into its slot, "
            "and tighten the screws from above with a 4 mm hex key: the nuts turn across the slot.",
        ),
        foot_form=COUNTERSUNK,
        items=tuple(items),
        supports=(Support("profile", (profile,)),),
        critical_sections=(section,),
    )
