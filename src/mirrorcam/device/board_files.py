"""A calibration board as files: the page to print, and its dimensions."""

from __future__ import annotations

import glob
from dataclasses import dataclass
from pathlib import Path

from mirrorcam.core.disk.output_folder import output_folder
from mirrorcam.core.errors import InputError
from mirrorcam.device.board_print import FORMATS, page_for, write_board
from mirrorcam.optics.geometry.boards import default_board, is_own_board, load_board, save_board


@dataclass(frozen=True)
class PrintedBoard:
    """Size of a board's page in mm, and the `board.toml` that describes the board."""

    page_mm: tuple[float, float]
    description: Path


def print_board(path: Path, board: Path | None = None, page: str = "", *, force: bool = False) -> PrintedBoard:
    """Draw a board at true scale into a PDF or SVG file.

    Parameters
    ----------
    path
        File to write, .pdf or .svg.
    board
        `board.toml`; None for the default board. For it, and for a board as another program describes it, `board.toml`
        is written next to the page.
    page
        Name of a page, WIDTHxHEIGHT in mm, or empty for the smallest A page that holds the board.
    force
        Whether to replace files that this command did not write, or that were changed since.
    """
    if path.suffix not in FORMATS:
        raise InputError(f"--out {path}: expected a name that ends in {' or '.join(FORMATS)}")
    printed = default_board() if board is None else load_board(board)
    own = board is not None and is_own_board(board)
    description = board if own and board is not None else path.with_suffix(".toml")
    page_mm = page_for(printed, page.lower())
    names = (path.name,) if own else (path.name, description.name)
    with output_folder(path.parent, "board", force=force) as output:
        output.refuse_others(*map(glob.escape, names))
        with output.staged(complete=False) as folder:
            write_board(printed, folder / path.name, page_mm, description.name)
            if not own:
                save_board(folder / description.name, printed)
    return PrintedBoard(page_mm, description)
