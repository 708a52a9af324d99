"""Areas of carriers: within their mirrors, with three screws each, beside the mount's screws.

Carriers: pads at their mirrors, holes that end below them, a notch that says which way is up.
"""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from shapely import Point, Polygon

from mirrorcam.cad.holder.adjuster import boss_mm
from mirrorcam.cad.holder.back import mount_axes
from mirrorcam.cad.holder.carriers import plan_areas
from mirrorcam.cad.plan.prisms import overlap_mm
from mirrorcam.cad.plan.seats import mirror_prism
from mirrorcam.core.values import InputError
from mirrorcam.optics.geometry.layout import Layout
from tests.cad.holder.screwed import pair, planned, with_screws
from tests.cad.parabolas import parabola


def test_a_carrier_ends_within_its_mirror_and_bears_three_screws(default_layout: Layout) -> None:
    axes, hardware = mount_axes(default_layout), with_screws()
    _, areas = plan_areas(default_layout, axes, [Polygon()], hardware)
    for mirror, area in zip(default_layout.mirrors, areas, strict=True):
        outline = Polygon(mirror.outline_in_rig_mm @ axes[:2].T)
        carrier = Polygon(area.corners)
        assert outline.contains(carrier)
        assert Polygon(area.screws).contains(carrier.centroid)
        for screw in area.screws:
            assert carrier.buffer(1e-6).contains(Point(screw).buffer(boss_mm(hardware) - 1e-3))
    for first, second in combinations(areas, 2):
        assert Polygon(first.corners).distance(Polygon(second.corners)) > 1.0


def test_the_first_place_of_the_mount_that_leaves_space_is_taken(default_layout: Layout) -> None:
    axes, hardware = mount_axes(default_layout), with_screws()
    everywhere = Point(0.0, 0.0).buffer(1e3)
    place, areas = plan_areas(default_layout, axes, [everywhere, Polygon()], hardware)
    assert place == 1
    beside = Point(areas[0].screws[0]).buffer(1.0)
    _, moved = plan_areas(default_layout, axes, [beside], hardware)
    assert not any(beside.contains(Point(screw)) for screw in moved[0].screws)
    with pytest.raises(InputError, match=r"no space .* more beside the mount's own screws, or holder\.mirrors"):
        plan_areas(default_layout, axes, [everywhere], hardware)


@pytest.mark.parametrize("kind", ["insert", "nut"])
def test_a_mirror_too_small_for_three_screws_is_refused_with_what_would_fit(kind: str) -> None:
    layout = parabola(2, 2, scale_mm=40.0)
    with pytest.raises(
        InputError, match=r"mirror 1-0 .* expected mirrors 1\.\d\d times as large, or .*glue"
    ) as refused:
        plan_areas(layout, mount_axes(layout), [Polygon()], with_screws(kind))
    assert len(str(refused.value)) <= 300
    larger = parabola(2, 2, scale_mm=60.0)
    assert len(plan_areas(larger, mount_axes(larger), [Polygon()], with_screws(kind))[1]) == 4


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
