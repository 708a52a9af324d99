"""3MF files, read back by lib3mf in strict mode and sliced."""

from __future__ import annotations

import json
import locale
import shutil
import subprocess
import zipfile
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import lib3mf
import numpy as np
import pytest

from mirrorcam.cad.plan.hardware import HARDWARE, Printer
from mirrorcam.cad.plan.part_plan import BuiltPart, PartPlan
from mirrorcam.cad.write.threemf import lying, write_3mf
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
    # The box of 60 x 30 x 10 stands on its 60 x 10 side.
    size = np.array(list(placed.MaxCoordinate)) - np.array(list(placed.MinCoordinate))
    np.testing.assert_allclose(size, [60.0, 10.0, 30.0], atol=1e-4)
    np.testing.assert_allclose(list(placed.MinCoordinate), [BED[0] / 2 - 30.0, BED[1] / 2 - 5.0, 0.0], atol=1e-4)


def test_it_says_what_it_is(written: Path, block: PartPlan) -> None:
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


def test_the_same_part_gives_the_same_bytes_and_another_other_ids(
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
    np.testing.assert_allclose(np.ptp(lying(points, block, narrow), axis=0), [90.0, 200.0, 20.0])
    np.testing.assert_allclose(np.ptp(lying(points, block, HARDWARE.printer), axis=0), [200.0, 90.0, 20.0])
    # What fits neither way is left as it lies.
    small = HARDWARE.printer.replaced(bed_mm=(50.0, 60.0, 250.0))
    np.testing.assert_allclose(np.ptp(lying(points, block, small), axis=0), [200.0, 90.0, 20.0])


def test_a_turn_is_not_a_mirror_image(block: PartPlan) -> None:
    points = np.array([[0.0, 0.0, 0.0], [200.0, 0.0, 0.0], [0.0, 0.0, 90.0], [0.0, 20.0, 0.0]])
    narrow = HARDWARE.printer.replaced(bed_mm=(100.0, 250.0, 250.0))
    for printer in (HARDWARE.printer, narrow):
        edges = np.diff(lying(points, block, printer), axis=0)
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
