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
from mirrorcam.cad.mirrors.sheet_files import write_dxf, write_sheets, write_svg
from mirrorcam.cad.mirrors.stock_sheets import StockSheet, plan_sheets
from mirrorcam.cad.plan.hardware import HARDWARE
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.transforms import transform

LASER = HARDWARE.cutting.replaced(material="acrylic")


@pytest.fixture(scope="module")
def sheet(free_layout: Layout) -> StockSheet:
    (sheet,) = plan_sheets(free_layout, LASER)
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


def test_files_for_a_service_hold_only_what_is_cut_and_engraved(
    sheet: StockSheet, free_layout: Layout, tmp_path: Path
) -> None:
    write_sheets(tmp_path, free_layout, LASER)
    assert {file.name for file in tmp_path.iterdir()} == {
        *("cutting.md", "mirrors.dxf", "mirrors.svg", "scale_bar.dxf", "scale_bar.svg")
    }
    drawing = ezdxf.filemanagement.readfile(tmp_path / "mirrors.dxf")
    assert drawing.header["$INSUNITS"] == 4
    assert {entity.dxf.layer for entity in drawing.modelspace()} == {"CUT", "ENGRAVE"}
    cuts = list(drawing.modelspace().query('LWPOLYLINE[layer=="CUT"]'))
    assert all(isinstance(line, LWPolyline) and line.closed for line in cuts)
    assert len(cuts) == len(sheet.cuts) == len(free_layout.mirrors) + 1
    assert not drawing.audit().errors
    words = (tmp_path / "cutting.md").read_text(encoding="utf-8")
    stock = ("BACK", "kerf 0.2 included", "first-surface acrylic mirror, 1 mm", "300 x 200", free_layout.identity)
    assert [word for word in stock if word not in words] == []
    assert "Strip plan" not in words


def test_the_scale_bar_is_100_mm_in_both_files(free_layout: Layout, tmp_path: Path) -> None:
    write_sheets(tmp_path, free_layout, LASER)
    lines = list(ezdxf.filemanagement.readfile(tmp_path / "scale_bar.dxf").modelspace())
    ends = np.vstack([line.get_points("xy") for line in lines if isinstance(line, LWPolyline)])
    assert np.ptp(ends, axis=0).tolist() == [100.0, 5.0]
    root = ElementTree.parse(tmp_path / "scale_bar.svg").getroot()
    assert root.get("width") == "100mm"


def test_rectangles_have_a_list_and_straight_cuts(free_layout: Layout, tmp_path: Path) -> None:
    layout = rectangles(free_layout, "rectangles")
    write_sheets(tmp_path, layout, LASER)
    words = (tmp_path / "cutting.md").read_text(encoding="utf-8")
    assert "| 25 x 15 | 9 | 0-0, 0-1, 0-2, 1-0, 1-1, 1-2, 2-0, 2-1, 2-2 |" in words
    # Nine of 25 mm and the test mirror of 20 mm, all 15 mm wide, fit one strip of 300 mm.
    assert "| 1 | 1 | 15 | 0-0: 25, 0-1: 25, " in words
    assert ", test: 20 |" in words


def test_sizes_that_are_sold_are_bought_with_a_spare_one(free_layout: Layout, tmp_path: Path) -> None:
    write_sheets(tmp_path, rectangles(free_layout, "stock:25x15"), LASER)
    words = (tmp_path / "cutting.md").read_text(encoding="utf-8")
    assert "Buy these sizes, and a spare one" in words
    assert "Strip plan" not in words


def rectangles(layout: Layout, shape: str) -> Layout:
    """The layout with mirrors of 25 x 15 mm on the same planes, as if designed in a shape."""
    half = np.array([(-12.5, -7.5), (12.5, -7.5), (12.5, 7.5), (-12.5, 7.5)])
    mirrors = tuple(
        mirror.replaced(outline_in_rig_mm=transform(mirror.rig_from_plane, np.column_stack([half, np.zeros(4)])))
        for mirror in layout.mirrors
    )
    return layout.replaced(mirrors=mirrors, spec=DesignSpec(shape=shape))


def test_the_same_mirrors_give_the_same_bytes_whatever_the_order_of_sets(free_layout: Layout, tmp_path: Path) -> None:
    free_layout.save(tmp_path / "layout.json")
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
    size = [float(number) for number in root.get("viewBox", "").split()[2:]]
    assert (root.get("width"), root.get("height")) == (f"{size[0]:g}mm", f"{size[1]:g}mm")
    assert tuple(size) == HARDWARE.cutting.sheet_mm
    layers = {group.get("id"): group for group in root.findall(f"{SVG}g")}
    assert list(layers) == ["ENGRAVE", "CUT"]
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
