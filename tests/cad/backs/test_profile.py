"""The profile plate: screws in the slot's middle, beside the mount, whose nuts lie in the slot."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.cad.assembly.device_plan import Device
from mirrorcam.cad.backs.back_solids import MAKERS
from mirrorcam.cad.backs.plan_backs import plan_back
from mirrorcam.cad.plan.back_table import ProfileBack


def test_two_screws_hold_in_the_slot_beside_the_mount(device: Device) -> None:
    table = ProfileBack()
    back = plan_back(device.clip, device.mount, device.hardware.replaced(back=table))
    (part,) = back.parts
    assert MAKERS[type(part.plan)](part.plan).is_valid
    screws = [item for item in back.items if item.kind == "screw"]
    nuts = [item for item in back.items if item.kind == "nut"]
    assert len(screws) == len(nuts) == 2
    (profile,) = back.carriers[0].solids
    corners = np.vstack([profile.base, profile.top])
    assert np.ptp(corners[:, 1]) == pytest.approx(20.0)
    for screw, nut in zip(screws, nuts, strict=True):
        head, seat = screw.rig_from_item[:3, 3], nut.rig_from_item[:3, 3]
        np.testing.assert_allclose(head[:2], seat[:2])
        assert head[1] == pytest.approx(corners[:, 1].mean())
        assert abs(head[0]) - 4.75 > device.mount.half_width_mm
        # The tip ends in the nut, and above the bottom of a slot that is 5.5 mm deep.
        assert seat[2] - nut.length_mm <= head[2] - screw.length_mm + 1e-9 < seat[2]
        assert corners[:, 2].max() - (head[2] - screw.length_mm) <= 6.0 + 1e-9
