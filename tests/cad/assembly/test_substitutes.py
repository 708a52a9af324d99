"""What may replace a screw: the joints' own rule decides on lengths, and washers have the space that is promised."""

from __future__ import annotations

import re
from dataclasses import replace

import pytest

from mirrorcam.cad.assembly.device_plan import Device
from mirrorcam.cad.assembly.substitutes import length_notes, substitutes
from mirrorcam.cad.plan.back_table import Gen2Back
from mirrorcam.cad.plan.fasteners import stack
from mirrorcam.cad.plan.hardware import HARDWARE, Fastening
from mirrorcam.cad.plan.part_plan import PurchasedItem
from mirrorcam.cad.plan.threads import FITTINGS
from mirrorcam.core.errors import InputError
from tests.cad.assembly.bought import item

LENGTHS = FITTINGS["M3"].lengths_mm


def screw_for(grip_mm: float) -> PurchasedItem:
    fastened = stack(grip_mm, HARDWARE)
    return replace(item("screw", "M3", fastened.length_mm), lengths_mm=fastened.lengths_mm)


@pytest.mark.parametrize("grip_mm", [3.0, 4.0, 5.5])
def test_a_length_is_said_to_hold_if_a_box_with_that_length_alone_builds_the_joint(grip_mm: float) -> None:
    screw = screw_for(grip_mm)
    notes = length_notes([screw], HARDWARE.screw)
    hold = {float(length) for note in notes if "as well" in note for length in re.findall(r"M3 x ([\d.]+)", note)}
    for length in LENGTHS:
        only = HARDWARE.replaced(screw=HARDWARE.screw.replaced(lengths_mm=(length,)))
        try:
            fits = stack(grip_mm, only).length_mm == length
        except InputError:
            fits = False
        assert (length in hold or length == screw.length_mm) == fits
    assert f"M3 x {min(length for length in LENGTHS if length > screw.length_mm):g} is" in notes[-1]


def test_washers_take_up_what_is_too_long() -> None:
    notes = length_notes([screw_for(4.0)], Fastening())
    assert "M3 x 12 is 1.5 mm too long; it fits with 3 washers under its head." in notes
    countersunk = replace(screw_for(4.0), size="M3 countersunk")
    assert "washer" not in " ".join(length_notes([countersunk], Fastening()))


def test_what_the_plan_does_not_decide_is_not_claimed(device: Device) -> None:
    assert length_notes([item("screw", "M3", 16.0)], HARDWARE.screw) == ["Only this length is known to fit."]
    nut = item("nut", "1/4-20 UNC", 5.6)
    assert substitutes([nut], device) == ["Leave it out if the device will never stand on a tripod."]
    arm = replace(device, back=replace(device.back, stand=None, table=Gen2Back()))
    assert substitutes([nut], arm) == []
    (insert, other) = substitutes([item("insert", "M3", 5.7)], device)
    assert f"at least {HARDWARE.screw.engaged_mm:g} mm long" in insert
    assert 'kind = "nut"' in other
