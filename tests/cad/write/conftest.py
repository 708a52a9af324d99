"""A bill of materials of two blocks and some fasteners."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.cad.assembly.bill import Bom, bill_of
from mirrorcam.cad.assembly.device_plan import Device
from mirrorcam.cad.mirrors.stock_sheets import plan_sheets
from mirrorcam.cad.plan.hardware import HARDWARE
from mirrorcam.cad.plan.part_plan import BoughtKind, BuiltPart, PurchasedItem
from mirrorcam.core.values import Metric


@pytest.fixture
def bom(device: Device, built_block: BuiltPart, monkeypatch: pytest.MonkeyPatch) -> Bom:
    items: list[tuple[BoughtKind, float, tuple[str, ...]]] = [
        *(("screw", 8.0, ("mount", "mirror_holder")),) * 4,
        *(("screw", 12.0, ("camera_clip", "mount")),) * 2,
        ("screw", 8.0, ("adapter_cap",)),
        *(("insert", 5.7, ("mirror_holder",)),) * 4,
    ]
    bought = tuple(PurchasedItem(kind, "M3", length, np.eye(4), np.zeros(3), joins) for kind, length, joins in items)
    monkeypatch.setattr("mirrorcam.cad.assembly.bill.purchased_items", lambda _: bought)
    sliced = {"print_minutes": Metric(value=75.4, unit="min"), "print_g": Metric(value=9.5, unit="g")}
    parts = [built_block.replaced(checks=sliced), built_block.replaced(name="other", number="MC-98", checks=sliced)]
    return bill_of(device, parts, plan_sheets(device.layout, HARDWARE.cutting))
