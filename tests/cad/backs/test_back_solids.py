"""Solids of backs: a maker for every kind of plan, each of which makes its part anew of the same numbers."""

from __future__ import annotations

from mirrorcam.cad.backs.back_solids import MAKERS, make_blocks
from mirrorcam.cad.backs.blocks import BlocksPlan
from mirrorcam.cad.plan.prisms import box


def test_blocks_are_joined_and_cut() -> None:
    pieces = (box((0.0, 0.0, 0.0), (10.0, 10.0, 10.0)), box((5.0, 0.0, 0.0), (20.0, 10.0, 10.0)))
    part = make_blocks(BlocksPlan("part", pieces, (box((2.0, 2.0, -1.0), (4.0, 4.0, 11.0)),)))
    assert part.label == "part"
    assert abs(part.volume - (2000.0 - 40.0)) < 1e-6


def test_every_plan_has_a_maker() -> None:
    assert {plan.__name__ for plan in MAKERS} == {"RingPlan", "BlocksPlan"}
