"""Title blocks: date, scale and material."""

from __future__ import annotations

import pytest

from mirrorcam.cad.guide.drawing_sheet import text_width_mm
from mirrorcam.cad.guide.title_block import (
    GAUGE_TOLERANCE,
    GENERAL_TOLERANCE,
    MODEL,
    MODEL_MM,
    PARTS_TOLERANCE,
    TOLERANCE_MM,
    UNDATED,
    VALUE_MM,
    issue_date,
    printed_of,
    ratio,
)
from mirrorcam.core.values import InputError


def test_the_date_is_that_of_the_source_and_never_of_the_clock(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("SOURCE_DATE_EPOCH", raising=False)
    assert issue_date() == UNDATED
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "0")
    assert issue_date() == "1970-01-01"
    for wrong in ("", "soon", "1.5", "9" * 30):
        monkeypatch.setenv("SOURCE_DATE_EPOCH", wrong)
        with pytest.raises(InputError, match=r"SOURCE_DATE_EPOCH is .*, expected whole seconds since 1970"):
            issue_date()


def test_texts_stay_in_their_fields() -> None:
    for text in (GENERAL_TOLERANCE, GAUGE_TOLERANCE, PARTS_TOLERANCE):
        assert text_width_mm(text, VALUE_MM) < TOLERANCE_MM - 4.0
    assert text_width_mm(MODEL, 1.8) < MODEL_MM - 4.0


def test_scales_and_materials_as_they_are_written() -> None:
    said = [ratio(scale) for scale in (2.0, 1.0, 0.5, 0.2, None)]
    assert said == ["2 : 1", "1 : 1", "1 : 2", "1 : 5", "not to scale"]
    assert printed_of("PLA") == "PLA, printed"
