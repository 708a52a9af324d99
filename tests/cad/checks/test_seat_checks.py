"""Seats and pockets of a block with one pocket and known faces, and the errors found in it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from build123d import Box, Part, Plane, Pos, Wire, import_step
from OCP.BRep import BRep_Builder
from OCP.Geom import Geom_Line
from OCP.gp import gp_Dir, gp_Pnt
from OCP.TopAbs import TopAbs_FORWARD, TopAbs_REVERSED
from OCP.TopoDS import TopoDS_Edge, TopoDS_Vertex, TopoDS_Wire
from scipy.spatial.transform import Rotation
from shapely import Polygon

from mirrorcam.cad.checks.seat_checks import FlatFace, _loop, check_seats, find_seat, flat_faces, pocket_gaps_mm
from mirrorcam.cad.plan.hardware import HARDWARE
from mirrorcam.cad.write.part_export import write_step
from mirrorcam.core.values import Metric
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror import Mirror

FIT = HARDWARE.fit.free_mm
WIDTH, HEIGHT, THICKNESS = 30.0, 20.0, 2.0
BOND = HARDWARE.holder.bond_mm
PADS_AT = ((-12.0, -7.0), (12.0, -7.0), (0.0, 7.0))
PADS_OF_AREA = 12.0 / (WIDTH * HEIGHT)
Seated = tuple[Layout, tuple[Part, ...]]


def failed(checks: dict[str, Metric]) -> set[str]:
    return {name for name, check in checks.items() if not check.passed}


def plane_of(mirror: Mirror) -> Plane:
    """The mirror's frame, moved to its back."""
    x_axis, _, normal, origin = mirror.rig_from_plane[:3].T
    return Plane(origin=tuple(origin + mirror.back_mm * normal), x_dir=tuple(x_axis), z_dir=tuple(normal))


def seat_block(
    mirror: Mirror,
    *,
    clearance: float = FIT,
    sink: float = 0.0,
    bond: float = BOND,
    pads: tuple[tuple[float, float], ...] = PADS_AT,
) -> Part:
    """A block with a pocket for a mirror of 30 x 20 x 2 mm, wider by the clearance on each side.

    It is 1 mm deep at its pads of 2 x 2 mm, and deeper by the bond elsewhere.
    """
    outer = Pos(0, 0, -4.0) * Box(WIDTH + 6, HEIGHT + 6, 10.0)
    block = outer - Pos(0, 0, 5.0 - sink - bond) * Box(WIDTH + 2 * clearance, HEIGHT + 2 * clearance, 10.0)
    for x, y in pads:
        block += Pos(x, y, -sink - 0.5) * Box(2.0, 2.0, 1.0)
    return Part((plane_of(mirror) * block).solids())


def read_back(parts: tuple[Part, ...], folder: Path) -> list[FlatFace]:
    paths = [folder / f"block_{number}.step" for number in range(len(parts))]
    for path, part in zip(paths, parts, strict=True):
        write_step(path, part)
    return flat_faces(import_step(path) for path in paths)


@pytest.fixture(scope="module")
def seated(make_flat_pair: Callable[..., Layout]) -> Seated:
    layout = make_flat_pair(gap_mm=20.0, width_mm=WIDTH, height_mm=HEIGHT, thickness_mm=THICKNESS)
    return layout, tuple(seat_block(mirror) for mirror in layout.mirrors)


def cover_of(layout: Layout) -> tuple[float, ...]:
    return (1.0 - PADS_OF_AREA,) * len(layout.mirrors)


def test_blocks_with_pockets_seat_their_mirrors(seated: Seated, tmp_path: Path) -> None:
    layout, parts = seated
    faces = read_back(parts, tmp_path)
    checks = check_seats(faces, layout, HARDWARE, cover_of(layout))
    assert failed(checks) == set()
    assert checks["seat_offset_um"].value < 1e-3
    assert checks["seat_cover"].value == pytest.approx(1.0 - PADS_OF_AREA)
    # An isosceles triangle, 14 mm high; its heights over the equal sides are 24 x 14 / 18.4 mm.
    assert checks["seat_base_mm"].value == pytest.approx(14.0, abs=1e-6)
    assert checks["seat_span_mm"].value < 1e-6
    for mirror in layout.mirrors:
        assert pocket_gaps_mm(faces, mirror, FIT) == pytest.approx([FIT] * 8)


def test_a_seat_two_microns_too_deep_is_found(seated: Seated, tmp_path: Path) -> None:
    layout, parts = seated
    deep = (parts[0], seat_block(layout.mirrors[1], sink=0.002))
    checks = check_seats(read_back(deep, tmp_path), layout, HARDWARE, cover_of(layout))
    assert failed(checks) == {"seat_offset_um", "bond_error_um"}
    assert checks["seat_offset_um"].value == pytest.approx(2.0, abs=1e-3)


@pytest.mark.parametrize("error_mm", [0.002, -0.002])
def test_a_bond_two_microns_off_is_found(seated: Seated, tmp_path: Path, error_mm: float) -> None:
    layout, parts = seated
    off = (parts[0], seat_block(layout.mirrors[1], bond=BOND + error_mm))
    checks = check_seats(read_back(off, tmp_path), layout, HARDWARE, cover_of(layout))
    assert failed(checks) == {"bond_error_um"}
    assert checks["bond_error_um"].value == pytest.approx(2.0, abs=1e-3)


@pytest.mark.parametrize(
    "pads", [(), PADS_AT[:2], (*PADS_AT, (-12.0, 7.0)), ((-12.0, -7.0), (12.0, -7.0), (0.0, -2.0))]
)
def test_a_mirror_that_is_not_on_three_pads_about_its_middle_is_found(
    seated: Seated, tmp_path: Path, pads: tuple[tuple[float, float], ...]
) -> None:
    layout, parts = seated
    wobbly = (parts[0], seat_block(layout.mirrors[1], pads=pads))
    checks = check_seats(read_back(wobbly, tmp_path), layout, HARDWARE, cover_of(layout))
    assert "seats_without_three_pads" in failed(checks) <= {"seats_without_three_pads", "seat_cover_lost"}
    assert checks["seats_without_three_pads"].value == 1


def test_a_seat_tilted_by_two_thousandths_of_a_degree_is_found(seated: Seated, tmp_path: Path) -> None:
    layout, parts = seated
    mirror = layout.mirrors[1]
    axis = mirror.rig_from_plane[:3, 0] * np.radians(0.002)
    tilted = mirror.moved(Rotation.from_rotvec(axis).as_matrix(), np.zeros(3))
    checks = check_seats(
        read_back(parts, tmp_path), layout.replaced(mirrors=(layout.mirrors[0], tilted)), HARDWARE, cover_of(layout)
    )
    assert checks["seat_angle_deg"].value == pytest.approx(0.002, rel=1e-4)
    assert "seat_angle_deg" in failed(checks)


@pytest.mark.parametrize("turned", [0b0000, 0b0110, 0b1011])
def test_a_border_is_read_in_order_though_its_edges_do_not_quite_meet(turned: int) -> None:
    corners = np.array([(0.0, 0.0, 0.0), (10.0, 0.0, 0.0), (9.0, 6.0, 0.0), (1.0, 6.0, 0.0)])
    builder, wire = BRep_Builder(), TopoDS_Wire()
    builder.MakeWire(wire)
    vertices = [TopoDS_Vertex() for _ in corners]
    for vertex, corner in zip(vertices, corners, strict=True):
        builder.MakeVertex(vertex, gp_Pnt(*corner.tolist()), 1e-4)
    for place in range(4):
        ends = [place, (place + 1) % 4]
        first, last = ends[::-1] if turned >> place & 1 else ends
        way = corners[last] + 5e-6 - corners[first]
        line, edge = Geom_Line(gp_Pnt(*corners[first].tolist()), gp_Dir(*way.tolist())), TopoDS_Edge()
        builder.MakeEdge(edge, line, 1e-4)
        builder.Add(edge, vertices[first].Oriented(TopAbs_FORWARD))
        builder.Add(edge, vertices[last].Oriented(TopAbs_REVERSED))
        builder.Range(edge, 0.0, float(np.linalg.norm(way)))
        builder.Add(wire, edge.Oriented(TopAbs_REVERSED) if turned >> place & 1 else edge)
    loop = Polygon(_loop(Wire(wire))[:, :2])
    assert loop.is_valid
    assert loop.area == pytest.approx(54.0, abs=1e-3)


def test_a_missing_seat_is_found(seated: Seated, tmp_path: Path) -> None:
    layout, parts = seated
    sunk = (parts[0], seat_block(layout.mirrors[1], sink=0.5))
    checks = check_seats(read_back(sunk, tmp_path), layout, HARDWARE, cover_of(layout))
    assert failed(checks) == {"seats_missing", "seats_without_three_pads", "seat_cover_lost"}
    assert checks["seat_cover_lost"].value == pytest.approx(1.0 - PADS_OF_AREA)


def test_a_groove_in_a_seat_bears_nothing_and_has_to_be_planned(seated: Seated, tmp_path: Path) -> None:
    """A groove of 4 x 20 mm, 0.4 mm deep, removes 4 / 30 of the cover; its largest circle is 4 mm wide."""
    layout, parts = seated
    groove = plane_of(layout.mirrors[0]) * Pos(6, 0, 0) * Box(4.0, HEIGHT, 1.2)
    grooved = (Part((parts[0] - groove).solids()), parts[1])
    faces = read_back(grooved, tmp_path)
    unplanned = check_seats(faces, layout, HARDWARE, cover_of(layout))
    assert failed(unplanned) == {"seat_cover_lost"}
    assert unplanned["seat_cover"].value == pytest.approx(26.0 / 30.0 - PADS_OF_AREA, abs=1e-6)
    assert unplanned["seat_span_mm"].value == pytest.approx(4.0, abs=0.05)
    assert failed(check_seats(faces, layout, HARDWARE, (26.0 / 30.0 - PADS_OF_AREA, *cover_of(layout)[1:]))) == set()


def test_a_seat_may_lie_on_two_parts(seated: Seated, tmp_path: Path) -> None:
    layout, parts = seated
    half = plane_of(layout.mirrors[0]) * Pos(50, 0, 0) * Box(100.0, 100.0, 100.0)
    cut = (Part((parts[0] - half).solids()), Part((parts[0] & half).solids()), parts[1])
    assert failed(check_seats(read_back(cut, tmp_path), layout, HARDWARE, cover_of(layout))) == set()


@pytest.mark.parametrize("error_mm", [0.002, -0.002])
def test_a_pocket_two_microns_off_is_found(seated: Seated, tmp_path: Path, error_mm: float) -> None:
    layout, parts = seated
    off = (parts[0], seat_block(layout.mirrors[1], clearance=FIT + error_mm))
    checks = check_seats(read_back(off, tmp_path), layout, HARDWARE, cover_of(layout))
    assert failed(checks) == {"pocket_error_um"}
    assert checks["pocket_error_um"].value == pytest.approx(2.0, abs=1e-3)


def test_a_plane_right_behind_another_mirror_is_no_seat_of_this_one(seated: Seated, tmp_path: Path) -> None:
    """Both mirrors are in one plane: the seat of one does not support the other."""
    layout, parts = seated
    faces = read_back(parts[:1], tmp_path)
    assert find_seat(faces, layout.mirrors[0], BOND) is not None
    assert find_seat(faces, layout.mirrors[1], BOND) is None
