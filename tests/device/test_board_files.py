"""A board to print: its page, and the file of its numbers."""

from __future__ import annotations

from pathlib import Path

import pytest

from mirrorcam.core.errors import InputError
from mirrorcam.device.board_files import print_board
from mirrorcam.optics.geometry.boards import Checkerboard, default_board, load_board, save_board
from tests.command_line import results


def test_the_default_board_comes_with_its_numbers(tmp_path: Path) -> None:
    printed = print_board(tmp_path / "print.svg")
    assert printed.description == tmp_path / "print.toml"
    assert load_board(printed.description) == default_board()
    assert printed.page_mm == (297.0, 210.0)


def test_a_board_of_a_file_leaves_that_alone(tmp_path: Path) -> None:
    save_board(tmp_path / "mine.toml", Checkerboard(cols=5, rows=4, square_mm=20.0))
    printed = print_board(tmp_path / "print.svg", tmp_path / "mine.toml", "A3")
    assert printed.description == tmp_path / "mine.toml"
    assert sorted(printed.page_mm) == [297.0, 420.0]
    assert results(tmp_path) == ["mine.toml", "print.svg"]


def test_another_format_is_refused_before_anything_is_written(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"board\.png: expected a name that ends in \.pdf or \.svg"):
        print_board(tmp_path / "board.png")
    assert list(tmp_path.iterdir()) == []
