"""Texts of people on drawn pages fit their place, in glyphs that the font has."""

from __future__ import annotations

import pytest

from mirrorcam.core.sheet_text import drawable, fitted
from tests.hostile_names import ACCEPTED, REFUSED

ASCII = range(128)


def test_what_the_font_lacks_is_marked() -> None:
    assert drawable("PLA, 20 %", ASCII) == "PLA, 20 %"
    assert drawable("a 鏡\n\udc80", ASCII) == "a \ufffd\ufffd\ufffd"


@pytest.mark.parametrize("text", [*ACCEPTED, *REFUSED])
def test_any_text_fits(text: str) -> None:
    shown = fitted(text, 30.0, len)
    assert shown == (text if len(text) <= 30 else f"{text[:27]}...")
