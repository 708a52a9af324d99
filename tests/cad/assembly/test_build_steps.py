"""Build steps of a device: the pieces connected to the camera at the end of each step.

Tools: a key for every screw socket, and the tools for the material and the fasteners.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mirrorcam.cad.assembly.build_steps import STEPS, also_needed, connected_to_camera, parts_when_joined, tools_of
from mirrorcam.cad.assembly.device_plan import Device
from mirrorcam.cad.plan.hardware import Cutting
from mirrorcam.cad.plan.part_plan import BoughtKind, PurchasedItem
from mirrorcam.optics.geometry.camera_library import read_body
from mirrorcam.optics.geometry.design_spec import DesignSpec

PIECES = ("mirror_holder_1", "mirror_holder_2", "mount", "camera_clip", "adapter_cap", "mirror_0-0", "camera")
FASTENED = {
    "screw_01": ("mount", "mirror_holder"),
    "screw_02": ("mount", "camera_clip"),
    "screw_03": ("camera_clip",),
    "insert_01": ("mirror_holder",),
    "pin_01": ("mirror_holder_1", "mirror_holder_2"),
}


def together(name: str) -> set[str]:
    (last,) = (step for step in STEPS if step.name == name)
    return connected_to_camera(STEPS, last, PIECES, FASTENED)


def test_the_camera_is_alone_until_it_is_in_its_clip() -> None:
    assert together("holder") == set()
    assert together("camera") == {"camera_clip", "screw_03"}


def test_the_clip_brings_the_mount_and_all_that_is_on_it() -> None:
    assert together("clip") == (set(PIECES) | set(FASTENED)) - {"camera", "adapter_cap"}
    assert together("calibrate") == (set(PIECES) | set(FASTENED)) - {"camera"}


def test_pictures_go_to_folders_of_their_own() -> None:
    assert [step.pictures for step in STEPS if step.pictures] == ["base", "frames"]


def test_names_of_steps_differ() -> None:
    assert len({step.name for step in STEPS}) == len(STEPS)


SPLIT = {"mirror_holder", "mirror_0-0", "mount_1", "mount_2", "camera_clip", "camera", "adapter_saddle", "adapter_cap"}


@pytest.mark.parametrize(
    ("joins", "there"),
    [
        (("mount", "mirror_holder"), {"mirror_holder", "mirror_0-0", "mount_1", "mount_2"}),
        (("camera_clip",), {"camera", "camera_clip"}),
        (("mount", "camera_clip"), SPLIT - {"adapter_saddle", "adapter_cap"}),
        (("adapter_saddle", "mount"), SPLIT),
        (("adapter_cap", "adapter_saddle"), SPLIT),
        (("something", "else"), set()),
    ],
)
def test_pieces_present_at_a_screw_are_those_connected_to_its_parts_by_then(
    joins: tuple[str, ...], there: set[str]
) -> None:
    assert parts_when_joined(joins, SPLIT) == there


def item(kind: BoughtKind, size: str) -> PurchasedItem:
    return PurchasedItem(kind, size, 8.0, np.eye(4), np.zeros(3), ("mount",))


@pytest.mark.parametrize(
    ("sizes", "keys"),
    [
        (("M3",), {"2.5 mm hex key": "screws M3 (ISO 4762)"}),
        (("M3 countersunk",), {"2 mm hex key": "screws M3 (ISO 10642)"}),
        (
            ("M3", "M3 countersunk", "M3"),
            {"2 mm hex key": "screws M3 (ISO 10642)", "2.5 mm hex key": "screws M3 (ISO 4762)"},
        ),
        (("M4", "M5", "M6"), {f"{key} mm hex key": f"screws M{key + 1} (ISO 4762)" for key in (3, 4, 5)}),
    ],
)
def test_every_screw_has_the_key_of_its_standard(device: Device, sizes: tuple[str, ...], keys: dict[str, str]) -> None:
    found = tools_of(device, [item("screw", size) for size in sizes])
    assert {tool.name: tool.purpose for tool in found if tool.name.endswith("hex key")} == keys


def test_tools_follow_fasteners_and_material(device: Device) -> None:
    def names(of: Device, *items: PurchasedItem) -> set[str]:
        return {tool.name for tool in tools_of(of, items)}

    assert names(device, item("insert", "M3")) - names(device) == {"soldering iron with a tip for M3 inserts"}
    assert names(device, item("nut", "M3")) - names(device) == {"tweezers"}
    forming = item("screw", "M2 thread-forming")
    assert names(device, forming) - names(device) == {"small screwdriver"}
    acrylic = replace(device, hardware=device.hardware.replaced(cutting=Cutting(material="acrylic")))
    assert names(device) - names(acrylic) == {"goggles and cut-resistant gloves", "paint marker"}
    bought = replace(device, layout=device.layout.replaced(spec=DesignSpec(shape="stock:30x20")))
    assert names(device) - names(bought) == {"goggles and cut-resistant gloves"}
    purposes = [{tool.name: tool.purpose for tool in tools_of(of, ())}["steel ruler"] for of in (device, bought)]
    assert ["cut along" in purpose for purpose in purposes] == [True, False]
    pin = also_needed(device, [item("pin", "3")])
    assert {tool.name for tool in pin} - {tool.name for tool in also_needed(device, ())} == {"epoxy glue"}


def test_a_phone_needs_felt(device: Device) -> None:
    phone = replace(device, hardware=device.hardware.replaced(camera=read_body("iphone_13")))
    assert {tool.name for tool in also_needed(phone, ())} - {tool.name for tool in also_needed(device, ())} == {
        "dot of felt, 1 mm thick"
    }
