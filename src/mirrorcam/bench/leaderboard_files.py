"""A leaderboard: read from `evaluation.json` files, and written as a page, Markdown and JSON."""

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
MAX_CHARS = 500


def read_leaderboard(evaluations: Sequence[str], not_run: Sequence[str] = ()) -> Leaderboard:
    """Read a leaderboard from evaluations (`NAME=FILE`, joined by name) and calibrators not run (`NAME=WHY`).

    Raises InputError for a file that is not an evaluation, or for inconsistent results.
    """
    attempts: dict[str, list[Attempt]] = {}
    commands: dict[str, list[str]] = {}
    for option in evaluations:
        name, file = _pair(option, "NAME=FILE")
        evaluation = read_evaluation(Path(file))
        attempts.setdefault(name, []).extend(attempts_of(evaluation))
        tried = commands.setdefault(name, [])
        if evaluation.command not in tried:
            tried.append(evaluation.command)
    skipped = dict(_pair(option, "NAME=WHY") for option in not_run)
    if both := sorted(skipped.keys() & attempts.keys()):
        raise InputError(f"--not-run: {both[0]} has an evaluation, expected none")
    lines = {name: shortened("; ".join(tried), MAX_CHARS - 10) for name, tried in commands.items()}
    return leaderboard(attempts, lines, skipped)


def attempts_of(evaluation: Evaluation) -> list[Attempt]:
    """Return the outcome of each set; raises InputError for one that has not exactly one of score and failure."""
    scored, attempts = evaluation.scored, []
    for tried in evaluation.tried:
        if (tried.name in scored) == bool(tried.failure):
            raise InputError(f"{tried.name}: expected either a score or a failure")
        figures = {} if tried.failure else scored[tried.name].figures
        attempts.append(Attempt(**tried.model_dump(), figures=figures))
    return attempts


def _pair(option: str, form: str) -> tuple[str, str]:
    name, _, rest = option.partition("=")
    if not rest or not name or len(name) > LONGEST or not name.isprintable() or not rest.isprintable():
        raise InputError(f"{shortened(option, 80)!r}: expected {form}, NAME with 1 to {LONGEST} printable characters")
    if form.endswith("WHY") and len(rest) > MAX_CHARS:
        raise InputError(f"--not-run {name}: {len(rest)} characters, expected at most {MAX_CHARS}")
    return name, rest


def write_leaderboard(board: Leaderboard, folder: Path) -> None:
    """Write the files of a leaderboard into a folder, each atomically."""
    for name, content in zip(FILES, (leaderboard_page(board), markdown(board), board.text()), strict=True):
        write_text(folder / name, content)


TEMPLATES = Path(__file__).parent
WIDTH, ROW, TOP, BOTTOM, EDGE = 480.0, 46.0, 8.0, 46.0, 14.0
"""Size of the drawing: narrow, so that its text is legible on a phone."""
MAX_LABEL = 44
MIN_PX = 1e-6
"""Smaller errors are drawn at this value, because the axis is logarithmic."""


def leaderboard_page(board: Leaderboard) -> str:
    """Render the page."""
    count = count_text(len(board.rows), "calibrator")
    return render(
        TEMPLATES,
        "leaderboard_page.html",
        title="Leaderboard of calibrators",
        lead=f"{count}, each run on rendered sets without their ground truth, and compared with that truth.",
        tiles=_tiles(board),
        table=Table(*_split(board_rows(board)), style="figures"),
        how_to_read=HOW_TO_READ,
        common=common_text(board),
        chart=rms_chart(board),
        sets=_set_table(board),
        reasons=[(calibrator, ", ".join(names), reason) for calibrator, reason, names in reasons(board)],
        not_run=tuple(board.not_run.items()),
        commands=[(row.calibrator, row.command) for row in board.rows],
        about=[(board_set.name, board_set.why) for board_set in board.sets],
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
    """Return the table of RMS px by set and calibrator, with the best of each set in bold, and failures marked."""
    header, *_ = set_rows(board)
    rows: list[tuple[str | Markup, ...]] = []
    for name in (board_set.name for board_set in board.sets):
        errors = [row.rms_px[name] for row in board.rows if name in row.rms_px]
        best = min(errors) if len(errors) > 1 else None
        rows.append((name, *(_cell(row, name, best) for row in board.rows)))
    return Table(header, rows, style="figures")


def _cell(row: BoardRow, name: str, best: float | None) -> str | Markup:
    cell = set_text(row, name)
    if name in row.failures:
        return Markup('<b class="fail" title="{}">{}</b>').format(row.failures[name], cell)
    return Markup("<b>{}</b>").format(cell) if best is not None and row.rms_px.get(name) == best else cell


def rms_chart(board: Leaderboard) -> Markup:
    """Draw each calibrator's RMS error on a logarithmic axis: a dot per set, a bar up to the mean over common sets."""
    rows = [row for row in board.rows if row.rms_px]
    if not rows:
        return Markup()
    logs = [_log(value) for row in rows for value in row.rms_px.values()]
    x = Scale(math.floor(min(logs)), max(math.ceil(max(logs)), math.floor(min(logs)) + 1), EDGE, WIDTH - EDGE)
    end = TOP + ROW * len(rows)
    parts = []
    for power in range(int(x.low), int(x.high) + 1):
        parts.append(line(x(power), TOP, x(power), end, "grid"))
        parts.append(text(x(power), end + 18, f"{10.0**power:g}", style="tick"))
    parts.append(text((x.start + x.end) / 2, end + 38, "RMS error, px", style="name"))
    for number, row in enumerate(rows):
        y = TOP + ROW * number + 14
        label = row.calibrator if len(row.calibrator) <= MAX_LABEL else f"{row.calibrator[: MAX_LABEL - 1]}…"
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
    return math.log10(max(abs(value), MIN_PX))
