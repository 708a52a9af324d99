"""Sizes of threads by their names, against the rules that the standards follow.

Screws: long enough to engage, short enough not to bottom out.

Frames of purchased items: right-handed, along their axes; and exit moves that end outside.
"""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mirrorcam.cad.parts.part_solids import bore_solid, hexagon_solid
from mirrorcam.cad.plan.fasteners import (
    EXIT_GAP_MM,
    ROOF_DEG,
    Bore,
    Hexagon,
    exit_move,
    frame_along,
    stack,
    stack_into,
    thread,
    with_holes_for_screws,
)
from mirrorcam.cad.plan.hardware import HARDWARE, Fastening
from mirrorcam.cad.plan.threads import COUNTERSUNK, SUNK_HEAD, THREADS, diameter_mm, thread_of
from mirrorcam.core.errors import InputError


def test_metric_sizes_are_their_names() -> None:
    for name, size in THREADS.items():
        if name.startswith("M"):
            assert float(name[1:]) == size.diameter_mm == size.head_height_mm
        assert size.diameter_mm < size.clearance_mm < size.nut_flats_mm
        assert size.nut_height_mm > 3.5 * size.pitch_mm


def test_the_inch_thread_has_twenty_turns_to_the_inch() -> None:
    thread = thread_of("1/4-20 UNC")
    assert thread.pitch_mm == pytest.approx(25.4 / 20)
    assert thread.diameter_mm == pytest.approx(25.4 / 4)
    assert thread.nut_flats_mm == pytest.approx(25.4 * 7 / 16, abs=0.01)
    assert thread.nut_height_mm == pytest.approx(25.4 * 7 / 32, abs=0.01)


def test_the_table_of_screws_agrees_with_that_of_threads() -> None:
    screw, thread = HARDWARE.screw, thread_of("M3")
    assert (screw.clearance_hole_mm, screw.nut_flats_mm, screw.nut_height_mm, screw.head_height_mm) == (
        thread.clearance_mm,
        thread.nut_flats_mm,
        thread.nut_height_mm,
        thread.head_height_mm,
    )


def test_a_size_begins_with_its_thread() -> None:
    assert thread_of(f"M3{COUNTERSUNK}") == thread_of("M3")
    assert diameter_mm("M2 thread-forming") == 2.0
    assert diameter_mm("3") == 3.0
    assert diameter_mm("1/4-20 UNC") == 6.35
    assert SUNK_HEAD * thread_of("M3").diameter_mm == pytest.approx(6.72)  # ISO 10642
    with pytest.raises(ValueError, match="size='M33' does not name a thread, expected one of M1"):
        thread_of("M33")


NUTS = HARDWARE.replaced(screw=HARDWARE.screw.replaced(kind="nut"))
X, Y = np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])


@given(st.floats(1.0, 22.0))
def test_screws_into_inserts_hold_and_never_bottom_out(grip_mm: float) -> None:
    screw = HARDWARE.screw
    washer = 0.5 if grip_mm <= 2.0 else 0.0
    try:
        found = stack(grip_mm, HARDWARE)
    except InputError as error:
        # In a gap between two lengths on the list, no length may fit.
        assert "of the thread" in str(error)
        assert not any(
            screw.engaged_mm <= length - grip_mm - washer <= screw.insert_depth_mm - 0.2 for length in screw.lengths_mm
        )
        return
    assert found.washer_mm == washer
    assert found.length_mm in screw.lengths_mm
    assert screw.engaged_mm <= found.engaged_mm <= screw.insert_mm
    assert found.length_mm - grip_mm - washer <= screw.insert_depth_mm - 0.2 + 1e-9


@given(st.floats(1.0, 22.0))
def test_screws_end_flush_with_their_nuts(grip_mm: float) -> None:
    found = stack(grip_mm, NUTS)
    assert found.length_mm - grip_mm - found.washer_mm == pytest.approx(found.wall_mm)
    under = found.wall_mm - NUTS.screw.nut_height_mm - 0.2
    assert under >= 2.0 * NUTS.printer.wall_mm - 1e-9


def test_a_grip_that_no_screw_fits_is_refused_with_the_lengths_that_would_fit() -> None:
    with pytest.raises(InputError, match=r"M3 screws through 40 mm engage 0\.0 mm .* a length of 42\.5 to 46\.5 mm"):
        stack(40.0, HARDWARE)
    with pytest.raises(InputError, match=r"engage 2\.1 mm of the thread 0 to 5\.7 mm deep, expected at least 2\.5 mm"):
        stack_into(3.9, (0.0, 5.7), 3.4, 7.0, HARDWARE.screw)
    with pytest.raises(InputError, match=r"M2 screws through 18 mm must be at least 21\.\d mm .* ends at 20: add one"):
        stack(18.0, HARDWARE.replaced(screw=Fastening(thread="M2", kind="nut")))


@pytest.mark.parametrize(
    ("lengths_mm", "insert_mm", "depth_mm"),
    [
        (HARDWARE.screw.lengths_mm, 5.7, 6.7),  # the lengths of shops need no deeper holes
        ((10.0, 20.0, 30.0), 5.7, 7.2),  # 10 mm through 3 mm round the head of the mount
        ((6.0, 8.0, 10.0, 16.0, 20.0), 3.0, 4.2),  # 8 mm through the slide's 4 mm
        ((20.0, 30.0), 5.7, 6.7),  # too long
    ],
)
def test_holes_are_deepened_for_the_lengths_at_hand(
    lengths_mm: tuple[float, ...], insert_mm: float, depth_mm: float
) -> None:
    screw = Fastening(lengths_mm=lengths_mm, insert_mm=insert_mm, insert_depth_mm=insert_mm + 1.0)
    deep = with_holes_for_screws(HARDWARE.replaced(screw=screw))
    assert deep.screw.insert_depth_mm == pytest.approx(depth_mm)
    if depth_mm > screw.insert_depth_mm:
        for grip in (deep.mount.grip_mm, deep.mount.slide_skin_mm, deep.back.grip_mm):
            assert stack(grip, deep).engaged_mm >= screw.engaged_mm


@pytest.mark.parametrize("roof_deg", [45.0, 42.0, 30.0])
def test_the_outline_of_a_horizontal_hole_is_a_circle_and_a_kite(roof_deg: float) -> None:
    """The kite of the two tangents, minus the sector that it shares with the circle."""
    r, depth, steep = 2.0, 3.0, np.deg2rad(roof_deg)
    bore = Bore(np.zeros(3), Y, r, depth, X, roof_deg=roof_deg)
    tangent = r / np.tan(steep)
    area = np.pi * r**2 + r * tangent - (np.pi / 2.0 - steep) * r**2
    solid = bore_solid(bore)
    assert solid.volume == pytest.approx(depth * area)
    top = solid.bounding_box().max.X
    assert top == pytest.approx(bore.roof_mm) == pytest.approx(r / np.sin(steep))
    assert pytest.approx(-r) == solid.bounding_box().min.X


def test_a_slot_is_as_long_as_its_travel() -> None:
    slot = bore_solid(Bore(np.zeros(3), Y, 1.7, 3.0, X, travel_mm=8.0))
    box = slot.bounding_box()
    assert pytest.approx(8.0 + 2.0 * 1.7) == box.size.Z
    assert pytest.approx(3.0) == box.size.Y


def test_a_flat_slot_is_no_wider_than_its_screw() -> None:
    """A head rests on both sides; the ceiling ends where 42 deg tangents meet it."""
    slot = bore_solid(Bore(np.zeros(3), Y, 1.7, 3.0, X, travel_mm=8.0, ceiling_mm=20.0)).bounding_box()
    assert pytest.approx((-1.7, 1.7)) == (slot.min.X, slot.max.X)


def test_a_nuts_pocket_holds_it_by_four_sides_and_has_a_roof_that_prints() -> None:
    pocket = hexagon_solid(Hexagon(np.zeros(3), Y, X, 5.7, 2.6))
    normals = np.array([tuple(face.normal_at()) for face in pocket.faces() if abs(face.normal_at().Y) < 0.5])
    # Normals of the tool point out of it, into the part: the part's faces have opposite normals.
    down = normals[normals[:, 0] > 0.1]
    assert len(normals) == 6
    np.testing.assert_allclose(np.degrees(np.arccos(down[:, 0])), 90.0 - ROOF_DEG)
    assert len(down) == 2
    across = pocket.bounding_box().size.Z
    assert across == pytest.approx(5.7)


def test_threads_are_cut_for_an_insert_or_a_nut() -> None:
    (hole,) = thread(np.zeros(3), Y, X, stack(1.6, HARDWARE), 8.0, HARDWARE.screw)
    assert isinstance(hole, Bore)
    assert 2.0 * hole.radius_mm == HARDWARE.screw.insert_hole_mm
    held = stack(1.6, NUTS)
    through, pocket = thread(np.zeros(3), Y, X, held, 8.0, NUTS.screw)
    assert isinstance(through, Bore)
    assert isinstance(pocket, Hexagon)
    assert through.depth_mm > 8.0
    # The wall is thicker than in the stack: the nut is at the screw's end, and can be inserted there.
    assert held.wall_mm < 8.0
    assert pocket.mouth[1] == pytest.approx(held.begins_mm)
    assert pocket.mouth[1] + pocket.depth_mm > 8.0


@pytest.mark.parametrize("axis", [(0.0, 0.0, -1.0), (0.0, 1.0, 0.0), (0.0, 0.6, 0.8)])
def test_a_frame_has_its_z_along_the_axis_and_its_x_normal_to_it(axis: tuple[float, float, float]) -> None:
    frame = frame_along(np.array([1.0, 2.0, 3.0]), np.array(axis))
    np.testing.assert_allclose(frame[:3, 2], axis)
    np.testing.assert_allclose(frame[:3, 3], [1.0, 2.0, 3.0])
    np.testing.assert_allclose(frame[:3, :3] @ frame[:3, :3].T, np.eye(3), atol=1e-12)
    assert np.linalg.det(frame) == pytest.approx(1.0)
    assert frame[0, 0] == pytest.approx(1.0)


def test_an_exit_move_leaves_the_hull_with_a_gap() -> None:
    corners = np.array([(0.0, 0.0, 0.0), (10.0, 5.0, 2.0)])
    move = exit_move(corners, np.array([4.0, 1.0, 1.0]), np.array([-1.0, 0.0, 0.0]))
    np.testing.assert_allclose(move, [-(4.0 + EXIT_GAP_MM), 0.0, 0.0])
