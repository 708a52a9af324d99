"""`mirrorcam board`: a calibration board to print."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import tyro
from pydantic import Field

from mirrorcam.core.console.option_texts import FORCE
from mirrorcam.core.console.progress import say
from mirrorcam.core.values import Value


class BoardOptions(Value):
    """Draw a calibration board at true scale for the printer, with a ruler to verify the print."""

    board: Annotated[tyro.conf.Positional[Path | None], tyro.conf.arg(metavar="[BOARD]", help_behavior_hint="")] = (
        Field(
            default=None,
            description=(
                "board.toml to draw; without it the default board is drawn, and its board.toml written next to the file"
            ),
        )
    )
    page: Annotated[
        str, tyro.conf.arg(metavar="NAME|WIDTHxHEIGHT", help_behavior_hint="(the smallest A size that fits)")
    ] = Field(default="", description="page: a4, a3, a2, a1, a0, letter, or width x height in mm")
    out: Path = Field(default=Path("output/board.pdf"), description="file to write, .pdf or .svg")
    force: bool = FORCE


def run(options: BoardOptions) -> int:
    """Write the page."""
    from mirrorcam.device.board_files import print_board

    printed = print_board(options.out, options.board, options.page, force=options.force)
    width, height = printed.page_mm
    say("board", f"{options.out} written, {width:g} x {height:g} mm; print it at 100 % and measure its ruler")
    if options.board is None:
        say("board", f"{printed.numbers} written, which describes it for mirrorcam calibrate")
    else:
        say("board", f"{printed.numbers} describes it for mirrorcam calibrate")
    return 0
