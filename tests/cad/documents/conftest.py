"""A small part with known edges, and a device of few pieces."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
from build123d import Box, BuildPart, Cylinder, Locations, Mode, Part

from mirrorcam.cad.plan.dimension import Hole, Length
from mirrorcam.cad.plan.part_plan import PartPlan


@dataclass(frozen=True)
class BlockPlan:
    """A block with two through holes along z, and its dimensions."""

    size_mm: tuple[float, float, float]
    hole_mm: float
    apart_mm: float

    @property
    def dimensions(self) -> tuple[Length | Hole, ...]:
        top = self.size_mm[2] / 2.0
        x = self.apart_mm / 2.0
        holes = tuple(
            Hole(np.array([side * x, 0.0, top]), np.array([0.0, 0.0, 1.0]), self.hole_mm, "through") for side in (-1, 1)
        )
        return (*holes, Length(np.array([[-x, 0.0, top], [x, 0.0, top]])))


def make_block(plan: BlockPlan) -> Part:
    with BuildPart() as block:
        Box(*plan.size_mm)
        with Locations((-plan.apart_mm / 2.0, 0.0), (plan.apart_mm / 2.0, 0.0)):
            Cylinder(plan.hole_mm / 2.0, plan.size_mm[2], mode=Mode.SUBTRACT)
    assert block.part is not None
    return block.part


def block_part(size_mm: tuple[float, float, float] = (60.0, 30.0, 10.0), hole_mm: float = 6.0) -> PartPlan:
    return PartPlan(
        name="block",
        title="Block",
        number="MC-99",
        plan=BlockPlan(size_mm, hole_mm, 40.0),
        make=make_block,
        print_from_rig=np.eye(4),
        explode_mm=np.zeros(3),
        rgb=(0.3, 0.4, 0.5),
    )


@pytest.fixture
def block() -> Callable[..., PartPlan]:
    return block_part
