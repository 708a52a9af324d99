"""What stands in the way of a dust cover, where it sits and as it is taken off."""

from __future__ import annotations

import numpy as np
import pytest
from manifold3d import Manifold

from mirrorcam.cad.assembly.device_plan import Device
from mirrorcam.cad.checks.cover_checks import STEP_MM, check_cover


@pytest.mark.parametrize(
    ("at", "failing"),
    [
        ((0.0, 0.0, -2.0), set()),
        ((0.0, 0.0, 0.5), {"dust_cover.clash_mm3"}),
        ((0.0, 0.0, 25.0), {"dust_cover.way_clash_mm3"}),
        ((40.0, 0.0, 30.0), {"dust_cover.way_clash_mm3"}),
        ((40.0, 0.0, 0.0), set()),
    ],
)
def test_what_the_cover_meets_is_found(device: Device, at: tuple[float, float, float], failing: set[str]) -> None:
    """A block of 10 mm, taken off along z by 30 mm and then along x by 60 mm; a cube of 2 mm is in the way, or not."""
    assert device.cover is not None
    plan = type(device.cover)(**{**vars(device.cover), "way_mm": np.array([(0.0, 0.0, 30.0), (60.0, 0.0, 0.0)])})
    block = Manifold.cube((10.0, 10.0, 10.0), center=True).translate((0.0, 0.0, 5.0))
    cube = Manifold.cube((2.0, 2.0, 2.0), center=True).translate(at)
    checks = check_cover(plan, block, {"cube": cube})
    assert {name for name, check in checks.items() if not check.passed} == failing
    assert STEP_MM < 10.0
