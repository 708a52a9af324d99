"""Carriers: pads at their mirrors, holes that end below them, a notch that says which way is up."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.cad.plan.prisms import overlap_mm
from mirrorcam.cad.plan.seats import mirror_prism
from tests.cad.holder.screwed import pair, planned


@pytest.mark.parametrize("kind", ["insert", "nut"])
def test_pads_are_at_the_mirrors_back_and_holes_end_below_it(kind: str) -> None:
    plan, layout = planned(kind), pair()
    for mirror, carrier in zip(layout.mirrors, plan.carriers, strict=True):
        normal, distance = mirror.normal_in_rig, mirror.distance_mm
        assert len(carrier.pads) == 3
        for pad in carrier.pads:
            assert np.abs(pad.top @ normal + distance - mirror.back_mm).max() < 1e-9
        for hole in carrier.holes:
            end = hole.mouth + hole.depth_mm * hole.axis
            assert end @ normal + distance < mirror.back_mm - 0.5
        assert len(carrier.nuts) == (3 if kind == "nut" else 0)
        assert 0.4 < carrier.planned_cover < 1.0
        assert overlap_mm(carrier.body, mirror_prism(mirror)) < 1e-6


def test_the_notch_is_at_the_edge_that_is_uppermost_in_the_device() -> None:
    layout, plan = pair(), planned()
    up = -layout.view_from_rig[1]
    for carrier in plan.carriers:
        notch, middle = carrier.grooves[-1], carrier.body.base.mean(axis=0)
        away = carrier.rig_from_back[:3, 2]
        way = notch.base.mean(axis=0) - middle
        way = way - (way @ away) * away
        flat = up - (up @ away) * away
        assert way @ flat > 0.9 * np.linalg.norm(way) * np.linalg.norm(flat)
