"""Dimensions that plans offer to their drawings: pieces those of the whole, holders their holes, others none."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from mirrorcam.cad.assembly.device_plan import Device
from mirrorcam.cad.guide.plan_dimensions import offered
from mirrorcam.cad.plan.cuts import PiecePlan
from mirrorcam.cad.plan.dimension import Hole
from mirrorcam.cad.plan.part_plan import PartPlan


def test_a_piece_offers_the_dimensions_of_the_whole(block: Callable[..., PartPlan]) -> None:
    part = block()
    piece = PiecePlan(
        part.plan, part.make, np.eye(4), (0.0, 0.0, 0.0), (9.0, 9.0, 9.0), np.zeros((0, 4, 4)), (3.0, 8.0), 1.2
    )
    assert len(offered(piece)) == len(offered(part.plan)) == 3
    assert offered("a plan without dimensions") == ()


def test_a_holder_offers_its_four_holes_on_the_back(device: Device) -> None:
    holes = [dimension for dimension in offered(device.holder) if isinstance(dimension, Hole)]
    assert len(holes) == 4
    away, origin = device.holder.rig_from_mount[:3, 2], device.holder.rig_from_mount[:3, 3]
    for hole in holes:
        assert abs((hole.centre_in_rig - origin) @ away) < 0.1
        assert abs(hole.axis_in_rig @ away) > 1.0 - 1e-9
