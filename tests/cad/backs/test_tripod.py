"""The tripod plate: no larger than the mount's foot but for a wall behind it, with its nut under the mount."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.cad.assembly.device_plan import Device
from mirrorcam.cad.backs.back_solids import MAKERS
from mirrorcam.cad.backs.plan_backs import plan_back
from mirrorcam.cad.backs.tripod import BEFORE_MM
from mirrorcam.cad.plan.back_table import TripodBack
from mirrorcam.cad.plan.fasteners import thread_of


def test_the_plate_is_under_the_foot_and_its_screw_holds(device: Device) -> None:
    back = plan_back(device.clip, device.mount, device.hardware.replaced(back=TripodBack()))
    (part,) = back.parts
    low, high = part.plan.corners.min(axis=0), part.plan.corners.max(axis=0)
    assert high[0] == -low[0] == device.mount.half_width_mm
    assert high[1] == device.mount.slide[1] + BEFORE_MM
    assert MAKERS[type(part.plan)](part.plan).is_valid
    (nut,) = back.items
    under = nut.rig_from_item[2, 3] - nut.length_mm - low[2]
    assert (TripodBack().nut.screw_mm - under) / thread_of("1/4-20 UNC").pitch_mm >= 3.0
    (carrier,) = back.carriers
    assert max(solid.top[:, 2].max() for solid in carrier.solids) == pytest.approx(low[2])
    np.testing.assert_allclose(nut.rig_from_item[:3, 2], [0.0, 0.0, 1.0])
