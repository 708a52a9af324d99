"""The VESA bracket: four nuts on the square, which the screws of the arm reach through its plate."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.cad.assembly.device_plan import Device
from mirrorcam.cad.backs.back_solids import MAKERS
from mirrorcam.cad.backs.plan_backs import plan_back
from mirrorcam.cad.plan.back_table import VesaBack


@pytest.mark.parametrize("square_mm", [75.0, 100.0])
def test_four_screws_on_the_square_end_just_beyond_their_nuts(device: Device, square_mm: float) -> None:
    back = plan_back(device.clip, device.mount, device.hardware.replaced(back=VesaBack(square_mm=square_mm)))
    (part,) = back.parts
    assert MAKERS[type(part.plan)](part.plan).is_valid
    screws = [item for item in back.items if item.kind == "screw"]
    nuts = [item for item in back.items if item.kind == "nut"]
    places = np.array([item.rig_from_item[:3, 3] for item in screws])
    assert np.ptp(places, axis=0)[[0, 2]] == pytest.approx([square_mm, square_mm])
    for screw, nut in zip(screws, nuts, strict=True):
        tip = screw.rig_from_item[:3, 3] - screw.length_mm * screw.rig_from_item[:3, 2]
        far = nut.rig_from_item[:3, 3] - nut.length_mm * nut.rig_from_item[:3, 2]
        assert 0.0 <= tip[1] - far[1] <= 2.0
