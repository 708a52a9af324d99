"""Areas of carriers: within their mirrors, with three screws each, clear of the mount's screws.

Carriers: pads at their mirrors, holes that end below these, a notch that marks the upper edge.

Turns of screws to motions of a mirror, and back, against rigid motions and closed forms.
"""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from shapely import Point, Polygon

from mirrorcam.cad.holder.adjuster import boss_mm
from mirrorcam.cad.holder.back import mount_axes
from mirrorcam.cad.holder.carriers import (
    plan_areas,
    rig_from_carrier,
    rotation_about,
    tilt_and_shift,
    tilt_per_turn_deg,
    travel_turns,
    turns_to,
    virtual_centre_after,
)
from mirrorcam.cad.plan.fasteners import Bore, Countersink
from mirrorcam.cad.plan.prisms import overlap_mm
from mirrorcam.cad.plan.seats import mirror_prism
from mirrorcam.core.errors import InputError
from mirrorcam.optics.geometry.layout import Layout
from tests.cad.holder.screwed import pair, planned, with_screws
from tests.cad.parabolas import parabola


def test_a_carrier_ends_within_its_mirror_and_bears_three_screws(default_layout: Layout) -> None:
    axes, hardware = mount_axes(default_layout), with_screws()
    _, areas = plan_areas(default_layout, axes, [Polygon()], hardware)
    for mirror, area in zip(default_layout.mirrors, areas, strict=True):
        # A first-surface mirror reaches back from its outline, along its normal.
        outline = Polygon((mirror.outline_in_rig_mm - mirror.thickness_mm * mirror.normal_in_rig) @ axes[:2].T)
        carrier = Polygon(area.corners)
        assert outline.contains(carrier)
        assert Polygon(area.screws).contains(carrier.centroid)
        for screw in area.screws:
            assert carrier.buffer(1e-6).contains(Point(screw).buffer(boss_mm(hardware) - 1e-3))
    for first, second in combinations(areas, 2):
        assert Polygon(first.corners).distance(Polygon(second.corners)) > 1.0


def test_the_first_mount_position_that_leaves_space_is_chosen(default_layout: Layout) -> None:
    axes, hardware = mount_axes(default_layout), with_screws()
    everywhere = Point(0.0, 0.0).buffer(1e3)
    place, areas = plan_areas(default_layout, axes, [everywhere, Polygon()], hardware)
    assert place == 1
    beside = Point(areas[0].screws[0]).buffer(1.0)
    _, moved = plan_areas(default_layout, axes, [beside], hardware)
    assert not any(beside.contains(Point(screw)) for screw in moved[0].screws)
    with pytest.raises(InputError, match=r"no space .* next to the mount's screws, or holder\.mirrors"):
        plan_areas(default_layout, axes, [everywhere], hardware)


@pytest.mark.parametrize("kind", ["insert", "nut"])
def test_a_mirror_too_small_for_three_screws_is_refused_with_what_would_fit(kind: str) -> None:
    layout = parabola(2, 2, scale_mm=36.0)
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
        assert len(carrier.tips) == (3 if kind == "insert" else 0)
        bores: list[Bore | Countersink] = [*carrier.holes, *carrier.tips]
        for hole in bores:
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


CARRIERS = list(zip(pair().mirrors, planned().carriers, strict=True))


def test_equal_turns_of_all_screws_shift_a_mirror_straight_towards_the_holder() -> None:
    for mirror, carrier in CARRIERS:
        motion = rig_from_carrier(carrier, np.array([0.4, 0.4, 0.4]))
        assert np.allclose(motion[:3, :3], np.eye(3))
        assert np.allclose(motion[:3, 3], 0.4 * carrier.pitch_mm * carrier.rig_from_back[:3, 2])
        moved = virtual_centre_after(mirror.virtual_centre_in_rig_mm, carrier, np.array([0.4, 0.4, 0.4]))
        along = -mirror.normal_in_rig @ carrier.rig_from_back[:3, 2]
        assert tilt_and_shift(moved, mirror.virtual_centre_in_rig_mm) == pytest.approx(
            (0.0, 0.4 * carrier.pitch_mm * along)
        )


def test_one_screw_tilts_by_the_pitch_over_the_triangles_altitude() -> None:
    for mirror, carrier in CARRIERS:
        tilts = []
        for turns in np.eye(3):
            moved = virtual_centre_after(mirror.virtual_centre_in_rig_mm, carrier, turns)
            tilts.append(tilt_and_shift(moved, mirror.virtual_centre_in_rig_mm)[0])
        # The mirror is not parallel to the back, so that its normal rotates by slightly less.
        assert 0.9 * tilt_per_turn_deg(carrier) < max(tilts) <= 1.001 * tilt_per_turn_deg(carrier)


@pytest.mark.parametrize("seed", range(5))
def test_turns_are_recovered_from_the_planes_alone(seed: int) -> None:
    rng = np.random.default_rng(seed)
    for mirror, carrier in CARRIERS:
        turns = rng.uniform(-1.0, 1.0, 3)
        moved = virtual_centre_after(mirror.virtual_centre_in_rig_mm, carrier, turns)
        assert turns_to(mirror.virtual_centre_in_rig_mm, moved, carrier) == pytest.approx(turns, abs=1e-9)


def test_a_mirror_tilted_by_a_degree_comes_back_to_its_design() -> None:
    """From any plane, the calculated turns lead to the target plane."""
    rng = np.random.default_rng(7)
    for mirror, carrier in CARRIERS:
        wanted = mirror.virtual_centre_in_rig_mm
        axis = rng.normal(size=3)
        turned = rotation_about(axis / np.linalg.norm(axis), np.radians(1.0))
        measured = 1.004 * turned @ wanted
        turns = turns_to(measured, wanted, carrier)
        assert np.abs(virtual_centre_after(measured, carrier, turns) - wanted).max() < 1e-9
        assert np.abs(turns).max() < 3.0
        assert turns_to(wanted, wanted, carrier) == pytest.approx(np.zeros(3), abs=1e-9)


def test_the_travel_is_in_turns_of_the_thread() -> None:
    screw = planned().adjuster
    assert travel_turns(screw) * 0.5 == pytest.approx(screw.travel_mm)
