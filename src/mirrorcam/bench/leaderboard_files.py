"""A leaderboard from `evaluation.json` files, written as files."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

from markupsafe import Markup

from mirrorcam.bench.evaluation import Evaluation, read_evaluation
from mirrorcam.bench.scores.leaderboard import (
    HOW_TO_READ,
    RANKED,
    Attempt,
    BoardRow,
    Leaderboard,
    board_rows,
    common_text,
    leaderboard,
    markdown,
    reasons,
    set_rows,
    set_text,
)
from mirrorcam.bench.scores.report_texts import value_text
from mirrorcam.core.disk.files import write_text
from mirrorcam.core.errors import InputError
from mirrorcam.core.figures.figure_texts import count_text
from mirrorcam.core.html.inline_svg import Scale, coordinate, drawing, line, text
from mirrorcam.core.html.templates import Table, Tile, render
from mirrorcam.core.messages import shortened
from mirrorcam.core.names import LONGEST

FILES = ("leaderboard.html", "leaderboard.md", "leaderboard.json")
"""Names of the files of a leaderboard."""
MOST_CHARS = 500


def read_leaderboard(evaluations: Sequence[str], not_run: Sequence[str] = ()) -> Leaderboard:
    """Read a leaderboard of evaluations (`NAME=FILE`, joined by name) and of calibrators not run (`NAME=WHY`).

    Raises InputError in one line for a file that is not an evaluation, or for inconsistent results.
    """
    attempts: dict[str, list[Attempt]] = {}
    commands: dict[str, list[str]] = {}
    for given in evaluations:
        name, file = _pair(given, "NAME=FILE")
        evaluation = read_evaluation(Path(file))
        attempts.setdefault(name, []).extend(attempts_of(evaluation))
        tried = commands.setdefault(name, [])
        if evaluation.command not in tried:
            tried.append(evaluation.command)
    skipped = dict(_pair(given, "NAME=WHY") for given in not_run)
    if both := sorted(skipped.keys() & attempts.keys()):
        raise InputError(f"--not-run: {both[0]} has an evaluation, expected none")
    lines = {name: shortened("; ".join(tried), MOST_CHARS - 10) for name, tried in commands.items()}
    return leaderboard(attempts, lines, skipped)


def attempts_of(evaluation: Evaluation) -> list[Attempt]:
    """Outcome of each set; raises InputError for one with neither a score nor a failure."""
    scored, found = evaluation.scored, []
    for each in evaluation.tried:
        if (each.name in scored) == bool(each.failure):
            raise InputError(f"{each.name}: expected either a score or a failure")
        figures = {} if each.failure else scored[each.name].figures
        found.append(Attempt(**each.model_dump(), figures=figures))
    return found


def _pair(given: str, form: str) -> tuple[str, str]:
    name, _, rest = given.partition("=")
    if not rest or not name or len(name) > LONGEST or not name.isprintable() or not rest.isprintable():
        raise InputError(f"{shortened(given, 80)!r}: expected {form}, NAME with 1 to {LONGEST} printable characters")
    if form.endswith("WHY") and len(rest) > MOST_CHARS:
        raise InputError(f"--not-run {name}: {len(rest)} characters, expected {MOST_CHARS} at most")
    return name, rest


def write_leaderboard(board: Leaderboard, folder: Path) -> None:
    """Write the files of a leaderboard into a folder, each atomically."""
    for name, content in zip(FILES, (leaderboard_page(board), markdown(board), board.text()), strict=True):
        write_text(folder / name, content)


TEMPLATES = Path(__file__).parent
WIDTH, ROW, TOP, BOTTOM, EDGE = 480.0, 46.0, 8.0, 46.0, 14.0
"""Size of the drawing: narrow, so that its text is legible on a phone."""
LONGEST_LABEL = 44
SMALLEST_PX = 1e-6
"""Smaller errors are drawn at this value, as the axis is logarithmic."""


def leaderboard_page(board: Leaderboard) -> str:
    """Render the page."""
    count = count_text(len(board.rows), "calibrator")
    return render(
        TEMPLATES,
        "leaderboard_page.html",
        title="Leaderboard of calibrators",
        lead=f"{count}, each run on rendered sets of pictures without their ground truth, and compared with it.",
        tiles=_tiles(board),
        table=Table(*_split(board_rows(board)), style="figures"),
        how_to_read=HOW_TO_READ,
        common=common_text(board),
        chart=rms_chart(board),
        sets=_set_table(board),
        reasons=[(calibrator, ", ".join(names), why) for calibrator, why, names in reasons(board)],
        not_run=tuple(board.not_run.items()),
        commands=[(row.calibrator, row.command) for row in board.rows],
        about=[(each.name, each.why) for each in board.sets],
    )


def _split(rows: list[list[str]]) -> tuple[list[str], list[list[str]]]:
    header, *others = rows
    return header, others


def _tiles(board: Leaderboard) -> list[Tile]:
    tiles = [
        Tile(f"{len(board.sets)}", "sets"),
        Tile(f"{len(board.common)}", "of them scored by all calibrators"),
    ]
    best = board.rows[0] if board.rows else None
    if best is not None and RANKED in best.over_common:
        tiles.append(Tile(f"{value_text(best.over_common[RANKED], 3)} px", f"RMS error of the best, {best.calibrator}"))
    return tiles


def _set_table(board: Leaderboard) -> Table:
    """RMS px of every set and calibrator, the best of a set in bold, and failures marked."""
    header, *_ = set_rows(board)
    rows: list[tuple[str | Markup, ...]] = []
    for each in board.sets:
        errors = [row.rms_px[each.name] for row in board.rows if each.name in row.rms_px]
        best = min(errors) if len(errors) > 1 else None
        rows.append((each.name, *(_cell(row, each.name, best) for row in board.rows)))
    return Table(header, rows, style="figures")


def _cell(row: BoardRow, name: str, best: float | None) -> str | Markup:
    shown = set_text(row, name)
    if name in row.failures:
        return Markup('<b class="fail" title="{}">{}</b>').format(row.failures[name], shown)
    return Markup("<b>{}</b>").format(shown) if best is not None and row.rms_px.get(name) == best else shown


def rms_chart(board: Leaderboard) -> Markup:
    """Draw the RMS error of each calibrator: a dot per set, and a bar to the mean over common sets, if any.

    The axis is logarithmic.
    """
    shown = [row for row in board.rows if row.rms_px]
    if not shown:
        return Markup()
    logs = [_log(value) for row in shown for value in row.rms_px.values()]
    x = Scale(math.floor(min(logs)), max(math.ceil(max(logs)), math.floor(min(logs)) + 1), EDGE, WIDTH - EDGE)
    end = TOP + ROW * len(shown)
    parts = []
    for power in range(int(x.low), int(x.high) + 1):
        parts.append(line(x(power), TOP, x(power), end, "grid"))
        parts.append(text(x(power), end + 18, f"{10.0**power:g}", style="tick"))
    parts.append(text((x.start + x.end) / 2, end + 38, "RMS error, px", style="name"))
    for number, row in enumerate(shown):
        y = TOP + ROW * number + 14
        label = row.calibrator if len(row.calibrator) <= LONGEST_LABEL else f"{row.calibrator[: LONGEST_LABEL - 1]}…"
        mean = row.over_common.get(RANKED)
        if mean is not None:
            size = f'x="{x.start:g}" y="{y + 8:g}" width="{coordinate(x(_log(mean)) - x.start)}" height="14"'
            parts.append(f'<rect {size} class="key" fill-opacity=".25"/>')
            label += f": {value_text(mean, 3)} px"
        parts += [
            f'<circle cx="{coordinate(x(_log(value)))}" cy="{y + 15:g}" r="3.5" class="dot"/>'
            for value in row.rms_px.values()
        ]
        parts.append(text(x.start, y + 2, label, anchor="start", style="on"))
    return drawing(WIDTH, end + BOTTOM, "".join(parts), "RMS error of every calibrator and set")


def _log(value: float) -> float:
    return math.log10(max(abs(value), SMALLEST_PX))
