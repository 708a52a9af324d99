"""Names of the faces that count: seats of mirrors, and where parts meet; they are in the STEP files (docs/cad.md)."""

from __future__ import annotations

import re

from mirrorcam.cad.assembly.device_plan import Device, connections
from mirrorcam.cad.plan.device_names import HOLDER, carrier_name
from mirrorcam.cad.plan.part_plan import NamedFace
from mirrorcam.cad.plan.seats import seat_height_mm


def named_faces(device: Device, part: str) -> tuple[NamedFace, ...]:
    """The faces of a printed part, by its name, or that of a piece of it, such as "mount_1".

    "seat_ROW-COLUMN" and "pad_ROW-COLUMN" behind each mirror, "joint_NAME" at each connection to another part.
    """
    whole = re.sub(r"_\d+$", "", part)
    faces = []
    for joint in connections(device):
        if joint.parent == whole:
            frame = joint.rig_from_parent_joint
            faces.append(NamedFace(f"joint_{joint.name}", frame[:3, 3], frame[:3, 2]))
        if joint.child == whole:
            frame = joint.rig_from_child_joint
            faces.append(NamedFace(f"joint_{joint.name}", frame[:3, 3], -frame[:3, 2]))
    for name, mirror in zip(device.layout.mirror_names, device.layout.mirrors, strict=True):
        if (part != carrier_name(name)) if device.mirror_carriers else (whole != HOLDER):
            continue
        normal = mirror.rig_from_plane[:3, 2]
        for kind, height in (("seat", seat_height_mm(mirror, device.hardware)), ("pad", mirror.back_mm)):
            outline = mirror.outline_in_rig_mm + height * normal
            faces.append(NamedFace(f"{kind}_{name}", outline.mean(axis=0), normal, outline))
    return tuple(faces)
