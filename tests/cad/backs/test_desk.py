"""The desk foot: a device on it stands, whatever it carries."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.cad.assembly.device_plan import Device
from mirrorcam.cad.backs.back_solids import MAKERS
from mirrorcam.cad.backs.desk import plan_desk
from mirrorcam.cad.backs.load import Load, carried
from mirrorcam.cad.checks.back_checks import tips_at_deg
from mirrorcam.cad.plan.back_table import DeskBack


@pytest.mark.parametrize("at", [None, (-1.0, 60.0, 80.0), (40.0, -80.0, 150.0)])
def test_the_plate_reaches_as_far_as_the_device_may_be_tipped(
    device: Device, at: tuple[float, float, float] | None
) -> None:
    load = carried(device.mount, device.clip, device.hardware) if at is None else Load(500.0, np.array(at))
    table = DeskBack(tip_deg=12.0, spare_deg=4.0)
    back = plan_desk(table, device.mount, load, device.hardware)
    assert back.stand is not None
    assert tips_at_deg(back.stand, load.at) >= 16.0 - 1e-9
    # All of the mount's foot stands on it.
    low, high = back.stand.corners.min(axis=0), back.stand.corners.max(axis=0)
    assert high[1] >= device.mount.slide[1]
    assert low[1] <= device.mount.slide[1] - device.mount.section.depth_mm
    assert high[0] == -low[0] >= device.mount.half_width_mm


def test_it_is_one_solid_under_the_mounts_foot(device: Device) -> None:
    (part,) = device.back.parts
    solid = MAKERS[type(part.plan)](part.plan)
    assert solid.is_valid
    box = solid.bounding_box()
    assert pytest.approx(device.mount.foot_z_mm) == box.max.Z
    assert device.back.stand is not None
    assert pytest.approx(device.back.stand.z_mm) == box.min.Z
    heads = device.back.foot_heads + np.array([0.0, 0.0, device.back.foot.grip_mm])
    np.testing.assert_allclose(heads, device.mount.foot)
    # The nut lies under the mount's foot, which keeps it in.
    (nut,) = device.back.items
    x, y, _ = nut.rig_from_item[:3, 3]
    assert abs(x) + 6.5 < device.mount.half_width_mm
    assert device.mount.slide[1] - device.mount.section.depth_mm < y - 5.7 < y + 5.7 < device.mount.slide[1]
