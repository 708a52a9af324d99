"""The files of a device: complete, with every check stated and passed, and mirrors sheet by sheet."""

from __future__ import annotations

import json
from pathlib import Path

import ezdxf.filemanagement
import pytest

from mirrorcam.cad.mirrors.sheet_files import write_sheets
from mirrorcam.cad.mirrors.stock_sheets import TEST
from mirrorcam.cad.plan.hardware import HARDWARE
from mirrorcam.cad.write.slicer import check_slicing
from mirrorcam.core.figures.figure_labels import LABELS
from mirrorcam.core.values import Metric
from mirrorcam.optics.geometry.layout import Layout
from tests.cad.write.freecad import LISTED, run_in_freecad
from tests.cad.write.needs_freecad import NEEDS_FREECAD

Built = tuple[Layout, Path, dict[str, Metric]]
PARTS = ("mirror_holder", "mount", "camera_clip", "adapter_desk", "fit_coupon")
WHOLE = {"index.html", "guide.md", "bom.md", "bom.csv", "bom.json", "checks.json", "assembly.step", "assembly.glb"}


def test_the_default_layout_gives_all_files_and_passes(built_default: Built) -> None:
    _, folder, checks = built_default
    expected = {f"parts/{part}{suffix}" for part in PARTS for suffix in (".step", ".stl", ".3mf")}
    expected |= {f"drawings/{part}{suffix}" for part in (*PARTS, "assembly") for suffix in (".svg", ".pdf")}
    assert expected | WHOLE <= {path.relative_to(folder).as_posix() for path in folder.rglob("*")}
    assert {name: check for name, check in checks.items() if not check.passed} == {}
    written = json.loads((folder / "checks.json").read_text(encoding="utf-8"))
    assert {name: entry["value"] for name, entry in written.items()} == {n: c.value for n, c in checks.items()}
    assert written["mirrors.seat_offset_um"]["limit"] == 1.0
    assert {name.partition(".")[0] for name in checks} >= {*PARTS, "device", "mirrors"}


@NEEDS_FREECAD
def test_freecad_reads_what_the_checks_say(built_default: Built, tmp_path: Path) -> None:
    _, folder, checks = built_default
    paths = [folder / "assembly.step", *(folder / "parts" / f"{part}.step" for part in PARTS)]
    script = f"found = [listed(path, FreeCAD.newDocument('part')) for path in {[str(path) for path in paths]}]"
    assembly, *parts = run_in_freecad(f"{LISTED}\n{script}", tmp_path)
    for name, objects in zip(PARTS, parts, strict=True):
        (part,) = objects
        assert (part["label"], part["kind"], part["closed"], part["valid"]) == (name, "Solid", [True], True)
        assert part["volume"] / 1000.0 == pytest.approx(checks[f"{name}.volume_cm3"].value, abs=1e-4)
    pieces = {piece["label"]: piece for piece in assembly if piece["kind"] == "Solid"}
    assert all(piece["valid"] and all(piece["closed"]) and piece["solids"] == 1 for piece in pieces.values())
    assert len(pieces) > 40
    for name in {*PARTS} - {"fit_coupon"}:
        assert pieces[name]["volume"] / 1000.0 == pytest.approx(checks[f"{name}.volume_cm3"].value, abs=1e-4)


def test_every_check_and_figure_has_a_label(built_default: Built) -> None:
    figures = {name.partition(".")[2] for name in built_default[2]}
    assert len(figures) > 60
    assert figures - set(LABELS) == set()


@pytest.mark.slow
def test_second_surface_mirrors_pass_as_well(built_second_surface: Built) -> None:
    _, folder, checks = built_second_surface
    assert {name: check for name, check in checks.items() if not check.passed} == {}
    # The other parts do not depend on mirrors, and are sliced with the default device.
    for part in ("mirror_holder", "mount"):
        sliced = check_slicing(folder / "parts" / f"{part}.3mf", HARDWARE.printer)
        assert [name for name, check in sliced.items() if not check.passed] == []


def test_every_stock_sheet_is_drawn_for_both_kinds_of_laser(default_layout: Layout, tmp_path: Path) -> None:
    first, *others = default_layout.mirrors
    mixed = default_layout.replaced(mirrors=(first.replaced(thickness_mm=2.0), *others))
    for layout, stems in ((default_layout, ["mirrors"]), (mixed, ["mirrors_1", "mirrors_2"])):
        folder = tmp_path / str(len(stems))
        sheets = write_sheets(folder, layout, HARDWARE.cutting)
        assert [sheet.stem for sheet in sheets] == stems
        assert sorted(cut.name for sheet in sheets for cut in sheet.cuts) == sorted([*layout.mirror_names, TEST])
        drawn = {f"{stem}{suffix}" for stem in stems for suffix in (".dxf", ".svg")}
        assert {path.name for path in folder.iterdir()} == drawn | {"scale_bar.dxf", "scale_bar.svg", "cutting.md"}
        for sheet in sheets:
            cut = ezdxf.filemanagement.readfile(folder / f"{sheet.stem}.dxf").query('LWPOLYLINE[layer=="CUT"]')
            assert len(cut) == len(sheet.cuts)
