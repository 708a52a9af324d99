"""Text of STEP files: the same whatever was written before.

The STEP assembly, read back: labels, colours, volumes and places; and its text in one order.
"""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from build123d import CenterOf, LinearJoint, Shape, Solid, import_step
from shapely import Polygon

from mirrorcam.cad.assembly.device_plan import Device
from mirrorcam.cad.assembly.pieces import MIRROR_RGB
from mirrorcam.cad.plan.back_table import Gen2Back
from mirrorcam.cad.plan.part_plan import BoughtItem, BuiltPart, Connection
from mirrorcam.cad.write import step_assembly
from mirrorcam.cad.write.step_assembly import assemble, connect, location_of, ordered_step, write_assembly
from mirrorcam.core.names import LONGEST
from mirrorcam.optics.geometry.transforms import rigid
from tests.cad.write.freecad import LISTED, NEEDS_FREECAD, run_in_freecad

GEOMETRY = """#1 = SOLID('it''s #3',#2);
#2 = POINT('',(0.,1.),
  $);
#3 = SOLID('b',#2);
#4 = NEXT_ASSEMBLY_USAGE_OCCURRENCE('{0}','a','',#1,#3,$);
#5 = NEXT_ASSEMBLY_USAGE_OCCURRENCE('{1}','b','',#3,#1,$);
"""


COLOUR = "MECHANICAL_DESIGN_GEOMETRIC_PRESENTATION_REPRESENTATION"


def step(counts: tuple[int, int], colours: str) -> str:
    return f"ISO-10303-21;\nHEADER;\nENDSEC;\nDATA;\n{GEOMETRY.format(*counts)}{colours}ENDSEC;\nEND-ISO-10303-21;\n"


def test_counts_and_the_order_of_colours_leave_no_trace() -> None:
    colours = (
        f"#6 = {COLOUR}((#7));\n#7 = ITEM(#8,#{{}});\n#8 = RGB(1.);\n#9 = {COLOUR}((#10));\n#10 = ITEM(#8,#{{}});\n"
    )
    one, two = step((1, 2), colours.format(1, 3)), step((7, 8), colours.format(3, 1))
    assert one != two
    assert ordered_step(one) == ordered_step(two)
    assert "#1 = SOLID('it''s #3',#2);\n#2 = POINT('',(0.,1.),$);" in ordered_step(two)
    assert "OCCURRENCE('1','a'" in ordered_step(two)
    # What differs in more than that still differs.
    assert ordered_step(step((1, 2), colours.format(1, 1))) != ordered_step(two)


SCREW_AT = np.array([[0.0, 0.0, 1.0, 10.0], [0.0, 1.0, 0.0, 20.0], [-1.0, 0.0, 0.0, 30.0], [0.0, 0.0, 0.0, 1.0]])


PRINTED = ("mirror_holder_1", "mirror_holder_2", "mount", "camera_clip", "adapter_desk")


def screw(place: np.ndarray, *joins: str) -> BoughtItem:
    return BoughtItem("screw", "M3", 12.0, place, np.zeros(3), joins)


@pytest.fixture(scope="module")
def parts(built_block: BuiltPart, tmp_path_factory: pytest.TempPathFactory) -> list[BuiltPart]:
    """The block in the stead of every part."""
    folder = tmp_path_factory.mktemp("assembly")
    names = (*PRINTED, "fit_coupon")
    for name in names:
        shutil.copy(built_block.step, folder / f"{name}.step")
    return [built_block.replaced(name=name, folder=folder) for name in names]


@pytest.fixture
def screws(monkeypatch: pytest.MonkeyPatch) -> None:
    items = (screw(SCREW_AT, "mirror_holder"), screw(np.eye(4), "camera_clip", "mount"))
    monkeypatch.setattr(step_assembly, "bought_items", lambda _: items)


def rgb_of(shape: Shape[Any]) -> list[float]:
    assert shape.color is not None
    return list(shape.color)[:3]


def leaves(path: Path) -> dict[str, Shape[Any]]:
    root = import_step(path)
    assert root.label == "mirrorcam"
    assert [group.label for group in root.children] == ["printed", "mirrors", "bought"]
    return {leaf.label: leaf for group in root.children for leaf in group.children}


@pytest.mark.usefixtures("screws")
def test_everything_is_there_in_its_place_and_colour(device: Device, parts: list[BuiltPart], tmp_path: Path) -> None:
    write_assembly(tmp_path / "assembly.step", device, parts)
    found = leaves(tmp_path / "assembly.step")
    mirrors = [f"mirror_{name}" for name in device.layout.mirror_names]
    assert list(found) == [*(*PRINTED, *mirrors, "camera", "screw_01", "screw_02")]
    # The connections of the real device move nothing: every part is made where it belongs.
    for name in PRINTED:
        assert found[name].volume == pytest.approx(18000.0)
        np.testing.assert_allclose(tuple(found[name].center(CenterOf.MASS)), [31.0, 17.0, 8.0], atol=1e-6)
        np.testing.assert_allclose(rgb_of(found[name]), parts[0].rgb, atol=1e-3)
    for name, mirror in zip(mirrors, device.layout.mirrors, strict=True):
        outline = Polygon(mirror.outline_in_plane_mm)
        assert found[name].volume == pytest.approx(outline.area * mirror.thickness_mm, rel=1e-6)
        np.testing.assert_allclose(rgb_of(found[name]), MIRROR_RGB, atol=1e-3)
        corners = np.array([tuple(vertex) for vertex in found[name].vertices()])
        for corner in mirror.outline_in_rig_mm:
            assert np.linalg.norm(corners - corner, axis=1).min() < 1e-6
        # A first-surface sheet lies behind its reflecting plane.
        heights = corners @ mirror.normal_in_rig + mirror.distance_mm
        np.testing.assert_allclose([heights.min(), heights.max()], [-mirror.thickness_mm, 0.0], atol=1e-6)
    # The screw's z is the rig's x: 12 mm of shank, 3 mm of head.
    box = found["screw_01"].bounding_box()
    np.testing.assert_allclose([box.min.X, box.max.X], [-2.0, 13.0], atol=1e-6)
    np.testing.assert_allclose(tuple(box.center())[1:], [20.0, 30.0], atol=1e-6)


@NEEDS_FREECAD
@pytest.mark.usefixtures("screws")
def test_freecad_shows_the_tree_and_reads_every_piece(device: Device, parts: list[BuiltPart], tmp_path: Path) -> None:
    write_assembly(tmp_path / "assembly.step", device, parts)
    script = "found = listed('assembly.step', FreeCAD.newDocument('device'))"
    shown = {each["label"]: each for each in run_in_freecad(f"{LISTED}\n{script}", tmp_path)}
    written = leaves(tmp_path / "assembly.step")
    assert shown.keys() == {"mirrorcam", "printed", "mirrors", "bought", *written}
    assert shown["mirrorcam"]["within"] == []
    for group in ("printed", "mirrors", "bought"):
        assert shown[group]["within"] == ["mirrorcam"]
    for name, shape in written.items():
        piece = shown[name]
        group = "printed" if name in PRINTED else "mirrors" if name.startswith("mirror_") else "bought"
        assert piece["within"] == [group]
        assert (piece["kind"], piece["solids"], piece["closed"], piece["valid"]) == ("Solid", 1, [True], True)
        assert piece["volume"] == pytest.approx(shape.volume, rel=1e-9)
        np.testing.assert_allclose(piece["centre"], tuple(shape.center(CenterOf.MASS)), atol=1e-6)


@pytest.mark.usefixtures("screws")
def test_the_same_device_gives_the_same_bytes_whatever_was_made_before(
    device: Device, parts: list[BuiltPart], tmp_path: Path
) -> None:
    for name in ("first", "second", "third"):
        write_assembly(tmp_path / f"{name}.step", device, parts)
    assert len({file.read_bytes() for file in tmp_path.glob("*.step")}) == 1


@pytest.mark.usefixtures("screws")
@pytest.mark.parametrize("name", ["'); DROP", "Spiegel ä 鏡 🪞", "W" * LONGEST])
def test_names_of_others_are_not_in_it(name: str, device: Device, parts: list[BuiltPart], tmp_path: Path) -> None:
    hardware = device.hardware
    named = hardware.replaced(
        camera=hardware.camera.replaced(name=name),
        printer=hardware.printer.replaced(plastic=name),
        back=Gen2Back(name=name),
    )
    write_assembly(tmp_path / "assembly.step", device, parts)
    write_assembly(tmp_path / "named.step", replace(device, hardware=named), parts)
    assert list(leaves(tmp_path / "named.step")) == list(leaves(tmp_path / "assembly.step"))
    plain = (tmp_path / "assembly.step").read_bytes()
    assert (tmp_path / "named.step").read_bytes() == plain.replace(b"assembly.step", b"named.step")


def test_a_screw_in_no_printed_part_is_a_bug(
    device: Device, parts: list[BuiltPart], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(step_assembly, "bought_items", lambda _: (screw(np.eye(4), "adapter_lid"),))
    with pytest.raises(ValueError, match=r"names=\('adapter_lid',\) are no printed parts, expected one of mirror_hol"):
        write_assembly(tmp_path / "assembly.step", device, parts)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.usefixtures("screws")
def test_parts_are_joined_by_their_connections(
    device: Device, parts: list[BuiltPart], monkeypatch: pytest.MonkeyPatch
) -> None:
    parent, child = rigid(np.eye(3), [1.0, 2.0, 3.0]), rigid(np.eye(3), [1.0, 2.0, 5.0])
    monkeypatch.setattr(
        step_assembly, "connections", lambda _: (Connection("slide", "mount", "camera_clip", parent, child),)
    )
    found = {leaf.label: leaf for group in assemble(device, parts).children for leaf in group.children}
    np.testing.assert_allclose(tuple(found["mount"].center(CenterOf.MASS)), [31.0, 17.0, 8.0], atol=1e-9)
    np.testing.assert_allclose(tuple(found["camera_clip"].center(CenterOf.MASS)), [31.0, 17.0, 6.0], atol=1e-9)


@pytest.mark.usefixtures("screws")
def test_the_clip_slides_on_the_mount_along_the_lens_axis_as_far_as_it_may(
    device: Device, parts: list[BuiltPart]
) -> None:
    found = {leaf.label: leaf for group in assemble(device, parts).children for leaf in group.children}
    mount, clip = found["mount"], found["camera_clip"]
    slide, carried = mount.joints["slide"], clip.joints["slide"]
    assert isinstance(slide, LinearJoint)
    travel = device.hardware.clip.travel_mm
    assert slide.linear_range == (-travel, travel)
    assert slide.position == 0.0
    before = np.array(tuple(clip.center(CenterOf.MASS)))
    for by in (-travel, 1.5, travel):
        slide.connect_to(carried, position=by)
        np.testing.assert_allclose(tuple(clip.center(CenterOf.MASS)), np.add(before, (0.0, 0.0, by)), atol=1e-9)
    with pytest.raises(ValueError, match="in range"):
        slide.connect_to(carried, position=travel + 0.1)
    others = {name: joint for leaf in found.values() for name, joint in leaf.joints.items() if name != "slide"}
    assert {"back", "foot"} < set(others)
    assert not any(isinstance(joint, LinearJoint) for joint in others.values())


def test_what_slides_is_turned_as_its_connection_says() -> None:
    """The child's frame comes to lie on the parent's, however both are turned."""
    rng = np.random.default_rng(3)
    frames = [np.eye(4), np.eye(4)]
    for frame in frames:
        turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
        frame[:3, :3] = turn * np.sign(np.linalg.det(turn))
        frame[:3, 3] = rng.uniform(-50.0, 50.0, 3)
    parent, child = Solid.make_box(10.0, 20.0, 30.0), Solid.make_box(3.0, 2.0, 1.0)
    connect(Connection("slide", "mount", "camera_clip", frames[0], frames[1], 4.0), parent, child)
    expected = location_of(frames[0] @ np.linalg.inv(frames[1]))
    np.testing.assert_allclose(tuple(child.location.position), tuple(expected.position), atol=1e-9)
    np.testing.assert_allclose(tuple(child.location.orientation), tuple(expected.orientation), atol=1e-9)
