"""Reporters: a terminal prints steps and remarks, silence prints nothing, and both hand on progress."""

from __future__ import annotations

import pytest

from mirrorcam.core.console.progress import console
from mirrorcam.core.console.reporter import SILENT, TERMINAL, Reporter


@pytest.mark.parametrize(("reporter", "loud"), [(TERMINAL, True), (SILENT, False)])
def test_only_the_terminal_prints(reporter: Reporter, loud: bool, capsys: pytest.CaptureFixture[str]) -> None:
    console.cache_clear()
    reporter.note("decode", "two frames were lost")
    with reporter.work("decode", "3 frames", "frames") as progress:
        progress(3, 3)
    printed = capsys.readouterr().out
    console.cache_clear()
    assert ("two frames were lost" in printed) == loud
    assert ("3 frames ..." in printed) == loud
    assert bool(printed) == loud


def test_an_error_within_a_step_is_not_swallowed() -> None:
    with pytest.raises(ValueError, match="broken"), SILENT.work("cad", "parts"):
        raise ValueError("broken")
