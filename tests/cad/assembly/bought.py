"""A bought item for tests of the assembly."""

from __future__ import annotations

import numpy as np

from mirrorcam.cad.assembly.pieces import Kind
from mirrorcam.cad.plan.part_plan import BoughtItem
from mirrorcam.optics.base.values import FloatArray


def item(kind: Kind, size: str, length_mm: float, place: FloatArray | None = None) -> BoughtItem:
    return BoughtItem(
        kind=kind,  # type: ignore[arg-type]  # all kinds but the printed ones
        size=size,
        length_mm=length_mm,
        rig_from_item=np.eye(4) if place is None else place,
        explode_mm=np.array([1.0, 2.0, 3.0]),
        joins=("mirror_holder",),
    )
