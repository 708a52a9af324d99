"""Tables of the devices of all cameras of the library and, slowly, every check of every device."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks.camera_cells import CAMERAS, Cell, built
from benchmarks.cameras import (
    CHECKS,
    CLIP_HEAD,
    checks_table,
    clip_row,
    clip_table,
    failures,
    main,
    matrix_table,
    print_table,
    row_of,
)
from mirrorcam.optics.base.values import Metric

FAILED = {"mount.tilt_deg": Metric(value=0.06, unit="deg", limit=0.05)}
CELLS = {
    cell.key: cell
    for cell in (
        Cell(
            camera="c920",
            adapter="none",
            mass_g=392.0,
            print_g=200.0,
            print_minutes=1032.0,
            passed=("mount.wall_mm", "device.tool_clash_mm3", "camera_clip.new_check"),
            failed=FAILED,
            clip={
                "camera_clip.leaf_strain": Metric(value=0.004, unit="", limit=0.0055),
                "camera_clip.reclamped_mm": Metric(value=0.03, unit="mm"),
                "camera_clip.reclamped_deg": Metric(value=0.075, unit="deg"),
            },
        ),
        Cell(camera="c920", adapter="vesa", mass_g=380.0, passed=("mount.wall_mm", "mount.tilt_deg")),
        Cell(camera="brio", adapter="none", mass_g=410.0, passed=("mount.wall_mm", "mount.tilt_deg")),
        Cell(camera="brio", adapter="vesa", error="mount: too deep"),
    )
}


@pytest.mark.slow
@pytest.mark.parametrize("name", CAMERAS)
def test_every_camera_of_the_library_gets_a_device_that_passes_every_check(name: str, tmp_path: Path) -> None:
    cell = built(name, "none", tmp_path, tmp_path)
    assert (cell.error, cell.failed) == ("", {})
    assert cell.clip["camera_clip.light_gap_mm"].value > 0.0


def test_the_matrix_counts_what_passed_and_marks_what_did_not() -> None:
    assert matrix_table(CELLS).markdown().splitlines() == [
        "| camera | `none` | `vesa` |",
        "|---|---|---|",
        "| `brio` | 2 of 2 | **not built** |",
        "| `c920` | **3 of 4** | 2 of 2 |",
    ]


def test_checks_are_counted_by_kind_and_one_that_is_new_has_its_own_row() -> None:
    assert checks_table(CELLS).markdown().splitlines() == [
        "| check | `none` | `vesa` |",
        "|---|---|---|",
        "| wall, floor | 2 of 2 | 1 of 1 |",
        "| tools | 1 of 1 | |",
        "| stiffness | **1 of 2** | 1 of 1 |",
        "| new_check | 1 of 1 | |",
    ]


def test_one_part_that_fails_fails_the_kind_of_check() -> None:
    walls = {"mount.wall_mm": Metric(value=1.0, unit="mm", limit=1.2, lower_is_better=False)}
    cell = Cell(camera="c920", adapter="none", passed=("camera_clip.wall_mm", "mount.floor_mm"), failed=walls)
    assert "| wall, floor | **0 of 1** |" in checks_table({cell.key: cell}).markdown()


def test_every_check_of_a_device_has_a_row() -> None:
    names = [name for row in CHECKS.values() for name in row]
    assert len(names) == len(set(names))
    assert {row_of(f"mount.{name}") for name in names} == CHECKS.keys()


def test_masses_and_times_are_those_that_are_known() -> None:
    table = print_table(CELLS).markdown()
    assert "| `c920` | 392 g, 200 g, 17:12 h | 380 g |" in table
    assert "| `brio` | 410 g | |" in table


def test_a_clip_has_a_cell_for_each_head() -> None:
    cells = clip_row(CELLS["c920", "none"])
    assert len(cells) == len(CLIP_HEAD)
    assert "0.40 %" in cells
    assert "0.030 mm, 0.075°" in cells
    assert clip_table(CELLS).markdown().count("`c920`") == 1


def test_what_failed_is_told_and_ends_the_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert failures(CELLS) == [
        "c920 on none: mount.tilt_deg is 0.06 deg, limit 0.05",
        "brio on vesa: mount: too deep",
    ]
    path = tmp_path / "cells.jsonl"
    path.write_text("".join(cell.line for cell in CELLS.values()), encoding="utf-8")
    assert main([str(path), "--tables"]) == 1
    told = capsys.readouterr()
    assert matrix_table(CELLS).markdown() in told.out
    assert "mount.tilt_deg is 0.06 deg" in told.err
    path.write_text(CELLS["c920", "vesa"].line, encoding="utf-8")
    assert main([str(path), "--tables"]) == 0


def test_a_file_that_is_none_of_cells_is_bad_input(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "cells.jsonl"
    path.write_text("[]\n", encoding="utf-8")
    with pytest.raises(SystemExit) as ended:
        main([str(path), "--tables"])
    assert ended.value.code == 2
    assert "cells.jsonl:1" in capsys.readouterr().err
