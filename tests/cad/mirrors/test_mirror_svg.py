"""Mirrors as SVG: the same lines as in the DXF, in mm."""

from __future__ import annotations

import re
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from mirrorcam.cad.mirrors.mirror_svg import write_svg
from mirrorcam.cad.mirrors.stock_sheets import StockSheet, plan_sheets
from mirrorcam.cad.plan.hardware import HARDWARE
from mirrorcam.optics.geometry.layout import Layout

SVG = "{http://www.w3.org/2000/svg}"


@pytest.fixture(scope="module")
def sheet(default_layout: Layout) -> StockSheet:
    (sheet,) = plan_sheets(default_layout, HARDWARE.cutting)
    return sheet


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
