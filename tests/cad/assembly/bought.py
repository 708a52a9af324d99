"""A purchased item for tests of the assembly."""

from __future__ import annotations

import numpy as np

from mirrorcam.cad.plan.part_plan import BoughtKind, PurchasedItem
from mirrorcam.core.values import FloatArray


def item(kind: BoughtKind, size: str, length_mm: float, place: FloatArray | None = None) -> PurchasedItem:
    return PurchasedItem(
        kind=kind,
        size=size,
        length_mm=length_mm,
        rig_from_item=np.eye(4) if place is None else place,
        explode_mm=np.array([1.0, 2.0, 3.0]),
        joins=("mirror_holder",),
    )
