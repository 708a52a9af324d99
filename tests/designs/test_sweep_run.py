"""Designs of one structure are done one after the other, those of many mirrors first."""

from __future__ import annotations

from mirrorcam.designs.sweep_run import in_order
from mirrorcam.optics.design.spec_grid import structure
from mirrorcam.optics.geometry.design_spec import DesignSpec


def test_groups_hold_each_spec_once_and_begin_with_the_most_mirrors() -> None:
    specs = [DesignSpec(rows=r, cols=c, tradeoff=w) for w in (0.1, 0.5) for r, c in ((2, 2), (3, 3), (2, 3))]
    groups = in_order(specs)
    assert sorted(number for group in groups for number in group) == list(range(len(specs)))
    assert all(len({structure(specs[number]) for number in group}) == 1 for group in groups)
    counts = [specs[group[0]].rows * specs[group[0]].cols for group in groups]
    assert counts == [9, 6, 4]
