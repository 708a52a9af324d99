"""The list of parts and of what is bought: every screw finds its thread, every part lies on the bed."""

from __future__ import annotations

import numpy as np
import pytest
from build123d import Location, Part, Plane, Rotation

from mirrorcam.cad.assembly.bought_solids import item_solid
from mirrorcam.cad.assembly.catalogue import bought_items, parts_of
from mirrorcam.cad.assembly.device_plan import Device, plan_device
from mirrorcam.cad.assembly.pieces import item_names
from mirrorcam.cad.checks.clashes import FORMING
from mirrorcam.cad.checks.device_checks import _names_expected
from mirrorcam.cad.plan.back_table import back_of
from mirrorcam.cad.plan.hardware import HARDWARE, Hardware
from mirrorcam.cad.plan.part_plan import BoughtItem
from mirrorcam.optics.geometry.camera_library import read_body
from mirrorcam.optics.geometry.layout import Layout

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


@pytest.fixture(scope="module", params=list(CASES.values()), ids=list(CASES))
def device(request: pytest.FixtureRequest, default_layout: Layout) -> Device:
    hardware: Hardware = request.param
    return plan_device(default_layout, hardware)


def axis_of(item: BoughtItem) -> tuple[np.ndarray, np.ndarray]:
    return item.rig_from_item[:3, 3], item.rig_from_item[:3, 2]


def slide_screws(device: Device) -> int:
    """Two rows of two for a camera's body, one for a board, whose clip is low."""
    return 4 if device.hardware.camera.held_by.kind == "lips" else 2


def test_every_screw_of_the_frame_holds_in_its_own_thread(device: Device) -> None:
    """Along its axis a screw covers an insert by the thread that is needed, or a nut wholly, and ends soon after."""
    screw = device.hardware.screw
    items = bought_items(device)
    threads = [item for item in items if item.kind in ("insert", "nut")]
    screws = [item for item in items if item.kind == "screw" and item.size in ("M3", "M3 countersunk")]
    sprung = [item for item in screws if item.joins == ("camera_clip",)]
    assert len(sprung) == (2 if device.hardware.camera.held_by.kind == "lips" else 0)
    backs = sum(len(joint.heads) for joint in device.back.joints)
    assert len(screws) == 4 + slide_screws(device) + 4 + backs + len(sprung)
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
            # Holes of sprung screws go through: they end at the camera.
            assert item.length_mm - low < screw.insert_depth_mm or len(item.joins) == 1
        else:
            assert engaged == pytest.approx(screw.nut_height_mm, abs=1e-9)
        assert item.joins[-1] in {name for other in threads for name in other.joins}


def test_what_is_bought_is_counted_by_kind(device: Device) -> None:
    items = bought_items(device)
    kind = device.hardware.screw.kind
    lips = device.hardware.camera.held_by.kind == "lips"
    sizes = [(item.kind, item.size) for item in items]
    backs = sum(len(joint.heads) for joint in device.back.joints)
    assert sizes.count((kind, "M3")) == 8 + slide_screws(device) + backs + (2 if lips else 0)
    assert sizes.count(("screw", "M2 thread-forming")) == (0 if lips else 4)


def test_fasteners_are_called_in_the_assembly_what_its_checks_expect(device: Device) -> None:
    """Screws that form their thread have names of their own, by which the clash check lets them into plastic."""
    names = item_names(bought_items(device))
    mirrors = {f"mirror_{name}" for name in device.layout.mirror_names}
    assert {*names, *mirrors, "camera"} == _names_expected(device, ())
    forming = [name for name in names if name.startswith(FORMING)]
    assert len(forming) == (0 if device.hardware.camera.held_by.kind == "lips" else 4)


def test_sprung_screws_end_at_the_camera_and_can_be_turned_in_further(device: Device) -> None:
    tips = [screw.tip for screw in device.clip.nest.screws] if device.clip.nest else []
    screws = [item for item in bought_items(device) if item.kind == "screw" and item.joins == ("camera_clip",)]
    if not tips:
        assert all(item.size.endswith(" thread-forming") for item in screws)
        return
    for tip, item, sprung in zip(tips, screws, device.clip.nest.screws if device.clip.nest else (), strict=True):
        origin, out = axis_of(item)
        np.testing.assert_allclose(origin - item.length_mm * out, tip, atol=1e-9)
        assert item.length_mm - sprung.mouth_mm >= 3.0


def test_nuts_lie_in_their_pockets(device: Device) -> None:
    """No nut stands in plastic, and each is held against turning: turned by 30 deg, it would."""
    made = {part.name: part.make(part.plan) for part in parts_of(device) if part.name in POCKETS}
    nuts = [item for item in bought_items(device) if item.kind == "nut" and item.joins[-1] in made]
    lips = device.hardware.camera.held_by.kind == "lips"
    m3 = 4 + slide_screws(device) + sum(len(joint.heads) for joint in device.back.joints) + lips * 2
    assert len(nuts) == m3 * (device.hardware.screw.kind == "nut") + len(device.back.items)
    for item in nuts:
        placed = Location(Plane(*(tuple(item.rig_from_item[:3, column]) for column in (3, 0, 2))))
        nut = item_solid(item)
        part = made[item.joins[-1]]
        assert common_mm3(part, placed * nut) == pytest.approx(0.0, abs=1e-6)
        assert common_mm3(part, placed * Rotation(0.0, 0.0, 30.0) * nut) > 0.3


def common_mm3(part: Part, other: Part) -> float:
    return float(sum(solid.volume for solid in part.intersect(other) or []))


def test_every_part_stands_on_the_bed_and_has_its_own_number(device: Device) -> None:
    parts = parts_of(device)
    assert len({part.number for part in parts}) == len({part.name for part in parts}) == len(parts)
    for part in parts:
        turn = part.print_from_rig[:3, :3]
        np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-9)
        assert np.linalg.det(turn) == pytest.approx(1.0)
        if part.name in ("mirror_holder", "dust_cover"):
            continue
        printed = part.make(part.plan).bounding_box()
        corners = np.array(
            [
                (x, y, z)
                for x in (printed.min.X, printed.max.X)
                for y in (printed.min.Y, printed.max.Y)
                for z in (printed.min.Z, printed.max.Z)
            ]
        )
        low = (corners @ turn.T + part.print_from_rig[:3, 3])[:, 2].min()
        assert low == pytest.approx(0.0, abs=1e-6)
