"""Print plates: every part once, within the bed and apart, in projects whose settings a slicer takes."""

from __future__ import annotations

import subprocess
import xml.etree.ElementTree as ET
import zipfile
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

from mirrorcam.cad.assembly.catalogue import parts_of
from mirrorcam.cad.assembly.device_plan import Device
from mirrorcam.cad.plan.hardware import HARDWARE
from mirrorcam.cad.plan.part_plan import BuiltPart, PartPlan
from mirrorcam.cad.write.plates import CONFIG, GAP_MM, Plate, check_plates, plan_plates, write_plates
from mirrorcam.cad.write.slicer import check_slicing, find_slicer
from mirrorcam.cad.write.threemf import body_on_bed
from mirrorcam.core.values import Metric
from mirrorcam.optics.geometry.layout import Layout

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
    near = body.placed(np.eye(2), np.array([0.0, 10.0 + GAP_MM - 0.1]))
    assert failed(check_plates([Plate((body, near))], HARDWARE.printer)) == {"part_gap_mm"}
    off = body.placed(np.eye(2), np.array([0.0, 106.0]))
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
    assert "; perimeters = 3\n" in config
    assert "perimeters = 3\n" in (tmp_path / "first" / "plates" / "mirrorcam.ini").read_text(encoding="utf-8")


def test_a_project_is_plain_geometry_to_other_slicers(block: PartPlan, built_block: BuiltPart, tmp_path: Path) -> None:
    """What the reader of OrcaSlicer 2.2.0 goes by (commit 1088d0a6c713, src/libslic3r/Format/bbs_3mf.cpp).

    It takes every relationship of a type that begins and ends as below as a model, and a file as its own, with settings
    in places of their own, where the metadata name it as the application.
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
    assert (used["perimeters"], used["fill_density"], used["support_material"]) == ("3", "20%", "0")


@pytest.mark.slow
@pytest.mark.skipif(find_slicer() is None, reason="needs PrusaSlicer")
def test_plates_of_the_default_device_need_no_support(built_default: Built) -> None:
    for path in sorted((built_default[1] / "plates").glob("*.3mf")):
        assert failed(check_slicing(path, HARDWARE.printer)) == set()
