"""Drawing sheets: areas covered by text, also rotated; recorded lines; files of the sheet's size.

Title blocks: date, scale and material.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest

from mirrorcam.cad.guide.drawing_sheet import (
    GAUGE_TOLERANCE,
    GENERAL_TOLERANCE,
    MODEL,
    MODEL_MM,
    PARTS_TOLERANCE,
    TOLERANCE_MM,
    UNDATED,
    VALUE_MM,
    Align,
    DrawingSheet,
    issue_date,
    printed_material,
    ratio,
    text_width_mm,
)
from mirrorcam.core.errors import InputError


def test_width_grows_with_height_and_length_and_bold() -> None:
    assert text_width_mm("12.5", 5.0) == pytest.approx(2.0 * text_width_mm("12.5", 2.5))
    assert text_width_mm("MM", 2.5) > 1.8 * text_width_mm("M", 2.5)
    assert text_width_mm("Title", 2.5, bold=True) > text_width_mm("Title", 2.5)


@pytest.mark.parametrize(("align", "left"), [("left", 0.0), ("center", -0.5), ("right", -1.0)])
@pytest.mark.parametrize("rotation_deg", [0.0, 90.0])
def test_a_text_covers_its_width_from_where_it_is_aligned(align: Align, left: float, rotation_deg: float) -> None:
    sheet = DrawingSheet(100.0, 80.0)
    sheet.text((40.0, 30.0), "30 deep", 2.5, align=align, rotation_deg=rotation_deg)
    width = text_width_mm("30 deep", 2.5)
    (box,) = sheet.text_boxes
    along = 1 if rotation_deg else 0
    start = (40.0, 30.0)[along]
    assert box.corners[:, along].min() == pytest.approx(start + left * width)
    assert np.ptp(box.corners[:, along]) == pytest.approx(width)
    assert np.ptp(box.corners[:, 1 - along]) == pytest.approx(1.3 * 2.5)


def test_a_text_is_no_mathematics(tmp_path: Path) -> None:
    sheet = DrawingSheet(100.0, 80.0)
    sheet.text((40.0, 30.0), r"<b>$\frac$ & \"x\"", 2.5)
    svg, _ = sheet.write(tmp_path / "part", "<script> & more")
    ET.parse(svg)
    assert sheet.text_boxes[0].corners[:, 0].min() == pytest.approx(40.0)


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


def test_the_date_is_that_of_the_source_and_never_of_the_clock(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("SOURCE_DATE_EPOCH", raising=False)
    assert issue_date() == UNDATED
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "0")
    assert issue_date() == "1970-01-01"
    for wrong in ("", "soon", "1.5", "9" * 30):
        monkeypatch.setenv("SOURCE_DATE_EPOCH", wrong)
        with pytest.raises(InputError, match=r"SOURCE_DATE_EPOCH is .*, expected an integer number of seconds"):
            issue_date()


def test_texts_stay_in_their_fields() -> None:
    for text in (GENERAL_TOLERANCE, GAUGE_TOLERANCE, PARTS_TOLERANCE):
        assert text_width_mm(text, VALUE_MM) < TOLERANCE_MM - 4.0
    assert text_width_mm(MODEL, 1.8) < MODEL_MM - 4.0


def test_scales_and_materials_as_they_are_written() -> None:
    texts = [ratio(scale) for scale in (2.0, 1.0, 0.5, 0.2, None)]
    assert texts == ["2 : 1", "1 : 1", "1 : 2", "1 : 5", "not to scale"]
    assert printed_material("PLA") == "PLA, printed"
