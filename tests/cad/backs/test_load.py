"""What a back carries, by the plans: no less than the parts weigh, about the same point."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.cad.assembly.device_plan import Device
from mirrorcam.cad.backs.load import carried
from tests.cad.conftest import Built


def test_the_load_is_that_of_the_parts_as_made(device: Device, built_default: Built) -> None:
    load = carried(device.mount, device.clip, device.hardware)
    checks = built_default[2]
    mass = checks["device.mass_g"].value
    centre = [checks[f"device.centre_{axis}_mm"].value for axis in "xyz"]
    assert 0.95 * mass < load.mass_g < 1.3 * mass
    # The foot is in the one and not in the other.
    np.testing.assert_allclose(load.at, centre, atol=12.0)


def test_a_heavier_camera_pulls_the_load_to_itself(device: Device) -> None:
    heavy = device.hardware.replaced(camera=device.hardware.camera.replaced(mass_g=1e6))
    load = carried(device.mount, device.clip, heavy)
    assert load.mass_g == pytest.approx(1e6, rel=1e-3)
    low, high = (np.array(corner) for corner in heavy.camera.box_mm)
    np.testing.assert_allclose(load.at, (low + high) / 2.0, atol=0.1)
