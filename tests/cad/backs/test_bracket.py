"""Brackets: one solid on the foot's screws, whose plate is where it is asked for."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.cad.assembly.device_plan import Device
from mirrorcam.cad.backs.back_solids import MAKERS
from mirrorcam.cad.backs.bracket import plan_bracket
from mirrorcam.cad.backs.plan_backs import plan_back


def test_a_bracket_reaches_from_the_foot_to_below_its_middle(device: Device) -> None:
    bracket = plan_bracket("part", 40.0, (30.0, 20.0, 8.0), 25.0, (), 5.5, device.mount, device.hardware)
    foot_z = device.mount.foot_z_mm
    assert bracket.middle[2] == pytest.approx(foot_z - 40.0)
    solid = MAKERS[type(bracket.plan)](bracket.plan)
    assert solid.is_valid
    box = solid.bounding_box()
    np.testing.assert_allclose([box.min.Z, box.max.Z], [foot_z - 60.0, foot_z], atol=1e-6)
    np.testing.assert_allclose([box.min.Y, box.max.Y], [bracket.middle[1], device.clip.slide_y_mm], atol=1e-6)
    assert bracket.front_mm - bracket.middle[1] == pytest.approx(8.0)
    assert bracket.neck.stress_mpa(12.0, np.array([0.0, 0.0, 30.0])) < 5.0
    assert plan_back(device.clip, device.mount, device.hardware).kind == "none"
