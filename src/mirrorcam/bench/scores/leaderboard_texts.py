"""The tables of a leaderboard as texts, and as Markdown."""

from __future__ import annotations

from collections.abc import Sequence

from mirrorcam.bench.scores.leaderboard import HIGH, LOW, NEES, RANKED, BoardRow, Leaderboard
from mirrorcam.bench.scores.report_texts import value_text
from mirrorcam.core.figures.figure_texts import count_text
from mirrorcam.core.names import markdown_text

COLUMNS = {
    "worst_view_rms_px": "worst view px",
    "rms_mm": "RMS mm",
    "triangulation_rms_mm": "triangulation mm",
    "focal_error_rms_percent": "focal length %",
}
"""Figures of the table of calibrators after the RMS error, over common sets."""
NOT_TRIED, FAILED, NONE = "not tried", "failed", "-"
DIGITS = 3
HOW_TO_READ = (
    "RMS px is the error, in pixels of the frame, of points in the working volume as the calibration projects them, "
    "with the best motion of the rig taken out. Except for RMS over own sets and time, figures are over the common "
    "sets: means, and of the worst view the largest. NEES is the error in units of the stated covariance, 1 where it "
    "is right, and in brackets the interval of 95 of 100 right ones. Time is that of a set on the machine of whoever "
    "ran it."
)


def board_rows(board: Leaderboard) -> list[list[str]]:
    """Heads of the table of calibrators, and a row of texts for each."""
    heads = ["calibrator", "sets scored", "RMS px", "RMS px, own sets", *COLUMNS.values(), "NEES", "s a set"]
    return [heads, *(_row(row) for row in board.rows)]


def _row(row: BoardRow) -> list[str]:
    common = row.over_common
    nees = NONE
    if NEES in common:
        nees = f"{_text(common[NEES])} [{common[LOW]:.2f}, {common[HIGH]:.2f}]"
    return [
        row.calibrator,
        f"{len(row.rms_px)} of {row.tried}",
        _text(common.get(RANKED)),
        _text(row.over_own.get(RANKED)),
        *(_text(common.get(name)) for name in COLUMNS),
        nees,
        NONE if row.seconds is None else f"{row.seconds:.1f}",
    ]


def set_rows(board: Leaderboard) -> list[list[str]]:
    """Heads of the table of sets, and a row for each: its name, and RMS px of every calibrator, or that it failed."""
    return [
        ["RMS px", *(row.calibrator for row in board.rows)],
        *([each.name, *(set_text(row, each.name) for row in board.rows)] for each in board.sets),
    ]


def set_text(row: BoardRow, name: str) -> str:
    """What a calibrator has of a set."""
    if name in row.rms_px:
        return _text(row.rms_px[name])
    return FAILED if name in row.failures else NOT_TRIED


def reasons(board: Leaderboard) -> list[tuple[str, str, tuple[str, ...]]]:
    """Calibrator, reason, and the sets that it failed on for this reason, each once."""
    found: dict[tuple[str, str], list[str]] = {}
    for row in board.rows:
        for name, why in row.failures.items():
            found.setdefault((row.calibrator, why), []).append(name)
    return [(calibrator, why, tuple(names)) for (calibrator, why), names in found.items()]


def common_text(board: Leaderboard) -> str:
    """Which sets are compared."""
    if not board.common:
        return "No set was scored by all calibrators: only figures over own sets are given"
    return f"Common sets, scored by all calibrators that scored any: {', '.join(board.common)}"


def markdown(board: Leaderboard) -> str:
    """The board as Markdown: both tables, reasons, and commands."""
    parts = [
        f"# Leaderboard: {count_text(len(board.rows), 'calibrator')} on {count_text(len(board.sets), 'set')}\n",
        _table(board_rows(board)),
        f"{HOW_TO_READ}\n\n{markdown_text(common_text(board))}.\n",
    ]
    if board.not_run:
        parts.append("## Not run\n")
        parts += [f"- {markdown_text(name)}: {markdown_text(why)}" for name, why in board.not_run.items()]
        parts.append("")
    parts += ["## Each set\n", _table(set_rows(board))]
    if failed := reasons(board):
        parts.append("## Failed\n")
        lines = (f"{name} on {', '.join(sets)}: {why}" for name, why, sets in failed)
        parts += [f"- {markdown_text(line)}" for line in lines]
        parts.append("")
    parts.append("## Commands\n")
    parts += [f"- {markdown_text(row.calibrator)}: `{row.command.replace('`', '_')}`" for row in board.rows]
    return "\n".join(parts) + "\n"


def _text(value: float | None) -> str:
    return NONE if value is None else value_text(value, DIGITS)


def _table(rows: Sequence[Sequence[str]]) -> str:
    lines = [f"| {' | '.join(map(markdown_text, row))} |" for row in rows]
    return "\n".join([lines[0], f"|{'---|' * len(rows[0])}", *lines[1:]]) + "\n"
