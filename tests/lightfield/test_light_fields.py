"""Commands of light fields print a limited number of lines about them."""

from __future__ import annotations

import pytest

from mirrorcam.core.console.progress import console
from mirrorcam.lightfield.light_fields import PRINTED_LINES, say_first


def test_of_very_many_lines_the_first_are_printed(capsys: pytest.CaptureFixture[str]) -> None:
    console.cache_clear()
    say_first("depth", [f"line {number}" for number in range(2 * PRINTED_LINES)])
    printed = capsys.readouterr().out.splitlines()
    console.cache_clear()
    assert len(printed) == PRINTED_LINES + 1
    assert printed[-2].endswith(f"line {PRINTED_LINES - 1}")
    assert printed[-1].endswith(f"and {PRINTED_LINES} more like these")
