"""Parts of blocks: their holes against closed forms, and the nut of a tripod in its pocket."""

from __future__ import annotations

import numpy as np
import pytest
from build123d import GeomType

from mirrorcam.cad.assembly.components import item_solid
from mirrorcam.cad.backs.blocks import (
    CORNERS,
    HEAD_FIT_MM,
    BlocksPlan,
    Disc,
    countersunk_hole,
    countersunk_slot,
    faceted,
    ring,
    tripod_cuts,
    tripod_depth_mm,
    tripod_nut,
)
from mirrorcam.cad.backs.plan_backs import make_blocks
from mirrorcam.cad.plan.back_table import TripodNut
from mirrorcam.cad.plan.dimension import Hole, Length, length
from mirrorcam.cad.plan.hardware import HARDWARE
from mirrorcam.cad.plan.prisms import box, volume_mm3
from mirrorcam.cad.plan.threads import thread_of

PLATE = box((-20.0, -20.0, 0.0), (20.0, 20.0, 8.0))


def test_a_countersunk_hole_is_a_cylinder_under_a_cone_that_prints() -> None:
    cuts = countersunk_hole(np.array([0.0, 0.0, 0.5]), 7.5, 0.5, "M3", 0.5)
    removed = 40.0 * 40.0 * 8.0 - make_blocks(BlocksPlan("plate", (PLATE,), cuts)).volume
    # From the face to the hole for the screw; 42 deg print well.
    slope = np.tan(np.radians(42.0))
    wide, half = 2.24 * 1.5 + HEAD_FIT_MM + 0.5 * slope, 1.7
    cone = np.pi / 3.0 * (wide**3 - half**3) / slope
    assert removed == pytest.approx(cone + np.pi * half**2 * (8.0 - (wide - half) / slope), rel=2e-3)


def test_a_slot_for_a_countersunk_screw_takes_its_head_everywhere_and_prints_on_its_face() -> None:
    travel = 12.0
    slot, groove = countersunk_slot(np.array([0.0, 0.0, 8.0]), "M4", 8.0, travel)
    plate = make_blocks(BlocksPlan("plate", (PLATE,), (slot, groove)))
    from build123d import Align, Cone, Locations

    below = (Align.CENTER, Align.CENTER, Align.MAX)
    for y in (-travel / 2.0, 0.0, travel / 2.0):
        with Locations((0.0, y, 8.0)):
            # ISO 10642: 2.24 times as wide as the thread, 90 deg.
            head = Cone(2.0, 4.48, 2.48, align=below)
        common = plate & head
        assert common is None or common.volume < 1e-6
    # Only the side of the groove faces the bed, 42 deg from upright.
    inside = [face for face in plate.faces() if face.bounding_box().max.Z < 8.0 - 1e-6 or face.center().Z > 1e-6]
    steepest = max(face.normal_at().Z for face in inside if face.center().Z < 8.0 - 1e-6)
    assert steepest == pytest.approx(np.sin(np.radians(42.0)), abs=1e-3)


def test_the_nut_of_a_tripod_lies_flush_on_its_floor() -> None:
    nut, top = TripodNut(), np.array([3.0, -2.0, 8.0])
    item = tripod_nut(top, 8.0, nut, "plate", np.zeros(3))
    low = item.rig_from_item[2, 3] - item.length_mm
    assert low == pytest.approx(nut.floor_mm)
    assert item.rig_from_item[2, 3] <= 8.0
    assert item.exit_moves_mm[0, 2] > 8.0
    flush = tripod_depth_mm(nut)
    assert tripod_nut(np.array([0.0, 0.0, flush]), flush, nut, "plate", np.zeros(3)).rig_from_item[2, 3] < flush
    assert nut.screw_mm - nut.floor_mm >= 3.0 * thread_of("1/4-20 UNC").pitch_mm


def test_the_pocket_holds_the_nut_and_keeps_it_from_turning() -> None:
    nut, top = TripodNut(), np.array([3.0, -2.0, 8.0])
    plate = make_blocks(BlocksPlan("plate", (PLATE,), tripod_cuts(top, 8.0, nut)))
    item = tripod_nut(top, 8.0, nut, "plate", np.zeros(3))
    from build123d import Location, Plane, Rotation

    x_axis, _, z_axis, origin = (tuple(column) for column in item.rig_from_item[:3].T)
    placed = Location(Plane(origin=origin, x_dir=x_axis, z_dir=z_axis))

    def overlap_mm3(turn_deg: float) -> float:
        body = placed * Rotation(0.0, 0.0, turn_deg) * item_solid(item)
        return float(sum(solid.volume for solid in plate.intersect(body) or []))

    assert overlap_mm3(0.0) == pytest.approx(0.0, abs=1e-6)
    assert overlap_mm3(30.0) > 3.0


def test_dimensions_are_the_lengths_and_every_hole_and_round() -> None:
    top = np.array([0.0, 0.0, 8.0])
    cuts = (*tripod_cuts(top, 8.0, TripodNut()), *countersunk_hole(np.array([15.0, 0.0, 3.0]), 5.0, 3.0, "M3", 0.3))
    chain = (length(top, top + 4.0),)
    plan = BlocksPlan("plate", (PLATE,), cuts, chain, (Disc(np.zeros(3), 10.0, 4.0),))
    found = [each for each in plan.dimensions if isinstance(each, Hole)]
    assert tuple(each for each in plan.dimensions if isinstance(each, Length)) == chain
    wide = 2.24 * 3.0 + 2.0 * (HEAD_FIT_MM + 0.3 * np.tan(np.radians(42.0)))
    np.testing.assert_allclose(
        [hole.diameter_mm for hole in found], [20.0, 6.6, 11.31, 3.4, wide, wide + 0.018], atol=0.006
    )
    assert [hole.form for hole in found] == ["round", "round", "hexagon", "round", "countersink", "round"]
    assert found[4].text == "x 84°"
    assert plan.corners.shape == (8 + 2 * CORNERS, 3)


def test_a_disc_is_round() -> None:
    solid = make_blocks(BlocksPlan("disc", (), (), discs=(Disc(np.array([1.0, 2.0, 3.0]), 10.0, 4.0),)))
    assert solid.volume == pytest.approx(np.pi * 100.0 * 4.0, rel=1e-9)
    np.testing.assert_allclose(tuple(solid.bounding_box().min), [-9.0, 2.0, -7.0], atol=1e-6)
    np.testing.assert_allclose(tuple(solid.bounding_box().max), [11.0, 6.0, 13.0], atol=1e-6)


def test_a_head_deep_below_the_face_lies_in_a_round_hole() -> None:
    """A wall remains between countersinks 9.5 mm apart, for any thickness of the part."""
    plate = make_blocks(BlocksPlan("plate", (PLATE,), countersunk_hole(np.array([0.0, 0.0, 3.0]), 5.0, 3.0, "M3", 0.6)))
    assert plate.is_valid
    radii = [edge.radius for edge in plate.edges() if edge.geom_type == GeomType.CIRCLE]
    assert max(radii) < (9.5 - HARDWARE.printer.wall_mm) / 2.0
    assert max(radii) > 3.36


def test_discs_and_rings_stay_within_their_radii() -> None:
    at = np.array([1.0, 2.0, 3.0])
    corners = faceted(Disc(at, 10.0, 4.0)).base - at
    np.testing.assert_allclose(np.hypot(corners[:, 0], corners[:, 2]), 10.0)
    sectors = ring(at, (8.0, 10.0), 4.0)
    assert len(sectors) == CORNERS
    volume = sum(abs(volume_mm3(sector)) for sector in sectors)
    assert volume == pytest.approx(np.pi * (10.0**2 - 8.0**2) * 4.0, rel=0.01)
    middles = [(sector.base[0] + sector.base[3]) / 2.0 - at for sector in sectors]
    assert min(np.hypot(x, z) for x, _, z in middles) >= 8.0 - 1e-9
