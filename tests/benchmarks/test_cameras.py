"""What is told of the devices of all cameras of the library and, slowly, every check of every device."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks.camera_cells import CAMERAS, Cell, built
from benchmarks.cameras import failures, main
from mirrorcam.core.values import Metric

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


def test_what_failed_is_told_and_ends_the_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert failures(CELLS) == [
        "c920 on none: mount.tilt_deg is 0.06 deg, limit 0.05",
        "brio on vesa: mount: too deep",
    ]
    path = tmp_path / "cells.jsonl"
    path.write_text("".join(cell.line for cell in CELLS.values()), encoding="utf-8")
    assert main([str(path), "--tables"]) == 1
    told = capsys.readouterr()
    assert "| `brio` | 2 of 2 | **not built** |" in told.out
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
