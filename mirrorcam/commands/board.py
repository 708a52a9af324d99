"""`mirrorcam board`: a calibration board to print."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import tyro
from pydantic import Field

from mirrorcam.console.progress import say
from mirrorcam.optics.base.values import InputError, Value


class BoardOptions(Value):
    """Draw a calibration board at true scale for the printer, with a ruler to verify the print."""

    board: Annotated[tyro.conf.Positional[Path | None], tyro.conf.arg(metavar="BOARD", help_behavior_hint="")] = Field(
        default=None,
        description="board.toml; without it, the default board, whose numbers are written beside the print",
    )
    page: Annotated[str, tyro.conf.arg(metavar="NAME|WIDTHxHEIGHT", help_behavior_hint="(smallest A)")] = Field(
        default="", description="a4, a3, a2, a1, a0, letter, or a width and height in mm"
    )
    out: Path = Field(default=Path("output/board.pdf"), description=".pdf or .svg file")


def run(options: BoardOptions) -> int:
    """Write the sheet."""
    from mirrorcam.figures.board_print import FORMATS, page_for, write_board
    from mirrorcam.optics.geometry.targets import default_board, load_board, save_board

    if options.out.suffix not in FORMATS:
        raise InputError(f"--out {options.out}: expected a name that ends in {' or '.join(FORMATS)}")
    target = default_board() if options.board is None else load_board(options.board)
    page = page_for(target, options.page.lower())
    numbers = options.out.with_suffix(".toml") if options.board is None else options.board
    write_board(target, options.out, page, numbers.name)
    if options.board is None:
        save_board(numbers, target)
    say("board", f"{options.out} written, {page[0]:g} x {page[1]:g} mm; print it at 100 % and measure its ruler")
    say("board", f"{numbers} holds its numbers")
    return 0
