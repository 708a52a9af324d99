"""The printed parts of a device: name, number, how each is made, how it lies on the bed."""

from __future__ import annotations

import numpy as np

from cad.device import Device
from cad.holder.solid import make_holder
from cad.part import BoughtItem, PartPlan
from optics.values import FloatArray


def parts_of(device: Device) -> tuple[PartPlan, ...]:
    """Every part to print, in the order of their numbers."""
    holder = device.holder
    return (
        PartPlan(
            name="mirror_holder",
            title="Mirror holder",
            number="MC-01",
            plan=holder,
            make=make_holder,
            print_from_rig=lying_on(holder.rig_from_mount),
            explode_mm=np.zeros(3),
            rgb=(0.36, 0.39, 0.44),
        ),
    )


def bought_items(device: Device) -> tuple[BoughtItem, ...]:
    """Every screw, insert, nut and pin of the device, in its place."""
    return ()


def lying_on(rig_from_face: FloatArray) -> FloatArray:
    """The transform (4, 4) to the bed of a part that lies on a flat face, whose frame's z points out of the part."""
    bed_from_face = np.diag([1.0, -1.0, -1.0, 1.0])
    face_from_rig = np.linalg.inv(rig_from_face)
    return np.asarray(bed_from_face @ face_from_rig)
