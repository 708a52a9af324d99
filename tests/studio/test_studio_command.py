"""`mirrorcam studio`: its options, and the page that it writes for use without a server."""

from __future__ import annotations

from pathlib import Path

import pytest

from mirrorcam.cli import main
from mirrorcam.studio.atlas import AtlasGrid
from tests.command_line import assert_refused_here

TINY = AtlasGrid(rows=(1,), cols=(2,), scales_mm=(60.0,), tradeoffs=(0.3,))


def test_a_snapshot_is_written_once(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("mirrorcam.studio.atlas.AtlasGrid", lambda: TINY)
    path = tmp_path / "page.html"
    assert main(["studio", "--snapshot", str(path)]) == 0
    assert f"{path} written, " in capsys.readouterr().out
    assert path.stat().st_size < 1_000_000
    page = path.read_text(encoding="utf-8")
    assert '"1,2,60,0.3"' in page
    assert 'id="make"' not in page
    path.write_text("mine")
    assert_refused_here(["studio", "--snapshot", str(path)], capsys, "page.html")
    assert path.read_text() == "mine"


def test_a_file_that_is_not_a_design_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "design.toml").write_text("rows = 0")
    assert_refused_here(["studio", str(tmp_path / "design.toml"), "--no-browser"], capsys, "rows")
    assert_refused_here(["studio", str(tmp_path / "none.toml"), "--no-browser"], capsys, "no such file")
