"""Ways of inserts and nuts out of their seats: each ends outside of its part, and none goes through it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mirrorcam.cad.assembly.catalogue import bought_items, parts_of
from mirrorcam.cad.assembly.device_plan import plan_device
from mirrorcam.cad.assembly.pieces import item_pieces, tessellated
from mirrorcam.cad.checks.exported_mesh import solid_of
from mirrorcam.cad.checks.insertion import check_insertion
from mirrorcam.cad.checks.tool_reach import check_tool_reach
from mirrorcam.cad.plan.back_table import back_of
from mirrorcam.cad.plan.hardware import HARDWARE, Hardware
from mirrorcam.optics.geometry.camera_library import read_body
from mirrorcam.optics.geometry.layout import Layout

HOMES = ("mirror_holder", "mount", "camera_clip", "adapter_saddle", "adapter_desk")
NUTS = HARDWARE.replaced(screw=HARDWARE.screw.replaced(kind="nut"))


@pytest.mark.parametrize(
    "hardware",
    [HARDWARE, NUTS, NUTS.replaced(camera=read_body("board_38"), back=back_of("gen2"))],
    ids=["insert", "nut", "board on a clamp"],
)
def test_inserts_and_nuts_get_to_their_seats(hardware: Hardware, small_layout: Layout) -> None:
    device = plan_device(small_layout, hardware)
    items = bought_items(device)
    assert all(bool(len(item.way_out_mm)) == (item.kind in ("insert", "nut")) for item in items)
    solids = {part.name: solid_of(tessellated(part.make(part.plan))) for part in parts_of(device) if part.name in HOMES}
    solids |= {piece.name: solid_of(piece.mesh) for piece in item_pieces(items)}
    assert not [name for name, check in check_insertion(items, solids).items() if check.passed is False]
    threads = [item for item in items if item.kind in ("insert", "nut")]
    assert check_tool_reach(threads, solids)["device.tool_clash_mm3"].value == 0.0
    if hardware.screw.kind == "nut":
        # As nuts were drawn once: before the face that the screw enters, as if they were inserts.
        wrong = [replace(item, way_out_mm=12.0 * item.rig_from_item[None, :3, 2]) for item in items]
        assert check_insertion(wrong, solids)["device.insertion_clash_mm3"].value > 100.0


def test_a_nut_of_the_foot_leaves_by_the_nearer_side(small_layout: Layout) -> None:
    nuts = [item for item in bought_items(plan_device(small_layout, NUTS)) if item.joins == ("mount",)]
    assert len(nuts) == 4
    for nut in nuts:
        assert nut.way_out_mm[0] @ nut.rig_from_item[:3, 2] < 0.0
        assert np.sign(nut.way_out_mm[1, 0]) == np.sign(nut.rig_from_item[0, 3])
