"""The catalogue of a device: printed parts with names, numbers, named faces and poses on the bed, and purchased items.

Each bought insert or nut has the moves by which it leaves its seat; they follow from the plans of the pockets.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np

from mirrorcam.cad.assembly.device_plan import Device, connections
from mirrorcam.cad.backs.back import BackJoint
from mirrorcam.cad.backs.plan_backs import make_adapter
from mirrorcam.cad.holder.adjuster import SUNK_MM, UNDER_NUT_MM
from mirrorcam.cad.holder.holder_solid import make_holder, make_screwed_holder
from mirrorcam.cad.holder.screwed_holder import ScrewedHolderPlan
from mirrorcam.cad.parts.mount import rotation_2d
from mirrorcam.cad.parts.part_solids import make_carrier, make_clip, make_coupon, make_cover, make_mount
from mirrorcam.cad.parts.truss import NUT_RISE, foot_plate_mm
from mirrorcam.cad.plan.device_names import CAMERA, CLIP, COUPON, COVER, HOLDER, MOUNT, carrier_name
from mirrorcam.cad.plan.fasteners import X_AXIS, Stack, exit_move, frame_along
from mirrorcam.cad.plan.part_plan import NamedFace, PartPlan, PurchasedItem, Rgb
from mirrorcam.cad.plan.prisms import corners_of
from mirrorcam.cad.plan.seats import seat_height_mm
from mirrorcam.cad.plan.threads import COUNTERSUNK
from mirrorcam.cad.splitting import Pieces, split
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.transforms import rigid, transform

# Print orientations of a part: rows are the bed's x, y and z in the rig frame.
X_UP = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
Y_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
Z_UP = np.eye(3)
RIGHT, TO_SCENE, UP = np.eye(3)

# Distance of carriers from the holder in an exploded view.
CARRIER_EXPLODE_MM = 25.0

EXPLODE = {
    HOLDER: (0.0, 30.0, 60.0),
    MOUNT: (0.0, -60.0, 0.0),
    CLIP: (0.0, 20.0, -20.0),
    COUPON: (0.0, 0.0, 0.0),
    COVER: (0.0, 0.0, 0.0),
}


def parts_of(device: Device) -> tuple[PartPlan, ...]:
    """Parts to print, in the order of their numbers; a part larger than the bed is replaced by its pieces."""
    return _on_bed(device).parts


@lru_cache(maxsize=2)
def _on_bed(device: Device) -> Pieces:
    """Printed parts, and the pins between pieces; cached per device, since splitting a part makes its solid."""
    corners = {
        HOLDER: device.holder.corners_in_rig,
        MOUNT: corners_of(device.mount.pieces),
        CLIP: corners_of(device.clip.pieces),
        **{part.name: part.plan.corners for part in device.back.parts},
        COUPON: corners_of(device.coupon.pieces),
        **({COVER: corners_of((device.cover.outer,))} if device.cover else {}),
        **{carrier_name(carrier.name): corners_of((carrier.body,)) for carrier in device.mirror_carriers},
    }
    cuts = {HOLDER: device.holder.cuts_on_bed_mm}
    if device.mount.bed_cuts_mm:
        cuts[MOUNT] = ((), device.mount.bed_cuts_mm)
    pieces = [split(part, corners[part.name], device.hardware, cuts.get(part.name)) for part in _unsplit(device)]
    parts = (part for piece in pieces for part in piece.parts)
    return Pieces(
        tuple(replace(part, faces=named_faces(device, part.name)) for part in parts),
        tuple(pin for piece in pieces for pin in piece.pins),
    )


def _unsplit(device: Device) -> Iterator[PartPlan]:
    """The parts to print before they are split, in the order of their numbers."""
    moves = explode_moves(device)

    def part(
        number: int, name: str, title: str, plan: Any, make: Any, print_from_rig: FloatArray, rgb: Rgb
    ) -> PartPlan:
        return PartPlan(name, title, f"MC-{number:02d}", plan, make, print_from_rig, moves[name], rgb)

    holder, mount, clip, coupon, cover = device.holder, device.mount, device.clip, device.coupon, device.cover
    make = make_screwed_holder if device.mirror_carriers else make_holder
    yield part(1, HOLDER, "Mirror holder", holder, make, face_down(holder.rig_from_mount), (0.36, 0.39, 0.44))
    on_end = rotated_on_bed(with_base_at(X_UP, -mount.half_width_mm), mount.bed_turn_deg)
    yield part(2, MOUNT, "Mount", mount, make_mount, on_end, (0.16, 0.46, 0.62))
    yield part(3, CLIP, "Camera clip", clip, make_clip, with_base_at(Y_UP, clip.slide_y_mm), (0.93, 0.55, 0.20))
    for number, back in enumerate(device.back.parts, start=4):
        base_z = float((back.plan.corners @ back.bed_from_rig[2]).min())
        pose = with_base_at(back.bed_from_rig, base_z)
        yield part(number, back.name, back.title, back.plan, make_adapter, pose, back.rgb)
    yield part(6, COUPON, "Fit coupon", coupon, make_coupon, with_base_at(Z_UP, coupon.centre[2]), (0.72, 0.66, 0.82))
    if cover:
        yield part(7, COVER, "Dust cover", cover, make_cover, face_down(cover.rig_from_front), (0.80, 0.76, 0.62))
    for number, carrier in enumerate(device.mirror_carriers, start=8):
        title, on_back = f"Mirror carrier {carrier.name}", face_down(carrier.rig_from_back)
        yield part(number, carrier_name(carrier.name), title, carrier, make_carrier, on_back, (0.46, 0.49, 0.54))


def purchased_items(device: Device) -> tuple[PurchasedItem, ...]:
    """Screws, inserts, nuts and pins of the device, in their positions."""
    mount, clip, back = device.mount, device.clip, device.back
    head_z = -mount.rig_from_head[:3, 2]
    holes = np.column_stack([mount.holes_in_head_mm, np.full(4, -mount.head.grip_mm)])
    slots = device.holder.slot_directions if device.holder.slots else X_AXIS
    slide = clip.slide_points - clip.slide.grip_mm * TO_SCENE
    head, foot = (MOUNT, HOLDER), (back.parts[0].name, MOUNT)
    return (
        *_screws(
            device,
            transform(mount.rig_from_head, holes),
            head_z,
            mount.head,
            head,
            holder_nut_exits_mm,
            slots,
        ),
        *_screws(device, slide, -TO_SCENE, clip.slide, (MOUNT, CLIP), slide_nut_exits_mm),
        *_screws(
            device, back.foot_heads, -mount.foot.up_in_rig, back.foot, foot, foot_nut_exits_mm, form=back.foot_form
        ),
        *(item for joint in back.joints for item in _joint_screws(device, joint)),
        *back.items,
        *_camera_screws(device),
        *_carrier_items(device),
        *_on_bed(device).pins,
    )


def _joint_screws(device: Device, joint: BackJoint) -> Iterator[PurchasedItem]:
    """The screws of a joint between two parts of the adapter, with their inserts or nuts."""
    yield from _screws(
        device, joint.heads, joint.out, joint.stack, joint.joins, lambda _, seats: joint.nut_exits_mm, joint.corners
    )


def explode_moves(device: Device) -> dict[str, FloatArray]:
    """Displacements (3,) of the printed parts in an exploded view, by part name."""
    moves = {name: np.array(move) for name, move in EXPLODE.items()}
    carrier_move = EXPLODE[HOLDER] - CARRIER_EXPLODE_MM * device.holder.rig_from_mount[:3, 2]
    carriers = {carrier_name(carrier.name): carrier_move for carrier in device.mirror_carriers}
    return moves | {part.name: part.explode_mm for part in device.back.parts} | carriers


def _screws(
    device: Device,
    heads: FloatArray,
    out: FloatArray,
    stack: Stack,
    joins: tuple[str, str],
    nut_exits_mm: Callable[[Device, FloatArray], FloatArray],
    corners: FloatArray = X_AXIS,
    form: str = "",
) -> Iterator[PurchasedItem]:
    """Screws with their heads, or the washers under them, at points (n, 3), and their inserts or nuts.

    `out` (3,) points from the tip to the head. Nuts have a corner in the direction `corners`, (3,) or (n, 3), and leave
    their seats by the moves `nut_exits_mm`.
    """
    screw = device.hardware.screw
    outer, inner = (explode_moves(device)[name] for name in joins)
    for head in heads:
        if stack.washer_mm > 0.0:
            yield PurchasedItem(
                "washer", screw.thread, stack.washer_mm, frame_along(head, out), outer + 23.0 * out, joins
            )
        under_head = frame_along(head + stack.washer_mm * out, out)
        yield PurchasedItem(
            "screw",
            f"{screw.thread}{form}",
            stack.length_mm,
            under_head,
            outer + 25.0 * out,
            joins,
            lengths_mm=stack.lengths_mm,
        )
    mouths = heads - stack.grip_mm * out
    if screw.kind == "insert":
        moves = insert_exit_mm(out)
        for mouth in mouths:
            yield _thread(device, frame_along(mouth, out), inner, joins[1:], moves)
        return
    seats = mouths - stack.begins_mm * out
    exits = nut_exits_mm(device, seats)
    for seat, moves, corner in zip(seats, exits, np.broadcast_to(corners, heads.shape), strict=True):
        yield _thread(device, frame_along(seat, out, corner), inner, joins[1:], moves)


def _thread(
    device: Device, rig_from_item: FloatArray, part_move: FloatArray, joins: tuple[str, ...], exit_moves_mm: FloatArray
) -> PurchasedItem:
    """An insert or a nut; in an exploded view it is at the end of its exit moves, after the part's move."""
    screw = device.hardware.screw
    length = screw.insert_mm if screw.kind == "insert" else screw.nut_height_mm
    return PurchasedItem(
        screw.kind, screw.thread, length, rig_from_item, part_move + exit_moves_mm.sum(axis=0), joins, exit_moves_mm
    )


def _camera_screws(device: Device) -> Iterator[PurchasedItem]:
    """The fasteners of the camera in its clip: sprung screws on a body, screws in its threads, or a board's screws."""
    clip, hardware = device.clip, device.hardware
    clip_move = np.array(EXPLODE[CLIP])
    for screw in clip.screws:
        joins = (CLIP, CAMERA) if screw.engaged_mm else (CLIP,)
        frame = frame_along(screw.head, screw.out)
        yield PurchasedItem("screw", screw.size, screw.length_mm, frame, clip_move + 20.0 * screw.out, joins)
    for sprung in clip.tray.screws if clip.tray else ():
        out = -sprung.axis
        yield PurchasedItem(
            "screw",
            hardware.screw.thread,
            sprung.length_mm,
            frame_along(sprung.head, out),
            clip_move + 25.0 * out,
            (CLIP,),
        )
        seat = sprung.tip + (sprung.mouth_mm - sprung.thread_mm) * out
        insert = hardware.screw.kind == "insert"
        moves = insert_exit_mm(out) if insert else sprung.nut_way_mm
        corner_direction = X_AXIS if insert else TO_SCENE - (TO_SCENE @ out) * out
        yield _thread(device, frame_along(seat, out, corner_direction), clip_move, (CLIP,), moves)


def _carrier_items(device: Device) -> Iterator[PurchasedItem]:
    """The screws that pull every mirror's carrier towards the holder, their springs, and their inserts or nuts."""
    holder, screw = device.holder, device.hardware.screw
    if not isinstance(holder, ScrewedHolderPlan):
        return
    adjuster, outward, corner = holder.adjuster, holder.rig_from_mount[:3, 2], holder.rig_from_mount[:3, 0]
    moves = explode_moves(device)
    holder_move = moves[HOLDER]
    for carrier, heads in zip(holder.carriers, holder.heads.reshape(-1, 3, 3), strict=True):
        name = carrier_name(carrier.name)
        joins, carrier_move = (HOLDER, name), moves[name]
        for head in heads:
            top = head - SUNK_MM * outward
            yield PurchasedItem(
                "screw",
                f"{adjuster.thread}{COUNTERSUNK}",
                adjuster.length_mm,
                frame_along(top, outward),
                holder_move + 25.0 * outward,
                joins,
            )
            recess = head - (adjuster.plate_mm - adjuster.recess_mm) * outward
            size = device.hardware.holder.spring.size
            yield PurchasedItem(
                "spring",
                size,
                adjuster.spring_mm,
                frame_along(recess, outward),
                holder_move - 0.6 * CARRIER_EXPLODE_MM * outward,
                joins,
            )
            mouth = head - (adjuster.plate_mm + adjuster.gap_mm) * outward
            if screw.kind == "insert":
                yield _thread(device, frame_along(mouth, outward), carrier_move, (name,), insert_exit_mm(outward))
            else:
                seat = mouth - UNDER_NUT_MM * outward
                exit_mm = exit_move(corners_of((carrier.body,)), seat, -outward)[None]
                yield _thread(device, frame_along(seat, outward, corner), carrier_move, (name,), exit_mm)


def with_base_at(bed_from_rig: FloatArray, low_mm: float) -> FloatArray:
    """The transform (4, 4) of a part to the bed: a rotation (3, 3), then a shift of its lowest height `low_mm` to 0."""
    return rigid(bed_from_rig, [0.0, 0.0, -low_mm])


def rotated_on_bed(bed_from_rig: FloatArray, degrees: float) -> FloatArray:
    """A transform (4, 4) to the bed, followed by a rotation in degrees about the bed's normal."""
    about_z = np.eye(4)
    about_z[:2, :2] = rotation_2d(degrees)
    return np.asarray(about_z @ bed_from_rig)


def face_down(rig_from_face: FloatArray) -> FloatArray:
    """The transform (4, 4) of a part to the bed with a flat face down; the face's frame has z out of the part."""
    bed_from_face = np.diag([1.0, -1.0, -1.0, 1.0])
    face_from_rig = np.linalg.inv(rig_from_face)
    return np.asarray(bed_from_face @ face_from_rig)


def named_faces(device: Device, part: str) -> tuple[NamedFace, ...]:
    """The named faces of a printed part or of a piece of it, such as "mount_1".

    "seat_ROW-COLUMN" and "pad_ROW-COLUMN" are behind each mirror; "joint_NAME" is at each connection to another part.
    """
    whole_part = re.sub(r"_\d+$", "", part)
    faces = []
    for joint in connections(device):
        if joint.parent == whole_part:
            frame = joint.rig_from_parent_joint
            faces.append(NamedFace(f"joint_{joint.name}", frame[:3, 3], frame[:3, 2]))
        if joint.child == whole_part:
            frame = joint.rig_from_child_joint
            faces.append(NamedFace(f"joint_{joint.name}", frame[:3, 3], -frame[:3, 2]))
    for name, mirror in zip(device.layout.mirror_names, device.layout.mirrors, strict=True):
        if (part != carrier_name(name)) if device.mirror_carriers else (whole_part != HOLDER):
            continue
        normal = mirror.rig_from_plane[:3, 2]
        for kind, height in (("seat", seat_height_mm(mirror, device.hardware)), ("pad", mirror.back_mm)):
            outline = mirror.outline_in_rig_mm + height * normal
            faces.append(NamedFace(f"{kind}_{name}", outline.mean(axis=0), normal, outline))
    return tuple(faces)


# Distance of an insert from its hole in an exploded view.
INSERT_EXPLODE_MM = 17.0


def insert_exit_mm(out: FloatArray) -> FloatArray:
    """The exit move (1, 3) of an insert, along the outward unit normal `out` (3,) of the face that the screw enters."""
    return INSERT_EXPLODE_MM * out[None]


def holder_nut_exits_mm(device: Device, seats: FloatArray) -> FloatArray:
    """Exit moves (n, 1, 3) in the rig frame, along their slots, of the nuts at seats (n, 3) in the holder's back."""
    corners, directions = device.holder.corners_in_rig, device.holder.slot_directions
    unit = directions / np.linalg.norm(directions, axis=1)[:, None]
    return np.array([[exit_move(corners, seat, direction)] for seat, direction in zip(seats, unit, strict=True)])


def slide_nut_exits_mm(device: Device, seats: FloatArray) -> FloatArray:
    """Exit moves (n, 1, 3) of the nuts of the clip's slide: from its wall towards the scene."""
    corners = corners_of(device.clip.pieces)
    return np.array([[exit_move(corners, seat, TO_SCENE)] for seat in seats])


def foot_nut_exits_mm(device: Device, seats: FloatArray) -> FloatArray:
    """Exit moves (n, 2, 3) of the nuts in the mount's foot: off its plate into the truss, then to the nearer side."""
    corners, screw, foot = corners_of(device.mount.pieces), device.hardware.screw, device.mount.foot
    plate, up = foot.z_mm + foot_plate_mm(device.mount.section.depth_mm, device.hardware), foot.up_in_rig
    # The origin of a nut is at its face towards the screw.
    off_plate = [(plate - seat @ up + (NUT_RISE - 1.0) * screw.nut_height_mm) * up for seat in seats]
    sides = [exit_move(corners, seat, np.sign(seat[0]) * RIGHT) for seat in seats]
    return np.stack([off_plate, sides], axis=1)
