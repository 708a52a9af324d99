"""`mirrorcam board`: which files it writes, and what it refuses."""

from __future__ import annotations

from pathlib import Path

import pytest

from mirrorcam import cli
from mirrorcam.optics.geometry.boards import default_board, load_board, save_board
from tests.command_line import assert_refused_here
from tests.device.test_board_print import page_and_polygons_mm


def test_without_a_board_the_default_one_is_drawn_and_its_numbers_written(tmp_path: Path) -> None:
    assert cli.main(["board", "--out", str(tmp_path / "board.pdf")]) == 0
    assert load_board(tmp_path / "board.toml") == default_board()
    page, _ = page_and_polygons_mm(tmp_path / "board.pdf")
    assert page == pytest.approx((297.0, 210.0), abs=1e-4)


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["--out", "board.png"], "--out board.png: expected a name that ends in .pdf or .svg"),
        (["missing.toml"], "missing.toml: no such file"),
        (["--page", "a5"], "page 'a5': expected a4"),
        (["--out", "."], "--out .: expected a name"),
    ],
)
def test_bad_input_is_refused_in_one_line_and_nothing_is_written(
    arguments: list[str],
    complaint: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert_refused_here(["board", *arguments], capsys, f"mirrorcam: {complaint}")
    assert list(tmp_path.iterdir()) == []


def test_an_existing_board_file_is_not_reported_as_written(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    given = tmp_path / "mine.toml"
    save_board(given, default_board())
    assert cli.main(["board", str(given), "--out", str(tmp_path / "b" / "board.pdf")]) == 0
    said = capsys.readouterr().out
    assert f"{given} describes it for mirrorcam calibrate" in said
    assert "mine.toml written" not in said
