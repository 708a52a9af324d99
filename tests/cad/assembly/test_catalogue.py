"""The catalogue of parts and purchased items: every screw has its thread, every part lies on the bed.

Named faces: the STEP files of the default device have them in the planned planes.

Exits of inserts and nuts from their seats: each ends outside its part, and none passes through material.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from build123d import Location, Part, Plane, Rotation

from mirrorcam.cad.assembly.catalogue import named_faces, parts_of, purchased_items
from mirrorcam.cad.assembly.components import item_components, item_names, item_solid, tessellated
from mirrorcam.cad.assembly.device_plan import Device, plan_device
from mirrorcam.cad.checks.clashes import FORMING
from mirrorcam.cad.checks.device_checks import _expected_names
from mirrorcam.cad.checks.exported_mesh import solid_of
from mirrorcam.cad.checks.reach import check_insertion, check_tool_reach
from mirrorcam.cad.plan.back_table import back_of
from mirrorcam.cad.plan.hardware import HARDWARE, Hardware
from mirrorcam.cad.plan.part_plan import PurchasedItem
from mirrorcam.cad.write.assembly_files import location_of
from mirrorcam.core.values import Metric
from mirrorcam.optics.geometry.camera_library import read_body
from mirrorcam.optics.geometry.layout import Layout
from tests.cad.write.test_part_export import named_planes
from tests.nightly import a_few

NUTS = HARDWARE.replaced(screw=HARDWARE.screw.replaced(kind="nut"))
POCKETS = ("mount", "camera_clip", "adapter_saddle", "adapter_desk")
BOARD = HARDWARE.replaced(camera=read_body("board_38"))


CLAMPED = HARDWARE.replaced(back=back_of("gen2"))
CASES = {
    "insert": HARDWARE,
    "nut": NUTS,
    "board": BOARD,
    "gen2": CLAMPED,
    "gen2 with nuts": CLAMPED.replaced(screw=NUTS.screw),
}


@pytest.fixture(scope="module", params=a_few(1, (pytest.param(hardware, id=name) for name, hardware in CASES.items())))
def each_device(request: pytest.FixtureRequest, default_layout: Layout) -> Device:
    hardware: Hardware = request.param
    return plan_device(default_layout, hardware)


def axis_of(item: PurchasedItem) -> tuple[np.ndarray, np.ndarray]:
    return item.rig_from_item[:3, 3], item.rig_from_item[:3, 2]


def slide_screws(device: Device) -> int:
    """Two rows of two for a camera's body, one for a board, which has a low clip."""
    return 4 if device.hardware.camera.held_by.kind == "lips" else 2


@pytest.mark.slow
def test_every_screw_of_the_frame_holds_in_its_own_thread(each_device: Device) -> None:
    """A screw engages an insert by the required length or a complete nut, and ends soon after it."""
    screw = each_device.hardware.screw
    items = purchased_items(each_device)
    threads = [item for item in items if item.kind in ("insert", "nut")]
    screws = [item for item in items if item.kind == "screw" and item.size in ("M3", "M3 countersunk")]
    sprung = [item for item in screws if item.joins == ("camera_clip",)]
    assert len(sprung) == (2 if each_device.hardware.camera.held_by.kind == "lips" else 0)
    backs = sum(len(joint.heads) for joint in each_device.back.joints)
    assert len(screws) == 4 + slide_screws(each_device) + 4 + backs + len(sprung)
    for item in screws:
        origin, out = axis_of(item)
        found = []
        for other in threads:
            mouth, its_out = axis_of(other)
            if np.linalg.norm(np.cross(mouth - origin, out)) < 1e-6 and its_out @ out > 1.0 - 1e-9:
                begins = float((origin - mouth) @ out)
                found.append((begins, begins + other.length_mm))
        reached = [(low, high) for low, high in found if 0.0 < low < item.length_mm]
        assert len(reached) == 1
        low, high = reached[0]
        engaged = min(item.length_mm, high) - low
        if screw.kind == "insert":
            assert engaged >= screw.engaged_mm
            # Holes of sprung screws are through holes: they end at the camera.
            assert item.length_mm - low < screw.insert_depth_mm or len(item.joins) == 1
        else:
            assert engaged == pytest.approx(screw.nut_height_mm, abs=1e-9)
        assert item.joins[-1] in {name for other in threads for name in other.joins}


def test_bought_items_are_counted_by_kind(each_device: Device) -> None:
    items = purchased_items(each_device)
    kind = each_device.hardware.screw.kind
    lips = each_device.hardware.camera.held_by.kind == "lips"
    sizes = [(item.kind, item.size) for item in items]
    backs = sum(len(joint.heads) for joint in each_device.back.joints)
    assert sizes.count((kind, "M3")) == 8 + slide_screws(each_device) + backs + (2 if lips else 0)
    assert sizes.count(("screw", "M2 thread-forming")) == (0 if lips else 4)


def test_fasteners_are_called_in_the_assembly_what_its_checks_expect(each_device: Device) -> None:
    """Thread-forming screws have their own names, by which the clash check allows them in plastic."""
    names = item_names(purchased_items(each_device))
    mirrors = {f"mirror_{name}" for name in each_device.layout.mirror_names}
    assert {*names, *mirrors, "camera"} == _expected_names(each_device, ())
    forming = [name for name in names if name.startswith(FORMING)]
    assert len(forming) == (0 if each_device.hardware.camera.held_by.kind == "lips" else 4)


def test_sprung_screws_end_at_the_camera_and_can_be_turned_in_further(each_device: Device) -> None:
    tips = [screw.tip for screw in each_device.clip.nest.screws] if each_device.clip.nest else []
    screws = [item for item in purchased_items(each_device) if item.kind == "screw" and item.joins == ("camera_clip",)]
    if not tips:
        assert all(item.size.endswith(" thread-forming") for item in screws)
        return
    for tip, item, sprung in zip(
        tips, screws, each_device.clip.nest.screws if each_device.clip.nest else (), strict=True
    ):
        origin, out = axis_of(item)
        np.testing.assert_allclose(origin - item.length_mm * out, tip, atol=1e-9)
        assert item.length_mm - sprung.mouth_mm >= 3.0


def test_nuts_lie_in_their_pockets(each_device: Device) -> None:
    """No nut overlaps plastic, but each would if it were rotated by 30 deg: its pocket keeps it from turning."""
    made = {part.name: part.make(part.plan) for part in parts_of(each_device) if part.name in POCKETS}
    nuts = [item for item in purchased_items(each_device) if item.kind == "nut" and item.joins[-1] in made]
    lips = each_device.hardware.camera.held_by.kind == "lips"
    m3 = 4 + slide_screws(each_device) + sum(len(joint.heads) for joint in each_device.back.joints) + lips * 2
    assert len(nuts) == m3 * (each_device.hardware.screw.kind == "nut") + len(each_device.back.items)
    for item in nuts:
        placed = Location(Plane(*(tuple(item.rig_from_item[:3, column]) for column in (3, 0, 2))))
        nut = item_solid(item)
        part = made[item.joins[-1]]
        assert overlap_mm3(part, placed * nut) == pytest.approx(0.0, abs=1e-6)
        assert overlap_mm3(part, placed * Rotation(0.0, 0.0, 30.0) * nut) > 0.3


def overlap_mm3(part: Part, other: Part) -> float:
    return float(sum(solid.volume for solid in part.intersect(other) or []))


def test_every_part_stands_on_the_bed_and_has_its_own_number(each_device: Device) -> None:
    parts = parts_of(each_device)
    assert len({part.number for part in parts}) == len({part.name for part in parts}) == len(parts)
    for part in parts:
        turn = part.print_from_rig[:3, :3]
        np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-9)
        assert np.linalg.det(turn) == pytest.approx(1.0)
        if part.name in ("mirror_holder", "dust_cover"):
            continue
        printed = part.make(part.plan).moved(location_of(part.print_from_rig))
        assert pytest.approx(0.0, abs=1e-5) == printed.bounding_box().min.Z


Built = tuple[Layout, Path, dict[str, Metric]]


def test_faces_of_the_default_device_are_in_its_files(built_default: Built, device: Device) -> None:
    for part in parts_of(device):
        planes = named_planes((built_default[1] / "parts" / f"{part.name}.step").read_text(encoding="utf-8"))
        by_name = {face.name: face for face in part.faces}
        for name, (point, normal) in planes.items():
            face = by_name[name] if name in by_name else by_name[name.rpartition("_")[0]]
            assert (point - face.point) @ face.normal == pytest.approx(0.0, abs=0.02)
            np.testing.assert_allclose(normal, face.normal, atol=1e-4)
        if part.name == "mirror_holder":
            pads = [name for name in planes if name.startswith("pad_")]
            assert len(pads) == 3 * len(device.layout.mirrors)
            assert {name for name in by_name if any(each.startswith(name) for each in planes)} == set(by_name)
        if part.name == "mount":
            assert {"joint_back", "joint_slide", "joint_foot"} <= {name.removesuffix("_1") for name in planes}


def test_a_piece_of_a_part_has_the_faces_of_the_whole(device: Device) -> None:
    assert [face.name for face in named_faces(device, "mount_2")] == [
        face.name for face in named_faces(device, "mount")
    ]
    assert named_faces(device, "fit_coupon") == ()


HOMES = ("mirror_holder", "mount", "camera_clip", "adapter_saddle", "adapter_desk")


@pytest.mark.slow
@pytest.mark.parametrize(
    "hardware",
    [HARDWARE, NUTS, NUTS.replaced(camera=read_body("board_38"), back=back_of("gen2"))],
    ids=["insert", "nut", "board on a clamp"],
)
def test_inserts_and_nuts_get_to_their_seats(hardware: Hardware, small_layout: Layout) -> None:
    device = plan_device(small_layout, hardware)
    items = purchased_items(device)
    assert all(bool(len(item.exit_moves_mm)) == (item.kind in ("insert", "nut")) for item in items)
    solids = {part.name: solid_of(tessellated(part.make(part.plan))) for part in parts_of(device) if part.name in HOMES}
    solids |= {piece.name: solid_of(piece.mesh) for piece in item_components(items)}
    assert not [name for name, check in check_insertion(items, solids).items() if check.passed is False]
    threads = [item for item in items if item.kind in ("insert", "nut")]
    assert check_tool_reach(threads, solids)["device.tool_clash_mm3"].value == 0.0
    if hardware.screw.kind == "nut":
        # A former error: nuts in front of the face that the screw enters, as if they were inserts.
        wrong = [replace(item, exit_moves_mm=12.0 * item.rig_from_item[None, :3, 2]) for item in items]
        assert check_insertion(wrong, solids)["device.insertion_clash_mm3"].value > 100.0


@pytest.mark.slow
def test_a_nut_of_the_foot_leaves_by_the_nearer_side(small_layout: Layout) -> None:
    nuts = [item for item in purchased_items(plan_device(small_layout, NUTS)) if item.joins == ("mount",)]
    assert len(nuts) == 4
    for nut in nuts:
        assert nut.exit_moves_mm[0] @ nut.rig_from_item[:3, 2] < 0.0
        assert np.sign(nut.exit_moves_mm[1, 0]) == np.sign(nut.rig_from_item[0, 3])
