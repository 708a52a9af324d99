"""`mirrorcam leaderboard`: the evaluations of several calibrators beside each other, as a page."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import tyro
from pydantic import Field

from mirrorcam.core.console.option_texts import FORCE
from mirrorcam.core.console.progress import print_table, say
from mirrorcam.core.values import Value

FILE = tyro.conf.arg(metavar="FILE", help_behavior_hint="")


class LeaderboardOptions(Value):
    """Compare calibrators by the evaluation.json that `mirrorcam evaluate` wrote of each, on a page."""

    evaluations: Annotated[
        tyro.conf.Positional[tuple[str, ...]], tyro.conf.arg(metavar="NAME=FILE...", help_behavior_hint="")
    ] = Field(
        min_length=1, description="name of a calibrator and its evaluation.json; those of one name are put together"
    )
    not_run: Annotated[tuple[str, ...], tyro.conf.arg(metavar="NAME=WHY...", help_behavior_hint="")] = Field(
        default=(), description="calibrators that the page names as not run, and why"
    )
    out: Path = Field(default=Path("output/leaderboard.html"), description="the page")
    markdown: Annotated[Path | None, FILE] = Field(default=None, description="file to write the tables to as Markdown")
    json_file: Annotated[Path | None, tyro.conf.arg(name="json", metavar="FILE", help_behavior_hint="")] = Field(
        default=None, description="file to write them to as JSON"
    )
    force: bool = FORCE


def run(options: LeaderboardOptions) -> int:
    """Read, print a row for each calibrator, and write the files."""
    from mirrorcam.bench.leaderboard_files import read_leaderboard, texts, write_leaderboard
    from mirrorcam.bench.scores.leaderboard_texts import board_rows, reasons

    board = read_leaderboard(options.evaluations, options.not_run)
    files = texts(board, options.out, options.markdown, options.json_file)
    write_leaderboard(files, force=options.force)
    heads, *rows = board_rows(board)
    shown = [place for place, head in enumerate(heads) if head in ("calibrator", "sets scored", "NEES") or "px" in head]
    print_table([heads[place] for place in shown], [[row[place] for place in shown] for row in rows])
    for calibrator, why, names in reasons(board):
        say("leaderboard", f"{calibrator} failed on {', '.join(names)}: {why}")
    say("leaderboard", f"{', '.join(map(str, files))} written")
    return 0
