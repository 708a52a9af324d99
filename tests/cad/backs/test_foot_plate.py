"""A plate under the mount's foot: thick enough for its nut and the heads of its screws, with walls around them."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.cad.assembly.device_plan import Device
from mirrorcam.cad.backs.blocks import tripod_depth_mm
from mirrorcam.cad.backs.foot_plate import back_of_plate, foot_plate
from mirrorcam.cad.backs.plan_backs import plan_back
from mirrorcam.cad.plan.back_table import DeskBack, TripodBack
from mirrorcam.cad.plan.fasteners import Countersink
from tests.cad.backs.planned_blocks import blocks_of


@pytest.mark.parametrize("table", [DeskBack(), TripodBack(), TripodBack(grip_mm=9.0)])
def test_a_plate_holds_the_nut_and_the_heads(device: Device, table: DeskBack | TripodBack) -> None:
    plate = foot_plate(table, device.mount, device.hardware)
    foot_z = device.mount.foot_z_mm
    assert plate.low_z_mm + plate.thick_mm == pytest.approx(foot_z)
    assert plate.thick_mm >= tripod_depth_mm(table.nut)
    # Heads do not stand out below.
    assert plate.heads[:, 2] == pytest.approx(foot_z - table.grip_mm)
    assert plate.heads[0, 2] > plate.low_z_mm
    assert plate.nut_at[1] == plate.heads[:, 1].min()


@pytest.mark.parametrize("table", [DeskBack(), TripodBack()])
def test_countersinks_keep_a_wall_to_each_other_and_to_the_edges(device: Device, table: DeskBack | TripodBack) -> None:
    back = plan_back(device.clip, device.mount, device.hardware.replaced(back=table))
    plan = blocks_of(back.parts[0])
    sinks = [cut for cut in plan.cuts if isinstance(cut, Countersink)]
    assert len(sinks) == 4
    wall, low, high = device.hardware.printer.wall_mm, plan.corners.min(axis=0), plan.corners.max(axis=0)
    assert plan.corners[:, 2].max() - plan.corners[:, 2].min() >= table.grip_mm
    for sink in sinks:
        reach = sink.radius_mm + wall
        assert (sink.mouth[:2] - reach > low[:2]).all()
        assert (sink.mouth[:2] + reach < high[:2]).all()
        others = [np.linalg.norm((sink.mouth - other.mouth)[:2]) for other in sinks if other is not sink]
        assert min(others) >= 2.0 * sink.radius_mm + wall


def test_the_outline_is_the_callers(device: Device) -> None:
    table = TripodBack()
    plate = foot_plate(table, device.mount, device.hardware)
    outline = np.array([(-60.0, -60.0), (60.0, -60.0), (0.0, 70.0)])
    back = back_of_plate(table, "plate", "Plate", plate, outline, device.hardware)
    np.testing.assert_allclose(blocks_of(back.parts[0]).corners[:3, :2], outline)
    assert back.necks == ()
    assert [item.size for item in back.items] == ["1/4-20 UNC"]
