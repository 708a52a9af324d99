"""A plate under the mount's foot: thick enough for its nut and the heads of its screws, with walls around them.

The desk foot: the device on it stands under any load.

The tripod plate: as large as the mount's foot plus a wall behind it, with its nut under the mount.

The dovetail: its width minus the fit on both sides, sides at 45 deg, and the volume of its section.

The profile plate: screws on both sides of the mount, with their nuts in the middle of the slot.
"""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.cad.assembly.device_plan import Device
from mirrorcam.cad.backs.back import Load, carried_load
from mirrorcam.cad.backs.blocks import tripod_depth_mm
from mirrorcam.cad.backs.plan_backs import MAKERS
from mirrorcam.cad.backs.plates import FRONT_MM, back_of_plate, foot_plate, plan_arca, plan_desk
from mirrorcam.cad.checks.load_checks import tipping_angle_deg
from mirrorcam.cad.plan.back_table import ArcaBack, DeskBack, ProfileBack, TripodBack
from mirrorcam.cad.plan.fasteners import Countersink
from mirrorcam.cad.plan.threads import thread_of
from mirrorcam.core.errors import InputError
from tests.cad.backs.planned_blocks import blocks_of, planned_back


@pytest.mark.parametrize("table", [DeskBack(), TripodBack(), TripodBack(grip_mm=9.0)])
def test_a_plate_holds_the_nut_and_the_heads(device: Device, table: DeskBack | TripodBack) -> None:
    plate = foot_plate(table, device.mount.foot, device.hardware)
    foot_z = device.mount.foot.z_mm
    assert plate.low_z_mm + plate.thickness_mm == pytest.approx(foot_z)
    assert plate.thickness_mm >= tripod_depth_mm(table.nut)
    # Heads do not protrude below.
    assert plate.heads[:, 2] == pytest.approx(foot_z - table.grip_mm)
    assert plate.heads[0, 2] > plate.low_z_mm
    assert plate.nut_mouth[1] == plate.heads[:, 1].min()


@pytest.mark.parametrize("table", [DeskBack(), TripodBack()])
def test_countersinks_keep_a_wall_to_each_other_and_to_the_edges(device: Device, table: DeskBack | TripodBack) -> None:
    back = planned_back(device, table)
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


def test_the_plate_has_the_given_outline(device: Device) -> None:
    table = TripodBack()
    plate = foot_plate(table, device.mount.foot, device.hardware)
    outline = np.array([(-60.0, -60.0), (60.0, -60.0), (0.0, 70.0)])
    back = back_of_plate(table, "plate", "Plate", plate, outline, device.hardware)
    np.testing.assert_allclose(blocks_of(back.parts[0]).corners[:3, :2], outline)
    assert back.critical_sections == ()
    assert [item.size for item in back.items] == ["1/4-20 UNC"]


@pytest.mark.parametrize("at", [None, (-1.0, 60.0, 80.0), (40.0, -80.0, 150.0)])
def test_the_plate_extends_far_enough_for_the_required_tilt(
    device: Device, at: tuple[float, float, float] | None
) -> None:
    load = carried_load(device.mount, device.clip, device.hardware) if at is None else Load(500.0, np.array(at))
    table = DeskBack(tip_deg=12.0, spare_deg=4.0)
    back = plan_desk(table, device.mount.foot, load, device.hardware)
    assert back.stand is not None
    assert tipping_angle_deg(back.stand, load.centre) >= 16.0 - 1e-9
    # It supports the full foot of the mount.
    low, high = back.stand.corners.min(axis=0), back.stand.corners.max(axis=0)
    assert high[1] >= device.mount.foot.edge_y_mm
    assert low[1] <= device.mount.foot.back_y_mm
    assert high[0] == -low[0] >= device.mount.half_width_mm


def test_it_is_one_solid_under_the_mounts_foot(device: Device) -> None:
    back = planned_back(device, DeskBack())
    (part,) = back.parts
    solid = MAKERS[type(part.plan)](part.plan)
    assert solid.is_valid
    box = solid.bounding_box()
    assert pytest.approx(device.mount.foot.z_mm) == box.max.Z
    assert back.stand is not None
    assert pytest.approx(back.stand.z_mm) == box.min.Z
    heads = back.foot_heads + np.array([0.0, 0.0, back.foot.grip_mm])
    np.testing.assert_allclose(heads, device.mount.foot.screws)
    # The nut is under the mount's foot, which retains it.
    (nut,) = back.items
    x, y, _ = nut.rig_from_item[:3, 3]
    assert abs(x) + 6.5 < device.mount.half_width_mm
    assert device.mount.foot.back_y_mm < y - 5.7 < y + 5.7 < device.mount.foot.front_y_mm


def test_the_plate_is_under_the_foot_and_its_screw_holds(device: Device) -> None:
    back = planned_back(device, TripodBack())
    (part,) = back.parts
    low, high = part.plan.corners.min(axis=0), part.plan.corners.max(axis=0)
    assert high[0] == -low[0] == device.mount.half_width_mm
    assert high[1] == device.mount.foot.front_y_mm + FRONT_MM
    assert MAKERS[type(part.plan)](part.plan).is_valid
    (nut,) = back.items
    under = nut.rig_from_item[2, 3] - nut.length_mm - low[2]
    assert (TripodBack().nut.screw_mm - under) / thread_of("1/4-20 UNC").pitch_mm >= 3.0
    (support,) = back.supports
    assert max(solid.top[:, 2].max() for solid in support.solids) == pytest.approx(low[2])
    np.testing.assert_allclose(nut.rig_from_item[:3, 2], [0.0, 0.0, 1.0])


@pytest.mark.parametrize("fit_mm", [0.1, -0.2])
def test_the_section_is_that_of_a_dovetail(device: Device, fit_mm: float) -> None:
    back = planned_back(device, ArcaBack(fit_mm=fit_mm))
    (part,) = back.parts
    tail = blocks_of(part).pieces[0]
    section = np.unique(tail.base[:, 1:].round(9), axis=0)
    assert np.ptp(section[:, 0]) == pytest.approx(38.0 - 2.0 * fit_mm)
    right = section[section[:, 0] > section[:, 0].mean()]
    edge, over = right[np.argsort(right[:, 1])][1:]
    assert over[1] - edge[1] == pytest.approx(edge[0] - over[0])
    solid = MAKERS[type(part.plan)](part.plan)
    assert solid.is_valid
    assert pytest.approx(11.0) == solid.bounding_box().size.Z
    assert back.items == ()


def test_a_slope_higher_than_the_dovetail_is_refused(device: Device) -> None:
    load = carried_load(device.mount, device.clip, device.hardware)
    with pytest.raises(InputError, match=r"dovetail's slope ends 10\.4 mm above its lower face, expected less than"):
        plan_arca(ArcaBack(neck_mm=20.0, height_mm=10.0), device.mount.foot, load, device.hardware)


def test_two_screws_hold_in_the_slot_beside_the_mount(device: Device) -> None:
    table = ProfileBack()
    back = planned_back(device, table)
    (part,) = back.parts
    assert MAKERS[type(part.plan)](part.plan).is_valid
    screws = [item for item in back.items if item.kind == "screw"]
    nuts = [item for item in back.items if item.kind == "nut"]
    assert len(screws) == len(nuts) == 2
    (profile,) = back.supports[0].solids
    corners = np.vstack([profile.base, profile.top])
    assert np.ptp(corners[:, 1]) == pytest.approx(20.0)
    for screw, nut in zip(screws, nuts, strict=True):
        head, seat = screw.rig_from_item[:3, 3], nut.rig_from_item[:3, 3]
        np.testing.assert_allclose(head[:2], seat[:2])
        assert head[1] == pytest.approx(corners[:, 1].mean())
        assert abs(head[0]) - 4.75 > device.mount.half_width_mm
        # The tip ends in the nut, above the bottom of a slot 5.5 mm deep.
        assert seat[2] - nut.length_mm <= head[2] - screw.length_mm + 1e-9 < seat[2]
        assert corners[:, 2].max() - (head[2] - screw.length_mm) <= 6.0 + 1e-9
