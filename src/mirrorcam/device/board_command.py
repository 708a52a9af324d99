"""`mirrorcam board`: a calibration board to print."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from mirrorcam.core.console.options import Force
from mirrorcam.core.console.progress import say


def board(
    description: Annotated[
        Path | None, Parameter(name="BOARD", help="board.toml to draw. [default: the default board]")
    ] = None,
    /,
    *,
    page: Annotated[
        str,
        Parameter(
            metavar="NAME|WIDTHxHEIGHT",
            help="page: a4, a3, a2, a1, a0, letter, or width x height in mm. [default: the smallest A size that fits]",
            show_default=False,
        ),
    ] = "",
    out: Annotated[Path, Parameter(help="file to write, .pdf or .svg")] = Path("output/board.pdf"),
    force: Force = False,
) -> int:
    """Draw a calibration board at true scale.

    Adds a ruler to verify the print. For the default board, board.toml is written next to the file.

    Examples:
        mirrorcam board --out board.pdf
        mirrorcam board mine.toml --page a3 --out mine.svg
    """
    from mirrorcam.device.board_files import print_board

    printed = print_board(out, description, page, force=force)
    width, height = printed.page_mm
    say("board", f"{out} written, {width:g} x {height:g} mm; print it at 100 % and measure its ruler")
    if description is None:
        say("board", f"{printed.description} written, which describes it for mirrorcam calibrate")
    else:
        say("board", f"{printed.description} describes it for mirrorcam calibrate")
    return 0
