"""Text of STEP files: independent of files written before.

The STEP assembly, read back: labels, colours, volumes and positions; and the order of its text.

The GLB, read back: metres and +Y up, every component a node with the data for a page.
"""

from __future__ import annotations

import json
import shutil
import struct
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from build123d import CenterOf, LinearJoint, Shape, Solid, import_step
from shapely import Polygon

from mirrorcam.cad.assembly.components import MIRROR_RGB, Component, mesh_of
from mirrorcam.cad.assembly.device_plan import Device
from mirrorcam.cad.plan.back_table import Gen2Back
from mirrorcam.cad.plan.part_plan import BuiltPart, Connection, PurchasedItem
from mirrorcam.cad.plan.seats import mirror_prism
from mirrorcam.cad.plan.stand import rig_from_stand
from mirrorcam.cad.write import assembly_files
from mirrorcam.cad.write.assembly_files import (
    GLTF_FROM_STAND,
    assemble,
    connect,
    linear,
    location_of,
    ordered_step,
    write_assembly,
    write_glb,
)
from mirrorcam.core.names import LONGEST
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.transforms import rigid
from tests.cad.write.freecad import LISTED, run_in_freecad
from tests.cad.write.needs_freecad import NEEDS_FREECAD
from tests.hostile_names import ACCEPTED

LEAN_DEG = 30.0

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
    # Texts with other differences still differ.
    assert ordered_step(step((1, 2), colours.format(1, 1))) != ordered_step(two)


SCREW_AT = np.array([[0.0, 0.0, 1.0, 10.0], [0.0, 1.0, 0.0, 20.0], [-1.0, 0.0, 0.0, 30.0], [0.0, 0.0, 0.0, 1.0]])


PRINTED = ("mirror_holder_1", "mirror_holder_2", "mount", "camera_clip", "adapter_desk")


def screw(place: np.ndarray, *joins: str) -> PurchasedItem:
    return PurchasedItem("screw", "M3", 12.0, place, np.zeros(3), joins)


@pytest.fixture(scope="module")
def parts(built_block: BuiltPart, tmp_path_factory: pytest.TempPathFactory) -> list[BuiltPart]:
    """The block in place of every part."""
    folder = tmp_path_factory.mktemp("assembly")
    names = (*PRINTED, "fit_coupon")
    for name in names:
        shutil.copy(built_block.step, folder / f"{name}.step")
    return [built_block.replaced(name=name, folder=folder) for name in names]


@pytest.fixture
def screws(monkeypatch: pytest.MonkeyPatch) -> None:
    items = (screw(SCREW_AT, "mirror_holder"), screw(np.eye(4), "camera_clip", "mount"))
    monkeypatch.setattr(assembly_files, "purchased_items", lambda _: items)


def rgb_of(shape: Shape[Any]) -> list[float]:
    assert shape.color is not None
    return list(shape.color)[:3]


def leaves(path: Path) -> dict[str, Shape[Any]]:
    root = import_step(path)
    assert root.label == "mirrorcam"
    assert [group.label for group in root.children] == ["printed", "mirrors", "bought"]
    return {leaf.label: leaf for group in root.children for leaf in group.children}


@pytest.mark.usefixtures("screws")
def test_every_piece_has_its_position_and_colour(device: Device, parts: list[BuiltPart], tmp_path: Path) -> None:
    write_assembly(tmp_path / "assembly.step", device, parts)
    found = leaves(tmp_path / "assembly.step")
    mirrors = [f"mirror_{name}" for name in device.layout.mirror_names]
    assert list(found) == [*(*PRINTED, *mirrors, "camera", "screw_01", "screw_02")]
    # The connections of the real device move nothing: every part is made in place.
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
        # A first-surface sheet is behind its reflecting plane.
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
        component = shown[name]
        group = "printed" if name in PRINTED else "mirrors" if name.startswith("mirror_") else "bought"
        assert component["within"] == [group]
        assert (component["kind"], component["solids"], component["closed"], component["valid"]) == (
            "Solid",
            1,
            [True],
            True,
        )
        assert component["volume"] == pytest.approx(shape.volume, rel=1e-9)
        np.testing.assert_allclose(component["centre"], tuple(shape.center(CenterOf.MASS)), atol=1e-6)


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
    monkeypatch.setattr(assembly_files, "purchased_items", lambda _: (screw(np.eye(4), "adapter_lid"),))
    with pytest.raises(ValueError, match=r"names=\('adapter_lid',\) are not printed parts, expected one of mirror_hol"):
        write_assembly(tmp_path / "assembly.step", device, parts)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.usefixtures("screws")
def test_parts_are_joined_by_their_connections(
    device: Device, parts: list[BuiltPart], monkeypatch: pytest.MonkeyPatch
) -> None:
    parent, child = rigid(np.eye(3), [1.0, 2.0, 3.0]), rigid(np.eye(3), [1.0, 2.0, 5.0])
    monkeypatch.setattr(
        assembly_files, "connections", lambda _: (Connection("slide", "mount", "camera_clip", parent, child),)
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


def test_a_sliding_part_has_the_orientation_of_its_connection() -> None:
    """The child's frame coincides with the parent's, for any rotations."""
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


@pytest.fixture(scope="module")
def components(default_layout: Layout, built_block: BuiltPart) -> tuple[Component, ...]:
    mirrors = tuple(
        Component(
            name=f"mirror_0-{index}",
            kind="mirror",
            number=f"M0-{index}",
            title=f"Mirror 0-{index}",
            rgb=(0.8, 0.9, 1.0),
            explode_mm=30.0 * mirror.normal_in_rig,
            mesh=mesh_of(mirror_prism(mirror)),
            mass=built_block.mass,
        )
        for index, mirror in enumerate(default_layout.mirrors[:2])
    )
    block = Component(
        name="block",
        kind="part",
        number="MC-99",
        title="Block",
        rgb=built_block.rgb,
        explode_mm=built_block.explode_mm,
        mesh=trimesh.load_mesh(built_block.stl),
        mass=built_block.mass,
    )
    return block, *mirrors


@pytest.fixture(scope="module")
def written(components: tuple[Component, ...], tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("gltf") / "assembly.glb"
    write_glb(path, components, rig_from_stand(LEAN_DEG))
    return path


def tree_of(path: Path) -> dict[str, Any]:
    data = path.read_bytes()
    magic, version, length, size, kind = struct.unpack("<4sIII4s", data[:20])
    assert (magic, version, length, kind) == (b"glTF", 2, len(data), b"JSON")
    return dict(json.loads(data[20 : 20 + size]))


def test_it_is_in_metres_with_y_up_and_looks_along_z(written: Path, components: tuple[Component, ...]) -> None:
    scene = trimesh.load_scene(written)
    for component in components:
        matrix, geometry = scene.graph[component.name]
        found = trimesh.transform_points(scene.geometry[geometry].vertices, matrix)
        stand = component.mesh.vertices @ rig_from_stand(LEAN_DEG)
        # Up is the stand's z, the scene is along its y; x follows for a right-handed frame.
        expected = np.column_stack([-stand[:, 0], stand[:, 2], stand[:, 1]]) / 1000.0
        np.testing.assert_allclose(found.min(axis=0), expected.min(axis=0), atol=1e-7)
        np.testing.assert_allclose(found.max(axis=0), expected.max(axis=0), atol=1e-7)
    assert np.linalg.det(GLTF_FROM_STAND[:3, :3]) == pytest.approx(1e-9)


def test_every_piece_is_a_node_below_the_device(written: Path, components: tuple[Component, ...]) -> None:
    tree = tree_of(written)
    nodes = {node["name"]: node for node in tree["nodes"]}
    assert [tree["nodes"][index]["name"] for index in tree["scenes"][0]["nodes"]] == ["device"]
    assert [tree["nodes"][index]["name"] for index in nodes["device"]["children"]] == [p.name for p in components]
    turn = np.eye(4)
    turn[:3, :3] = rig_from_stand(LEAN_DEG).T
    np.testing.assert_allclose(np.array(nodes["device"]["matrix"]).reshape(4, 4).T, GLTF_FROM_STAND @ turn)
    for component in components:
        extras = nodes[component.name]["extras"]
        assert set(extras) == {"kind", "number", "title", "explode_mm"}
        assert (extras["kind"], extras["number"], extras["title"]) == (
            component.kind,
            component.number,
            component.title,
        )
        np.testing.assert_allclose(extras["explode_mm"], component.explode_mm, atol=1e-4)
        assert "matrix" not in nodes[component.name]


def test_a_reader_finds_any_title_as_it_is(components: tuple[Component, ...], tmp_path: Path) -> None:
    titled = [replace(components[0], name=f"piece_{number}", title=title) for number, title in enumerate(ACCEPTED)]
    write_glb(tmp_path / "titles.glb", titled, np.eye(3))
    found = {node["name"]: node.get("extras", {}).get("title") for node in tree_of(tmp_path / "titles.glb")["nodes"]}
    assert [found[component.name] for component in titled] == list(ACCEPTED)
    assert set(trimesh.load_scene(tmp_path / "titles.glb").graph.nodes_geometry) == {
        component.name for component in titled
    }


def test_mirrors_are_metal_and_colours_are_linear(written: Path, components: tuple[Component, ...]) -> None:
    tree = tree_of(written)
    for component in components:
        (node,) = (node for node in tree["nodes"] if node["name"] == component.name)
        (primitive,) = tree["meshes"][node["mesh"]]["primitives"]
        finish = tree["materials"][primitive["material"]]["pbrMetallicRoughness"]
        assert (finish["metallicFactor"] == 1.0) == (component.kind == "mirror")
        np.testing.assert_allclose(finish["baseColorFactor"], [*linear(np.array(component.rgb)), 1.0], atol=1e-6)
    np.testing.assert_allclose(linear(np.array([0.0, 0.5, 1.0])), [0.0, 0.2140, 1.0], atol=1e-4)


def test_flat_faces_look_flat(written: Path) -> None:
    block = trimesh.load_scene(written).geometry["block"]
    # Three of six flat faces meet at each of eight corners: each corner occurs once per face.
    assert len(block.vertices) == 24
    assert sorted({tuple(normal) for normal in np.round(block.vertex_normals).astype(int).tolist()}) == sorted(
        [(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)]
    )


def test_normals_are_units_even_where_a_facet_has_no_area(components: tuple[Component, ...], tmp_path: Path) -> None:
    # A square with one side split by a point on it: one facet is degenerate.
    corners = np.array([[0.0, 0.0, 0.0], [9.0, 0.0, 0.0], [9.0, 9.0, 0.0], [0.0, 9.0, 0.0], [4.0, 0.0, 0.0]])
    mesh = trimesh.Trimesh(corners, [[0, 1, 2], [0, 2, 3], [0, 4, 1]], process=False)
    write_glb(tmp_path / "flat.glb", [replace(components[0], mesh=mesh)], np.eye(3))
    found = trimesh.load_scene(tmp_path / "flat.glb", process=False).geometry["block"]
    assert len(found.faces) == 3
    np.testing.assert_allclose(np.linalg.norm(found.vertex_normals, axis=1), 1.0, atol=1e-6)


def test_bytes_say_what_they_are_for(written: Path) -> None:
    tree = tree_of(written)
    for mesh in tree["meshes"]:
        (primitive,) = mesh["primitives"]
        for accessor, target in ((primitive["indices"], 34963), (primitive["attributes"]["NORMAL"], 34962)):
            assert tree["bufferViews"][tree["accessors"][accessor]["bufferView"]]["target"] == target


def test_the_same_pieces_give_the_same_bytes_and_no_path(
    written: Path, components: tuple[Component, ...], tmp_path: Path
) -> None:
    write_glb(tmp_path / "again.glb", components, rig_from_stand(LEAN_DEG))
    assert (tmp_path / "again.glb").read_bytes() == written.read_bytes()
    assert str(tmp_path.parent.parent).encode() not in written.read_bytes()
    assert b"block.stl" not in written.read_bytes()
