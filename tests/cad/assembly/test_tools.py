"""Tools: a key for every socket among the screws, and what the material and the fasteners take."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mirrorcam.cad.assembly.device_plan import Device
from mirrorcam.cad.assembly.tools import also_needed, tools_of
from mirrorcam.cad.plan.hardware import Cutting
from mirrorcam.cad.plan.part_plan import BoughtItem, BoughtKind
from mirrorcam.optics.geometry.camera_library import read_body


def item(kind: BoughtKind, size: str) -> BoughtItem:
    return BoughtItem(kind, size, 8.0, np.eye(4), np.zeros(3), ("mount",))


@pytest.mark.parametrize(
    ("sizes", "keys"),
    [
        (("M3",), {"hex key of 2.5 mm": "screws M3 (ISO 4762)"}),
        (("M3 countersunk",), {"hex key of 2 mm": "screws M3 (ISO 10642)"}),
        (
            ("M3", "M3 countersunk", "M3"),
            {"hex key of 2 mm": "screws M3 (ISO 10642)", "hex key of 2.5 mm": "screws M3 (ISO 4762)"},
        ),
        (("M4", "M5", "M6"), {f"hex key of {key} mm": f"screws M{key + 1} (ISO 4762)" for key in (3, 4, 5)}),
    ],
)
def test_every_screw_has_the_key_of_its_standard(device: Device, sizes: tuple[str, ...], keys: dict[str, str]) -> None:
    found = tools_of(device, [item("screw", size) for size in sizes])
    assert {tool.name: tool.purpose for tool in found if tool.name.startswith("hex key")} == keys


def test_tools_follow_fasteners_and_material(device: Device) -> None:
    def names(of: Device, *items: BoughtItem) -> set[str]:
        return {tool.name for tool in tools_of(of, items)}

    assert names(device, item("insert", "M3")) - names(device) == {"soldering iron with a tip for M3 inserts"}
    assert names(device, item("nut", "M3")) - names(device) == {"tweezers"}
    forming = item("screw", "M2 thread-forming")
    assert names(device, forming) - names(device) == {"small screwdriver"}
    glass = replace(device, hardware=device.hardware.replaced(cutting=Cutting(material="glass")))
    assert names(glass) - names(device) == {"goggles and cut-resistant gloves", "paint marker"}


def test_a_phone_needs_felt(device: Device) -> None:
    phone = replace(device, hardware=device.hardware.replaced(camera=read_body("iphone_13")))
    assert {tool.name for tool in also_needed(phone)} - {tool.name for tool in also_needed(device)} == {
        "dot of felt, 1 mm thick"
    }
