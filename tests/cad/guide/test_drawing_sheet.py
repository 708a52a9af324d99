"""Drawing sheets: text knows the area that it covers, turned too; lines are kept; files have the sheet's size."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest

from mirrorcam.cad.guide.drawing_sheet import Align, DrawingSheet, text_width_mm


def test_width_grows_with_height_and_length_and_bold() -> None:
    assert text_width_mm("12.5", 5.0) == pytest.approx(2.0 * text_width_mm("12.5", 2.5))
    assert text_width_mm("MM", 2.5) > 1.8 * text_width_mm("M", 2.5)
    assert text_width_mm("Title", 2.5, bold=True) > text_width_mm("Title", 2.5)


@pytest.mark.parametrize(("align", "left"), [("left", 0.0), ("center", -0.5), ("right", -1.0)])
@pytest.mark.parametrize("turn_deg", [0.0, 90.0])
def test_a_text_covers_its_width_from_where_it_is_aligned(align: Align, left: float, turn_deg: float) -> None:
    sheet = DrawingSheet(100.0, 80.0)
    sheet.text((40.0, 30.0), "30 deep", 2.5, align=align, turn_deg=turn_deg)
    width = text_width_mm("30 deep", 2.5)
    (words,) = sheet.words
    along = 1 if turn_deg else 0
    start = (40.0, 30.0)[along]
    assert words.corners[:, along].min() == pytest.approx(start + left * width)
    assert np.ptp(words.corners[:, along]) == pytest.approx(width)
    assert np.ptp(words.corners[:, 1 - along]) == pytest.approx(1.3 * 2.5)


def test_a_text_is_no_mathematics(tmp_path: Path) -> None:
    sheet = DrawingSheet(100.0, 80.0)
    sheet.text((40.0, 30.0), r"<b>$\frac$ & \"x\"", 2.5)
    svg, _ = sheet.write(tmp_path / "part", "<script> & more")
    ET.parse(svg)
    assert sheet.words[0].corners[:, 0].min() == pytest.approx(40.0)


def test_a_sheet_is_written_in_its_size_with_the_same_bytes(tmp_path: Path) -> None:
    def written(folder: str) -> tuple[bytes, bytes]:
        sheet = DrawingSheet(100.0, 50.0)
        sheet.rectangle((5.0, 5.0), (95.0, 45.0), 0.5)
        sheet.text((10.0, 10.0), "MC-99", 2.5)
        (tmp_path / folder).mkdir()
        svg, pdf = sheet.write(tmp_path / folder / "part", "MC-99 Block")
        return svg.read_bytes(), pdf.read_bytes()

    svg, pdf = written("a")
    assert (svg, pdf) == written("b")
    root = ET.fromstring(svg)
    size = [float(str(root.get(side)).removesuffix("pt")) * 25.4 / 72.0 for side in ("width", "height")]
    assert size == pytest.approx([100.0, 50.0], abs=1e-4)
    assert pdf.startswith(b"%PDF-")
