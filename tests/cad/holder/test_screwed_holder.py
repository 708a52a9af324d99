"""A holder with carriers: a level plate behind all of them, separate holes, and mirrors as in the layout."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

from mirrorcam.cad.holder.adjuster import DRIVER_HOLE_ENDS_MM, head_diameter_mm
from mirrorcam.cad.holder.holder_body import body_of
from mirrorcam.cad.holder.holder_solid import make_screwed_holder
from mirrorcam.cad.holder.planar_csg import PlanarCsg
from mirrorcam.cad.holder.screwed_holder import ScrewedHolderPlan, plan_screwed_holder
from mirrorcam.cad.plan.fasteners import ROOF_IN_WEBS_DEG, head_space_mm
from mirrorcam.cad.plan.part_plan import plain
from mirrorcam.cad.plan.prisms import volume_mm3
from mirrorcam.core.errors import InputError
from mirrorcam.optics.geometry.transforms import inverse, transform
from tests.cad.holder.screwed import pair, planned, with_screws


@pytest.mark.parametrize("kind", ["insert", "nut"])
def test_carriers_are_a_gap_above_a_level_plate(kind: str) -> None:
    plan = planned(kind)
    mount_from_rig = inverse(plan.rig_from_mount)
    fronts = transform(mount_from_rig, plan.slab.top)[:, 2]
    assert np.allclose(fronts, -plan.adjuster.plate_mm)
    for carrier in plan.carriers:
        back = transform(mount_from_rig, carrier.body.base)[:, 2]
        assert np.allclose(back, -plan.adjuster.plate_mm - plan.adjuster.gap_mm)


def test_holes_of_all_screws_are_apart_in_the_holder_and_in_the_mount() -> None:
    plan, hardware = planned(), with_screws()
    heads = plan.screws_in_mount_mm
    assert min(np.linalg.norm(a - b) for a, b in combinations(heads, 2)) > head_diameter_mm("M3")
    wall, (low, high) = hardware.printer.wall_mm, DRIVER_HOLE_ENDS_MM
    room = head_space_mm(hardware)
    roof = room / np.sin(np.radians(ROOF_IN_WEBS_DEG))
    for hole in plan.holes_in_mount_mm:
        for x, y in heads - hole:
            assert np.hypot(x, y) >= room - low + wall - 1e-2
            # One above the other in the mount's print: a roof, and a wall over it.
            if abs(y) < 1.0:
                assert x > roof - low or x < -room - high


def test_the_solid_is_one_with_all_its_holes() -> None:
    plan = planned()
    part = make_screwed_holder(plan)
    assert part.is_valid
    assert len(part.solids()) == 1
    # Holes of six screws: their cones, shanks and recesses; and four holes for the mount.
    screw = plan.adjuster
    recess = np.pi / 4.0 * screw.recess_wide_mm**2 * screw.recess_mm
    shank = np.pi / 4.0 * 3.4**2 * (screw.plate_mm - screw.recess_mm - screw.cone_mm)
    cone = np.pi / 12.0 * screw.cone_mm * (screw.head_mm**2 + 3.4 * screw.head_mm + 3.4**2)
    radius = plan.screw.insert_hole_mm / 2.0
    tip = (radius - 0.2) / np.tan(np.radians(42.0))
    insert = np.pi * radius**2 * plan.hole_depth_mm + np.pi / 3.0 * tip * (radius**2 + 0.2 * radius + 0.04)
    undrilled = make_screwed_holder_without_holes(plan)
    assert undrilled - part.volume == pytest.approx(6 * (recess + shank + cone) + 4 * insert, rel=0.01)


def make_screwed_holder_without_holes(plan: ScrewedHolderPlan) -> float:
    """Volume of a plan's body."""
    csg = PlanarCsg()
    return float(csg.cut(body_of(csg, plan), plan.slots).volume())


def test_a_holder_that_is_larger_than_the_bed_is_refused() -> None:
    hardware = with_screws()
    small = hardware.replaced(printer=hardware.printer.replaced(bed_mm=(80.0, 80.0, 200.0)))
    with pytest.raises(InputError, match=r"with screws is \d+ x \d+ mm, but must fit the printer's bed"):
        plan_screwed_holder(pair(), small)


def test_the_plan_is_plain_numbers_and_its_plastic_includes_the_carriers() -> None:
    plan = planned()
    assert plain(plan)["adjuster"]["length_mm"] in with_screws().screw.lengths_mm
    carriers = sum(volume_mm3(carrier.body) for carrier in plan.carriers)
    solid = make_screwed_holder_without_holes(plan) + carriers
    assert 0.3 * solid < plan.printed_mm3 < 0.9 * solid
    assert plan.screws_mm3 == pytest.approx(6 * np.pi * 1.5**2 * plan.adjuster.length_mm)
    assert len(plan.screw_holes) == len(plan.heads) == 6
