"""The dovetail: its width less the fit on both sides, its sides at 45 deg, its volume that of its section."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.cad.assembly.device_plan import Device
from mirrorcam.cad.backs.arca import plan_arca
from mirrorcam.cad.backs.back_solids import MAKERS
from mirrorcam.cad.backs.load import carried
from mirrorcam.cad.backs.plan_backs import plan_back
from mirrorcam.cad.plan.back_table import ArcaBack
from mirrorcam.core.values import InputError
from tests.cad.backs.planned_blocks import blocks_of


@pytest.mark.parametrize("fit_mm", [0.1, -0.2])
def test_the_section_is_that_of_a_dovetail(device: Device, fit_mm: float) -> None:
    back = plan_back(device.clip, device.mount, device.hardware.replaced(back=ArcaBack(fit_mm=fit_mm)))
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
    load = carried(device.mount, device.clip, device.hardware)
    with pytest.raises(InputError, match=r"dovetail's slope ends 10\.4 mm over its lower face, expected less than"):
        plan_arca(ArcaBack(neck_mm=20.0, height_mm=10.0), device.mount, load, device.hardware)
