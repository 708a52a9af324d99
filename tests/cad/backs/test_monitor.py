"""Hook and jaw: they clamp any monitor in their range, and the device is above it."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.cad.assembly.device_plan import Device
from mirrorcam.cad.backs.back import carried_load
from mirrorcam.cad.backs.plan_backs import MAKERS
from mirrorcam.cad.plan.back_table import MonitorBack
from mirrorcam.cad.plan.fasteners import Bore
from mirrorcam.cad.plan.prisms import corners_of, overlap_mm
from mirrorcam.cad.plan.seats import Frustum
from mirrorcam.core.errors import InputError
from tests.cad.backs.planned_blocks import blocks_of, planned_back


@pytest.mark.parametrize("thick_mm", [8.0, 20.0, 40.0])
def test_the_jaw_meets_the_back_of_the_monitor_and_enters_nothing(device: Device, thick_mm: float) -> None:
    back = planned_back(device, MonitorBack(thick_mm=thick_mm))
    hook, jaw = (blocks_of(part) for part in back.parts)
    (monitor,) = back.supports[0].solids
    corners = np.vstack([monitor.base, monitor.top])
    assert np.ptp(corners[:, 1]) == pytest.approx(thick_mm)
    assert jaw.corners[:, 1].max() == pytest.approx(corners[:, 1].min())
    solids: list[tuple[Frustum, ...]] = [hook.pieces, jaw.pieces, (monitor,)]
    for first, second in ((0, 1), (0, 2), (1, 2)):
        assert max(overlap_mm(a, b) for a in solids[first] for b in solids[second]) < 1e-6
    # The screen is near the centre of mass, and neither hook nor pad is below the heads of the foot's screws.
    load = carried_load(device.mount, device.clip, device.hardware)
    assert abs(corners[:, 1].max() - load.centre[1]) < 15.0
    _, pad, hook_wall = hook.pieces
    for head in back.foot_heads[:, 1]:
        for piece in (pad, hook_wall):
            low, high = corners_of((piece,))[:, 1].min(), corners_of((piece,))[:, 1].max()
            assert head < low - 3.8 or head > high + 3.8
    # The jaw's screws are in the slots, at both ends of their range.
    slots = [cut for cut in hook.cuts if isinstance(cut, Bore) and cut.travel_mm]
    assert len(slots) == 2
    for item in back.items:
        if item.kind == "screw":
            y = item.rig_from_item[1, 3]
            assert all(abs(y - slot.mouth[1]) <= slot.travel_mm / 2.0 + 1e-9 for slot in slots)
    for part in back.parts:
        assert MAKERS[type(part.plan)](part.plan).is_valid


def test_a_monitor_out_of_its_range_is_refused(device: Device) -> None:
    with pytest.raises(InputError, match=r"monitor is 60 mm thick, expected 8 to 40 mm"):
        planned_back(device, MonitorBack(thick_mm=60.0))
