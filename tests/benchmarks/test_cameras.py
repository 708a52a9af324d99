"""Devices of all cameras of the library: one line of the table each, and, slowly, every check of every device."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks.cameras import HEAD, checked, line, row
from mirrorcam.optics.base.values import Metric
from mirrorcam.optics.geometry.camera_library import camera_names

DOCS = Path(__file__).parents[2] / "docs" / "cad.md"


@pytest.mark.slow
@pytest.mark.parametrize("name", camera_names())
def test_every_camera_of_the_library_gets_a_device_that_passes_every_check(name: str, tmp_path: Path) -> None:
    checks = checked(name, tmp_path)
    assert {name: check for name, check in checks.items() if check.passed is False} == {}
    assert checks["camera_clip.light_gap_mm"].value > 0.0


def test_a_line_has_a_cell_for_each_head_and_counts_what_passed() -> None:
    checks = {
        "camera_clip.leaf_strain": Metric(value=0.004, unit="", limit=0.0055),
        "camera_clip.contact_n": Metric(value=-1.0, unit="N", limit=0.0, lower_is_better=False),
        "device.mass_g": Metric(value=400.0, unit="g"),
    }
    cells = row("c920", checks)
    assert len(cells) == len(HEAD)
    assert cells[-1] == "1 of 2"
    assert "0.40 %" in cells
    assert line(("a", "b")) == "| a | b |"


def test_the_table_of_the_documentation_has_the_form_of_the_script() -> None:
    text = DOCS.read_text(encoding="utf-8")
    assert line(HEAD) in text
    table = text[text.index(line(HEAD)) :].split("\n\n")[0].splitlines()[2:]
    names = [cells.split("`")[1] for cells in table]
    assert names == sorted(names)
    assert {"c920", "board_38"} <= set(names) <= set(camera_names())
    assert {cells.count("|") for cells in table} == {len(HEAD) + 1}
