"""Solids of bought items: the volumes of their formulas."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.cad.assembly.bought_solids import item_solid
from mirrorcam.cad.plan.part_plan import BoughtKind
from tests.cad.assembly.bought import item


@pytest.mark.parametrize(
    ("kind", "size", "length", "volume"),
    [
        ("screw", "M3", 12.0, np.pi * (1.5**2 * 12.0 + 2.75**2 * 3.0)),
        ("insert", "M3", 5.7, np.pi * (2.0**2 - 1.5**2) * 5.7),
        ("nut", "M3", 2.4, (np.sqrt(3.0) / 2.0 * 5.5**2 - np.pi * 1.5**2) * 2.4),
        ("pin", "3", 16.0, np.pi * 1.5**2 * 16.0),
    ],
)
def test_fasteners_have_the_volume_of_their_formula(kind: BoughtKind, size: str, length: float, volume: float) -> None:
    assert item_solid(item(kind, size, length)).volume == pytest.approx(volume, rel=1e-9)


def test_a_size_without_a_diameter_is_refused() -> None:
    with pytest.raises(ValueError, match="expected one like M3"):
        item_solid(item("pin", "steel", 16.0))
