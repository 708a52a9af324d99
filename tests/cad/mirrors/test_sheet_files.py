"""Mirrors as DXF: every mirror is read back, in mm, and the same stock sheet gives the same bytes.

Mirrors as SVG: the same lines as in the DXF, in mm.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import ezdxf.filemanagement
import numpy as np
import pytest
from ezdxf.entities.lwpolyline import LWPolyline

from mirrorcam.cad.checks.cut_outlines import read_cuts
from mirrorcam.cad.mirrors.sheet_files import write_dxf, write_svg
from mirrorcam.cad.mirrors.stock_sheets import StockSheet, plan_sheets
from mirrorcam.cad.plan.hardware import HARDWARE
from mirrorcam.optics.geometry.layout import Layout


@pytest.fixture(scope="module")
def sheet(default_layout: Layout) -> StockSheet:
    (sheet,) = plan_sheets(default_layout, HARDWARE.cutting)
    return sheet


def test_the_dxf_gives_every_mirror_back(sheet: StockSheet, tmp_path: Path) -> None:
    write_dxf(tmp_path / "mirrors.dxf", sheet)
    found, wrong = read_cuts([tmp_path / "mirrors.dxf"])
    assert sorted(found) == sorted(cut.name for cut in sheet.cuts)
    assert not any(wrong.values())
    for cut in sheet.cuts:
        np.testing.assert_allclose(found[cut.name].path, cut.outline, atol=1e-9)
        for stroke, expected in zip(found[cut.name].strokes, cut.strokes, strict=True):
            np.testing.assert_allclose(stroke, expected, atol=1e-9)


def test_the_dxf_says_its_unit_side_kerf_sheet_and_layout(
    sheet: StockSheet, default_layout: Layout, tmp_path: Path
) -> None:
    write_dxf(tmp_path / "mirrors.dxf", sheet)
    drawing = ezdxf.filemanagement.readfile(tmp_path / "mirrors.dxf")
    assert drawing.header["$INSUNITS"] == 4
    texts = drawing.modelspace().query("TEXT")
    assert {text.dxf.layer for text in texts} == {"NOTES"}
    words = " ".join(text.dxf.text for text in texts)
    for word in (
        "BACK",
        "kerf 0.2 included",
        "first-surface acrylic mirror, 1 mm",
        "300 x 200",
        default_layout.identity,
    ):
        assert word in words
    assert {entity.dxf.layer for entity in drawing.modelspace()} == {"CUT", "ENGRAVE", "NOTES"}
    cuts = list(drawing.modelspace().query('LWPOLYLINE[layer=="CUT"]'))
    assert all(isinstance(line, LWPolyline) and line.closed for line in cuts)
    assert len(cuts) == len(sheet.cuts)
    assert not drawing.audit().errors


def test_the_same_mirrors_give_the_same_bytes_whatever_the_order_of_sets(
    default_layout: Layout, tmp_path: Path
) -> None:
    default_layout.save(tmp_path / "layout.json")
    program = (
        "import sys; from pathlib import Path; from mirrorcam.optics.geometry.layout import Layout;"
        "from mirrorcam.cad.plan.hardware import HARDWARE;"
        "from mirrorcam.cad.mirrors.sheet_files import write_dxf;"
        "from mirrorcam.cad.mirrors.stock_sheets import plan_sheets;"
        "from mirrorcam.cad.mirrors.sheet_files import write_svg;"
        "(sheet,) = plan_sheets(Layout.load(Path(sys.argv[1])), HARDWARE.cutting); out = Path(sys.argv[2]);"
        "write_dxf(out.with_suffix('.dxf'), sheet); write_svg(out.with_suffix('.svg'), sheet)"
    )
    for seed in (1, 7):
        command = [sys.executable, "-c", program, str(tmp_path / "layout.json"), str(tmp_path / f"{seed}")]
        subprocess.run(command, check=True, env=os.environ | {"PYTHONHASHSEED": f"{seed}"})
    for suffix in ("dxf", "svg"):
        assert len({file.read_bytes() for file in tmp_path.glob(f"*.{suffix}")}) == 1
        assert len(list(tmp_path.glob(f"*.{suffix}"))) == 2


SVG = "{http://www.w3.org/2000/svg}"


def test_the_svg_draws_what_the_dxf_does(sheet: StockSheet, tmp_path: Path) -> None:
    write_svg(tmp_path / "mirrors.svg", sheet)
    root = ElementTree.parse(tmp_path / "mirrors.svg").getroot()
    width, height, total = (float(root.get("viewBox", "").split()[i]) for i in (2, 3, 3))
    assert (root.get("width"), root.get("height")) == (f"{width:g}mm", f"{total:g}mm")
    assert width == HARDWARE.cutting.sheet_mm[0]
    assert height > HARDWARE.cutting.sheet_mm[1]
    layers = {group.get("id"): group for group in root.findall(f"{SVG}g")}
    assert list(layers) == ["NOTES", "ENGRAVE", "CUT"]
    assert layers["CUT"].get("stroke") == "#ff0000"
    assert layers["ENGRAVE"].get("stroke") == "#0000ff"
    assert float(layers["CUT"].get("stroke-width", "1")) < 0.05
    paths = {path.get("id"): path.get("d", "") for path in layers["CUT"].findall(f"{SVG}path")}
    for cut in sheet.cuts:
        data = paths[f"mirror_{cut.name}"]
        assert data.endswith("Z")
        points = np.array([float(number) for number in re.findall(r"-?\d+\.\d+", data)]).reshape(-1, 2)
        flipped = np.column_stack([points[:, 0], HARDWARE.cutting.sheet_mm[1] - points[:, 1]])
        np.testing.assert_allclose(flipped, cut.outline, atol=5.1e-5)
    engraved = layers["ENGRAVE"].findall(f"{SVG}path")[0].get("d", "")
    assert engraved.count("M") == sum(len(cut.strokes) for cut in sheet.cuts)
