"""Devices of cameras by adapters as lines of JSON: what is kept, what is built again, what becomes of a failure."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks import camera_cells
from benchmarks.camera_cells import Cell, built, cell_of, fill, layout_for, read_cells, spec_of
from mirrorcam.core.values import InputError, Metric
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.layout import Layout

CHECKS = {
    "camera_clip.leaf_strain": Metric(value=0.004, unit="", limit=0.0055),
    "camera_clip.contact_n": Metric(value=-1.0, unit="N", limit=0.0, lower_is_better=False),
    "camera_clip.print_g": Metric(value=23.0, unit="g"),
    "mount.print_g": Metric(value=40.0, unit="g"),
    "fit_coupon.print_g": Metric(value=9.0, unit="g"),
    "mount.print_minutes": Metric(value=190.2, unit="min"),
    "fit_coupon.print_minutes": Metric(value=45.0, unit="min"),
    "device.mass_g": Metric(value=400.04, unit="g"),
    "device.print_minutes": Metric(value=235.0, unit="min"),
}
CELL = cell_of("c920", "none", CHECKS, 61.26)


def test_a_cell_tells_what_passed_what_failed_and_what_the_device_takes() -> None:
    assert CELL.passed == ("camera_clip.leaf_strain",)
    assert list(CELL.failed) == ["camera_clip.contact_n"]
    assert (CELL.mass_g, CELL.print_g, CELL.print_minutes, CELL.seconds) == (400.0, 63.0, 190.2, 61.3)
    assert set(CELL.clip) == {"camera_clip.leaf_strain", "camera_clip.contact_n", "camera_clip.print_g"}
    assert not CELL.whole
    assert Cell(camera="c920", adapter="none").whole
    assert not Cell(camera="c920", adapter="none", error="no").whole


def test_cells_survive_their_file_and_later_lines_win(tmp_path: Path) -> None:
    path = tmp_path / "cells.jsonl"
    later = CELL.replaced(seconds=1.0)
    path.write_text(CELL.line + later.line, encoding="utf-8")
    assert read_cells(path) == {("c920", "none"): later}
    assert read_cells(tmp_path / "none.jsonl") == {}


def test_a_line_that_was_cut_off_is_left_out_and_any_other_that_is_no_cell_refused(tmp_path: Path) -> None:
    path = tmp_path / "cells.jsonl"
    path.write_text(CELL.line + CELL.replaced(adapter="vesa").line[:-9], encoding="utf-8")
    assert set(read_cells(path)) == {("c920", "none")}
    path.write_text(CELL.line + '{"camera": 3}\n', encoding="utf-8")
    with pytest.raises(InputError, match=r"cells\.jsonl:2"):
        read_cells(path)


def test_a_layout_is_designed_once_for_a_camera(
    default_layout: Layout, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[DesignSpec] = []

    def designed(spec: DesignSpec) -> Layout:
        asked.append(spec)
        return default_layout.replaced(spec=spec.replaced(fold_deg=117.0))

    monkeypatch.setattr(camera_cells, "design", designed)
    first = layout_for("c920", tmp_path)
    assert layout_for("c920", tmp_path) == first
    assert asked == [spec_of("c920")]
    # Kept for another specification, it is designed anew.
    layout_for("brio", tmp_path)
    (tmp_path / "c920.json").write_bytes((tmp_path / "brio.json").read_bytes())
    layout_for("c920", tmp_path)
    assert len(asked) == 3


def test_what_stops_a_device_is_its_error_in_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def stopped(*_: object, **__: object) -> dict[str, Metric]:
        raise ValueError("first\nsecond")

    monkeypatch.setattr(camera_cells, "layout_for", lambda *_: None)
    monkeypatch.setattr(camera_cells, "build_parts", stopped)
    assert built("c920", "none", tmp_path, tmp_path).error == "ValueError: first second"
    assert "expected one of" in built("c920", "nowhere", tmp_path, tmp_path).error


def test_a_run_builds_what_the_file_lacks(tmp_path: Path) -> None:
    path = tmp_path / "cells.jsonl"
    path.write_text(CELL.line + CELL.replaced(adapter="vesa").line[:20], encoding="utf-8")
    # A folder of layouts that cannot be made stops every device, at once.
    designs = tmp_path / "a file"
    designs.touch()
    done: list[Cell] = []
    cells = fill(path, ("c920",), ("none", "vesa"), designs, 2, done=done.append)
    assert [cell.key for cell in done] == [("c920", "vesa")]
    assert "a file" in done[0].error
    assert read_cells(path) == cells
    assert cells["c920", "none"] == CELL
    assert len(path.read_text(encoding="utf-8").splitlines()) == 2
    fill(path, ("c920",), ("none", "vesa"), designs, 1, done=done.append)
    assert len(done) == 1
    fill(path, ("c920",), ("none", "vesa"), designs, 1, again=True, done=done.append)
    assert {cell.key for cell in done[1:]} == {("c920", "none"), ("c920", "vesa")}
