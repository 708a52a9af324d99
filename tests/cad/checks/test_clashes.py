"""Solids with known common volume and gap.

Obstacles to a dust cover, in place and on its moves off.
"""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from manifold3d import Manifold

from mirrorcam.cad.assembly.device_plan import Device
from mirrorcam.cad.checks.clashes import MAX_GAP_MM, STEP_MM, check_clashes, check_cover, close_pairs, overlap_mm3
from mirrorcam.core.values import Metric


def box(size: float, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Manifold:
    return Manifold.cube((size, size, size)).translate((x, y, z))


def rod(diameter: float, length: float, x: float, y: float, z: float, sides: int = 32) -> Manifold:
    return Manifold.cylinder(length, diameter / 2.0, circular_segments=sides).translate((x, y, z))


def failed(checks: dict[str, Metric]) -> set[str]:
    return {name for name, check in checks.items() if not check.passed}


@given(st.floats(-12.0, 12.0), st.floats(-12.0, 12.0), st.floats(-12.0, 12.0))
def test_two_boxes_share_the_box_of_their_overlap_or_leave_the_gap_between(x: float, y: float, z: float) -> None:
    (meeting,) = close_pairs({"a": box(8.0), "b": box(8.0, x, y, z)})
    overlap = np.maximum(8.0 - np.abs([x, y, z]), 0.0)
    apart = float(np.linalg.norm(np.maximum(np.abs([x, y, z]) - 8.0, 0.0)))
    assert meeting.gap_mm == pytest.approx(apart, abs=1e-6)
    if overlap.min() > 1e-3 or overlap.min() == 0.0:
        assert meeting.overlap_mm3 == pytest.approx(float(np.prod(overlap)), abs=1e-9)


def test_distant_solids_are_not_a_close_pair() -> None:
    assert close_pairs({"a": box(8.0), "b": box(8.0, 8.0 + MAX_GAP_MM, 0.0, 0.0)}) == []


def test_faces_that_touch_share_nothing_even_where_numbers_are_rounded() -> None:
    for sink in (0.0, 1e-6, 4e-5):
        assert overlap_mm3(box(8.0), box(8.0, 8.0 - sink, 0.0, 0.0)) == 0.0
    assert overlap_mm3(box(8.0), box(8.0, 8.0 - 1e-3, 0.0, 0.0)) == pytest.approx(0.064)


def test_a_clash_and_a_gap_that_is_none_are_found_and_named() -> None:
    sound = {"mount": box(10.0), "camera_clip": box(10.0, 10.0, 0.0, 0.0), "camera": box(10.0, 0.0, 10.5, 0.0)}
    checks = check_clashes(sound, 0.1)
    assert failed(checks) == set()
    assert checks["device.clearance_mm"].value == checks["camera.clearance_mm"].value == 0.5
    clashing = sound | {"camera": box(10.0, 0.0, 9.5, 0.0)}
    # The camera is 0.5 mm inside the mount, and only touches the edge of the clip.
    found = check_clashes(clashing, 0.1)
    assert failed(found) == {"device.clash_mm3", "mount.clash_mm3", "camera.clash_mm3"}
    assert found["device.clash_mm3"].value == pytest.approx(50.0)
    narrow = check_clashes(sound | {"camera": box(10.0, 0.0, 10.09, 0.0)}, 0.1)
    assert failed(narrow) == {
        "device.clearance_mm",
        "mount.clearance_mm",
        "camera.clearance_mm",
        "camera_clip.clearance_mm",
    }


def test_an_insert_may_be_as_wide_as_its_hole_but_not_stand_in_solid_plastic() -> None:
    hole = box(10.0) - rod(4.0, 6.0, 5.0, 5.0, 4.0, sides=31)
    insert = rod(4.0, 5.7, 5.0, 5.0, 4.3) - rod(3.0, 5.7, 5.0, 5.0, 4.3)
    screw = rod(3.0, 12.0, 5.0, 5.0, 4.5, sides=29)
    fastened = {"mirror_holder": hole, "insert_01": insert, "screw_01": screw}
    assert failed(check_clashes(fastened, 0.1)) == set()
    beside = fastened | {"insert_01": insert.translate((1.0, 0.0, 0.0))}
    assert {"device.clash_mm3", "insert_01.clash_mm3", "mirror_holder.clash_mm3"} <= failed(check_clashes(beside, 0.1))


def test_a_screw_in_the_air_and_one_without_a_thread_are_found() -> None:
    hole = box(10.0) - rod(3.4, 12.0, 5.0, 5.0, -1.0)
    headed = rod(3.0, 8.0, 5.0, 5.0, 2.0) + rod(5.5, 3.0, 5.0, 5.0, 10.0)
    assert failed(check_clashes({"mount": hole, "screw_01": headed}, 0.1)) == {"device.screws_without_thread"}
    adrift = {"mount": hole, "screw_01": headed.translate((0.0, 0.0, 1.0))}
    assert failed(check_clashes(adrift, 0.1)) == {"device.screws_without_thread", "device.fasteners_loose"}
    through_plastic = {"mount": box(10.0), "screw_01": headed}
    assert {"device.clash_mm3", "screw_01.clash_mm3"} <= failed(check_clashes(through_plastic, 0.1))


def test_a_screw_that_forms_its_thread_holds_in_a_narrow_hole_and_nowhere_else() -> None:
    post, board = box(10.0), box(10.0, 0.0, 0.0, 10.0) - rod(2.2, 12.0, 5.0, 5.0, 9.0)
    screw = rod(2.0, 14.0, 5.0, 5.0, 6.0) + rod(4.0, 2.0, 5.0, 5.0, 20.0)
    fastened = {"camera_clip": post - rod(1.6, 6.0, 5.0, 5.0, 5.0), "camera": board, "screw_forming_01": screw}
    assert failed(check_clashes(fastened, 0.1)) == set()
    too_wide = fastened | {"camera_clip": post - rod(2.4, 6.0, 5.0, 5.0, 5.0)}
    assert failed(check_clashes(too_wide, 0.1)) == {"device.screws_without_thread"}
    for narrow in ({"camera_clip": post}, {"camera": box(10.0, 0.0, 0.0, 10.0)}):
        assert {"device.clash_mm3", "screw_forming_01.clash_mm3"} <= failed(check_clashes(fastened | narrow, 0.1))
    machine = {"screw_01" if name == "screw_forming_01" else name: solid for name, solid in fastened.items()}
    assert {"device.clash_mm3", "device.screws_without_thread"} <= failed(check_clashes(machine, 0.1))


def test_a_pin_holds_in_the_holes_of_two_pieces_and_in_no_wider_ones() -> None:
    def piece(hole: float, x: float) -> Manifold:
        return box(10.0, x) - rod(hole, 30.0, 0.0, 0.0, 0.0).rotate((0.0, 90.0, 0.0)).translate((-5.0, 5.0, 5.0))

    pin = rod(3.0, 16.0, 0.0, 0.0, 0.0, sides=29).rotate((0.0, 90.0, 0.0)).translate((2.0, 5.0, 5.0))
    joined = {"mount_1": piece(3.2, 0.0), "mount_2": piece(3.2, 10.0), "pin_01": pin}
    assert failed(check_clashes(joined, 0.1)) == set()
    assert failed(check_clashes(joined | {"mount_2": piece(3.8, 10.0)}, 0.1)) == {"device.fasteners_loose"}
    one_sided = joined | {"pin_01": pin.translate((-4.0, 0.0, 0.0)), "mount_2": box(10.0, 14.5)}
    assert "device.fasteners_loose" in failed(check_clashes(one_sided, 0.1))


def test_a_mirror_off_its_seat_is_found() -> None:
    mirror = Manifold.cube((10.0, 10.0, 1.0))
    seated = {"mirror_holder": box(10.0), "mirror_0-0": mirror.translate((0.0, 0.0, 10.0))}
    assert failed(check_clashes(seated, 0.1)) == set()
    lifted = seated | {"mirror_0-0": mirror.translate((0.0, 0.0, 10.2))}
    assert failed(check_clashes(lifted, 0.1)) == {"device.mirrors_off_their_seats"}


def test_the_wrist_fills_its_clamp_and_no_more() -> None:
    """Meshes of one diameter with different corners overlap slightly; a wrist 0.5 mm larger does not fit."""
    half = (rod(71.0, 8.0, 0.0, 0.0, 0.0, 90) - rod(63.0, 10.0, 0.0, 0.0, -1.0, 90)).trim_by_plane((1.0, 0.0, 0.0), 1.0)
    clamp = {"adapter_saddle": half, "adapter_cap": half.rotate((0.0, 0.0, 180.0))}

    def wrist(diameter: float) -> dict[str, Manifold]:
        return clamp | {"wrist": rod(diameter, 17.0, 0.0, 0.0, -4.5, 101)}

    assert failed(check_clashes(wrist(63.0), 0.1)) == set()
    clashes = {f"{name}.clash_mm3" for name in ("device", "wrist", "adapter_saddle", "adapter_cap")}
    assert failed(check_clashes(wrist(63.5), 0.1)) == clashes
    in_mount = wrist(63.0) | {"mount": box(10.0, 20.0, 0.0, 9.0)}
    assert {"wrist.clash_mm3", "mount.clash_mm3"} <= failed(check_clashes(in_mount, 0.1))


@pytest.mark.parametrize(
    ("at", "failing"),
    [
        ((0.0, 0.0, -2.0), set()),
        ((0.0, 0.0, 0.5), {"dust_cover.clash_mm3"}),
        ((0.0, 0.0, 25.0), {"dust_cover.way_clash_mm3"}),
        ((40.0, 0.0, 30.0), {"dust_cover.way_clash_mm3"}),
        ((40.0, 0.0, 0.0), set()),
    ],
)
def test_obstacles_to_the_cover_are_detected(
    covered_device: Device, at: tuple[float, float, float], failing: set[str]
) -> None:
    """A block of 10 mm, moved off by 30 mm along z, then 60 mm along x, with or without a cube of 2 mm on its path."""
    assert covered_device.cover is not None
    plan = type(covered_device.cover)(
        **{**vars(covered_device.cover), "way_mm": np.array([(0.0, 0.0, 30.0), (60.0, 0.0, 0.0)])}
    )
    block = Manifold.cube((10.0, 10.0, 10.0), center=True).translate((0.0, 0.0, 5.0))
    cube = Manifold.cube((2.0, 2.0, 2.0), center=True).translate(at)
    checks = check_cover(plan, block, {"cube": cube})
    assert {name for name, check in checks.items() if not check.passed} == failing
    assert STEP_MM < 10.0
