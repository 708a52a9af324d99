"""3MF files, read back by lib3mf in strict mode and sliced.

Print plates: every part once, within the bed and apart, in projects with settings that a slicer accepts.
"""

from __future__ import annotations

import json
import locale
import shutil
import subprocess
import xml.etree.ElementTree as ET
import zipfile
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import lib3mf
import numpy as np
import pytest
import trimesh

from mirrorcam.cad.assembly.catalogue import parts_of
from mirrorcam.cad.assembly.device_plan import Device
from mirrorcam.cad.plan.hardware import HARDWARE, Printer
from mirrorcam.cad.plan.part_plan import BuiltPart, PartPlan
from mirrorcam.cad.write.slicer import check_slicing, find_slicer
from mirrorcam.cad.write.threemf import (
    CONFIG,
    GAP_MM,
    Plate,
    body_on_bed,
    check_plates,
    on_bed,
    plan_plates,
    write_3mf,
    write_plates,
)
from mirrorcam.core.values import Metric
from mirrorcam.optics.geometry.layout import Layout
from tests.hostile_names import ACCEPTED

BED = HARDWARE.printer.bed_mm


@pytest.fixture(scope="module")
def written(block: PartPlan, built_block: BuiltPart, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("threemf") / "block.3mf"
    write_3mf(path, built_block.stl, block, HARDWARE.printer)
    return path


def read(path: Path) -> Any:
    model = lib3mf.get_wrapper().CreateModel()
    reader = model.QueryReader("3mf")
    reader.SetStrictModeActive(True)
    reader.ReadFromFile(str(path))
    assert reader.GetWarningCount() == 0
    return model


def test_writing_leaves_the_locale_of_the_process_alone(
    block: PartPlan, built_block: BuiltPart, tmp_path: Path
) -> None:
    before = locale.setlocale(locale.LC_ALL)
    try:
        locale.setlocale(locale.LC_ALL, "C.UTF-8")
        write_3mf(tmp_path / "block.3mf", built_block.stl, block, HARDWARE.printer)
        assert locale.getpreferredencoding(False) == "UTF-8"
    finally:
        locale.setlocale(locale.LC_ALL, before)


def test_it_lies_as_it_prints_amid_the_bed(written: Path) -> None:
    model = read(written)
    assert model.GetUnit() == lib3mf.ModelUnit.MilliMeter
    items = model.GetBuildItems()
    assert items.MoveNext()
    item = items.GetCurrent()
    assert not items.MoveNext()
    body = model.GetMeshObjectByID(item.GetObjectResourceID())
    assert body.IsManifoldAndOriented()
    assert body.GetTriangleCount() == 12
    placed = item.GetOutbox()
    # The box of 60 x 30 x 10 mm is on its 60 x 10 mm side.
    size = np.array(list(placed.MaxCoordinate)) - np.array(list(placed.MinCoordinate))
    np.testing.assert_allclose(size, [60.0, 10.0, 30.0], atol=1e-4)
    np.testing.assert_allclose(list(placed.MinCoordinate), [BED[0] / 2 - 30.0, BED[1] / 2 - 5.0, 0.0], atol=1e-4)


def test_the_model_has_its_metadata(written: Path, block: PartPlan) -> None:
    model = read(written)
    group = model.GetMetaDataGroup()
    texts = {group.GetMetaData(i).GetName(): group.GetMetaData(i).GetValue() for i in range(group.GetMetaDataCount())}
    assert texts["Title"] == "Block"
    assert texts["Designer"] == "MirrorCam"
    assert texts["LicenseTerms"] == "CERN-OHL-W-2.0"
    for word in ("MC-99", block.identity, "PLA", "60.0 x 10.0 x 30.0 mm", "without support"):
        assert word in texts["Description"]
    bodies = model.GetMeshObjects()
    assert bodies.MoveNext()
    body = bodies.GetCurrentMeshObject()
    assert (body.GetName(), body.GetPartNumber()) == ("block", "MC-99")
    resource, place, _ = body.GetObjectLevelProperty()
    colour = model.GetBaseMaterialGroupByID(resource).GetDisplayColor(place)
    assert (colour.Red, colour.Green, colour.Blue) == (51, 102, 153)


@pytest.mark.parametrize("name", ACCEPTED)
def test_a_reader_finds_any_name_of_a_material_as_it_is(
    name: str, block: PartPlan, built_block: BuiltPart, tmp_path: Path
) -> None:
    printer = Printer.model_validate_json(json.dumps({"plastic": name}))
    write_3mf(tmp_path / "block.3mf", built_block.stl, block, printer)
    model = read(tmp_path / "block.3mf")
    bodies = model.GetMeshObjects()
    assert bodies.MoveNext()
    resource, place, _ = bodies.GetCurrentMeshObject().GetObjectLevelProperty()
    assert model.GetBaseMaterialGroupByID(resource).GetName(place) == name
    group = model.GetMetaDataGroup()
    texts = [group.GetMetaData(i).GetValue() for i in range(group.GetMetaDataCount())]
    assert any(f" support: {name}, 60.0 x" in text for text in texts)
    with zipfile.ZipFile(tmp_path / "block.3mf") as archive:
        tree = ElementTree.fromstring(archive.read("3D/3dmodel.model"))
    assert [each.get("name") for each in tree.iter() if each.tag.endswith("}base")] == [name]


def test_the_same_part_gives_the_same_bytes_and_a_different_part_different_ids(
    written: Path, block: PartPlan, built_block: BuiltPart, tmp_path: Path
) -> None:
    write_3mf(tmp_path / "again.3mf", built_block.stl, block, HARDWARE.printer)
    assert (tmp_path / "again.3mf").read_bytes() == written.read_bytes()
    grown = replace(block, plan=replace(block.plan, high=block.plan.high + 1.0))
    write_3mf(tmp_path / "grown.3mf", built_block.stl, grown, HARDWARE.printer)
    assert read(tmp_path / "grown.3mf").GetBuildUUID() != read(written).GetBuildUUID()


def test_a_part_turns_where_only_that_fits(block: PartPlan) -> None:
    points = np.array([[0.0, 0.0, 0.0], [200.0, 20.0, 90.0]])
    narrow = HARDWARE.printer.replaced(bed_mm=(100.0, 250.0, 250.0))
    np.testing.assert_allclose(np.ptp(on_bed(points, block, narrow), axis=0), [90.0, 200.0, 20.0])
    np.testing.assert_allclose(np.ptp(on_bed(points, block, HARDWARE.printer), axis=0), [200.0, 90.0, 20.0])
    # A part that fits in neither orientation is not rotated.
    small = HARDWARE.printer.replaced(bed_mm=(50.0, 60.0, 250.0))
    np.testing.assert_allclose(np.ptp(on_bed(points, block, small), axis=0), [200.0, 90.0, 20.0])


def test_a_turn_is_not_a_mirror_image(block: PartPlan) -> None:
    points = np.array([[0.0, 0.0, 0.0], [200.0, 0.0, 0.0], [0.0, 0.0, 90.0], [0.0, 20.0, 0.0]])
    narrow = HARDWARE.printer.replaced(bed_mm=(100.0, 250.0, 250.0))
    for printer in (HARDWARE.printer, narrow):
        edges = np.diff(on_bed(points, block, printer), axis=0)
        before = np.diff(points, axis=0)
        assert np.linalg.det(edges) == pytest.approx(np.linalg.det(before))


@pytest.mark.skipif(shutil.which("prusa-slicer") is None, reason="prusa-slicer is not installed")
def test_a_slicer_takes_it(written: Path, tmp_path: Path) -> None:
    gcode = tmp_path / "block.gcode"
    command = ["prusa-slicer", "--export-gcode", "--bed-shape", f"0x0,{BED[0]}x0,{BED[0]}x{BED[1]},0x{BED[1]}"]
    subprocess.run([*command, "--output", str(gcode), str(written)], check=True, capture_output=True, timeout=120)
    heights = [
        float(line.split(":")[1]) for line in gcode.read_text(encoding="utf-8").splitlines() if line.startswith(";Z:")
    ]
    assert max(heights) == pytest.approx(30.0, abs=0.3)


Built = tuple[Layout, Path, dict[str, Metric]]
SMALL_BED = HARDWARE.printer.replaced(bed_mm=(70.0, 50.0, 100.0))


@pytest.fixture
def copies(block: PartPlan, built_block: BuiltPart) -> tuple[list[PartPlan], Path]:
    """Five parts of 60 x 10 mm on the bed."""
    return [block] * 5, built_block.stl.parent


def failed(checks: dict[str, Metric]) -> set[str]:
    return {name for name, check in checks.items() if not check.passed}


def test_parts_share_a_bed_until_it_is_full(copies: tuple[list[PartPlan], Path]) -> None:
    parts, folder = copies
    (all_five,) = plan_plates(parts, folder, HARDWARE.printer)
    assert len(all_five.bodies) == 5
    plates = plan_plates(parts, folder, SMALL_BED)
    assert [len(plate.bodies) for plate in plates] == [3, 2]  # 3 x 10 + 2 x 6 = 42 of 50 mm
    assert failed(check_plates(plates, SMALL_BED)) == set()


def test_a_part_may_reach_to_the_edge_of_the_bed(block: PartPlan, built_block: BuiltPart) -> None:
    printer = HARDWARE.printer.replaced(bed_mm=(60.0, 26.0, 30.0))
    plates = plan_plates([block, block], built_block.stl.parent, printer)
    assert [len(plate.bodies) for plate in plates] == [2]
    assert failed(check_plates(plates, printer)) == set()


def test_parts_too_near_or_off_the_bed_are_seen(block: PartPlan, built_block: BuiltPart) -> None:
    body = body_on_bed(built_block.stl, block, HARDWARE.printer)
    near = body.transformed(np.eye(2), np.array([0.0, 10.0 + GAP_MM - 0.1]))
    assert failed(check_plates([Plate((body, near))], HARDWARE.printer)) == {"part_gap_mm"}
    off = body.transformed(np.eye(2), np.array([0.0, 106.0]))
    assert failed(check_plates([Plate((body, off))], HARDWARE.printer)) == {"beyond_bed_mm"}
    high = replace(body, points=body.points - (0.0, 0.0, 0.1))
    assert failed(check_plates([Plate((high,))], HARDWARE.printer)) == {"beyond_bed_mm"}


def test_a_project_holds_the_settings(block: PartPlan, built_block: BuiltPart, tmp_path: Path) -> None:
    for name in ("first", "second"):
        (tmp_path / name / "parts").mkdir(parents=True)
        (tmp_path / name / "parts" / "block.stl").write_bytes(built_block.stl.read_bytes())
        write_plates(tmp_path / name, [block], HARDWARE.printer)
    path = tmp_path / "first" / "plates" / "plate_1.3mf"
    assert path.read_bytes() == (tmp_path / "second" / "plates" / "plate_1.3mf").read_bytes()
    with zipfile.ZipFile(path) as archive:
        config = archive.read(CONFIG.removeprefix("/")).decode()
    assert "; perimeters = 2\n" in config
    assert "perimeters = 2\n" in (tmp_path / "first" / "plates" / "mirrorcam.ini").read_text(encoding="utf-8")


def test_a_project_is_plain_geometry_to_other_slicers(block: PartPlan, built_block: BuiltPart, tmp_path: Path) -> None:
    """The criteria of the reader of OrcaSlicer 2.2.0 (commit 1088d0a6c713, src/libslic3r/Format/bbs_3mf.cpp).

    It reads every relationship of a type that starts and ends as below as a model. A file whose metadata name it as the
    application is read as its own, with settings in its own paths.
    """
    (tmp_path / "parts").mkdir()
    parts = [replace(block, name=f"block_{number}") for number in range(2)]
    for part in parts:
        (tmp_path / "parts" / f"{part.name}.stl").write_bytes(built_block.stl.read_bytes())
    write_plates(tmp_path, parts, HARDWARE.printer)
    with zipfile.ZipFile(tmp_path / "plates" / "plate_1.3mf") as archive:
        related = [
            (each.attrib["Type"], each.attrib["Target"])
            for path in ("_rels/.rels", "3D/_rels/3dmodel.model.rels")
            for each in ET.fromstring(archive.read(path))
        ]
        model = ET.fromstring(archive.read("3D/3dmodel.model"))
    schema = "http://schemas.microsoft.com/3dmanufacturing/"
    models = [target for kind, target in related if kind.startswith(schema) and kind.endswith("3dmodel")]
    assert models == ["/3D/3dmodel.model"]
    names = {"": f"{schema}core/2015/02"}
    assert model.attrib["unit"] == "millimeter"
    assert "requiredextensions" not in model.attrib
    assert "Application" not in [each.attrib["name"] for each in model.findall("metadata", names)]
    meshes = {}
    for thing in model.findall("resources/object", names):
        assert thing.attrib["type"] == "model"
        points = [[float(at.attrib[axis]) for axis in "xyz"] for at in thing.findall("mesh/vertices/vertex", names)]
        faces = [
            [int(at.attrib[k]) for k in ("v1", "v2", "v3")] for at in thing.findall("mesh/triangles/triangle", names)
        ]
        meshes[thing.attrib["id"]] = trimesh.Trimesh(points, faces)
    items = model.findall("build/item", names)
    assert len(items) == len(meshes) == 2
    for item in items:
        mesh = meshes[item.attrib["objectid"]]
        matrix = np.array(item.attrib["transform"].split(), dtype=float).reshape(4, 3)
        np.testing.assert_array_equal(matrix[:3], np.eye(3))
        low, high = mesh.bounds + matrix[3]
        assert mesh.volume == pytest.approx(18000.0)
        np.testing.assert_allclose(low[2], 0.0, atol=1e-4)
        assert (low >= -1e-4).all()
        assert (high <= HARDWARE.printer.bed_mm).all()


def test_the_plates_of_the_default_device_hold_every_part_once(built_default: Built, device: Device) -> None:
    _, folder, checks = built_default
    plans = [part for part in parts_of(device) if part.name != "fit_coupon"]
    plates = plan_plates(plans, folder / "parts", HARDWARE.printer)
    assert Counter(body.part.name for plate in plates for body in plate.bodies) == Counter(p.name for p in plans)
    assert checks["plates.number"].value == len(plates)
    assert sorted(path.name for path in (folder / "plates").glob("*.3mf")) == [
        f"plate_{number}.3mf" for number in range(1, len(plates) + 1)
    ]


@pytest.mark.skipif(find_slicer() is None, reason="needs PrusaSlicer")
def test_a_slicer_takes_the_settings_of_a_project(block: PartPlan, built_block: BuiltPart, tmp_path: Path) -> None:
    (tmp_path / "parts").mkdir()
    parts = [replace(block, name=f"block_{number}") for number in range(3)]
    for part in parts:
        (tmp_path / "parts" / f"{part.name}.stl").write_bytes(built_block.stl.read_bytes())
    write_plates(tmp_path, parts, HARDWARE.printer)
    program = find_slicer()
    assert program is not None
    gcode = tmp_path / "plate.gcode"
    command = [program, "--datadir", str(tmp_path), "--export-gcode", "--dont-arrange", "--output", str(gcode)]
    subprocess.run([*command, str(tmp_path / "plates" / "plate_1.3mf")], check=True, capture_output=True, timeout=300)
    used = dict(
        line[2:].split(" = ", 1) for line in gcode.read_text().splitlines() if line.startswith("; ") and "=" in line
    )
    assert used["print_settings_id"] == "mirrorcam"
    assert used["bed_shape"] == "0x0,220x0,220x220,0x220"
    assert (used["perimeters"], used["fill_density"], used["support_material"]) == ("2", "10%", "0")


@pytest.mark.skipif(find_slicer() is None, reason="needs PrusaSlicer")
def test_plates_of_the_default_device_need_no_support(built_default: Built) -> None:
    for path in sorted((built_default[1] / "plates").glob("*.3mf")):
        assert failed(check_slicing(path, HARDWARE.printer)) == set()
