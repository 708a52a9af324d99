"""Dimensions of holes among the cuts of a part."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mirrorcam.cad.plan.fasteners import Bore
from mirrorcam.cad.plan.hole_dimensions import holes


def test_holes_are_read_from_the_cuts_without_the_drivers_ways() -> None:
    down, at = np.array([0.0, 0.0, -1.0]), np.array([5.0, 0.0, 3.0])
    screw, driver = Bore(at, down, 1.7, 4.0), Bore(at + 4.0 * down, -down, 3.2, 99.0)
    slot = Bore(np.zeros(3), down, 1.7, 4.0, np.array([1.0, 0.0, 0.0]), 8.0)
    found = holes((screw, driver, slot, "another cut"))
    assert [(hole.diameter_mm, hole.text) for hole in found] == [(3.4, ""), (3.4, "slot, 8 travel")]
    # Beside the screw, the same wide bore is a hole of its own.
    assert len(holes((screw, replace(driver, mouth=np.array([9.0, 0.0, 0.0]))))) == 2
