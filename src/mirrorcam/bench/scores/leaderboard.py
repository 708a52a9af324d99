"""Compare calibrators by their scores on each set, and over the sets that all of them scored."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Literal

import numpy as np
from pydantic import Field

from mirrorcam.bench.scores.consistency import Nees, pooled
from mirrorcam.bench.scores.report_texts import value_text
from mirrorcam.core.errors import InputError
from mirrorcam.core.figures.figure_texts import count_text
from mirrorcam.core.names import LONGEST, Line, Name, markdown_text
from mirrorcam.core.values import Metric, Value


class TriedSet(Value):
    """A set on which a calibrator was run.

    Attributes
    ----------
    name, why
        The set, and its purpose.
    dataset_sha256
        Checksum of its manifest; equal for equal sets.
    seconds
        Duration of the calibrator.
    failure
        Reason for a missing score; empty if there is one.
    """

    name: Name
    why: Line
    dataset_sha256: str
    seconds: float
    failure: Line = ""


class Attempt(TriedSet):
    """A set on which a calibrator was run, with the figures of its score, if any."""

    figures: dict[str, Metric]


RANKED = "rms_px"
MEANS = (RANKED, "rms_mm", "triangulation_rms_mm", "focal_error_rms_percent")
"""Figures compared by their mean over sets."""
WORST = "worst_view_rms_px"
"""The figure compared by its maximum over sets."""
NEES, LOW, HIGH, FREEDOM = "nees", "nees_low", "nees_high", "nees_freedom"
MAX_FIGURE = 1e9
"""Maximum absolute value of a figure that is accepted."""
HASH_CHARS = 6


class BoardSet(Value):
    """A set on the board; its name includes a part of its checksum if another set has the same name."""

    name: Name
    why: Line
    dataset_sha256: str


class BoardRow(Value):
    """A calibrator's results.

    Attributes
    ----------
    over_common, over_own
        Figures over the sets that all calibrators scored, and over those that this one scored: means of `MEANS`, the
        maximum of `WORST`, and pooled NEES with its interval. A figure missing in one of the scores is omitted.
    seconds
        Mean duration over scored sets; None without a score.
    rms_px
        RMS error of each scored set, by the set's name.
    failures
        Reasons for missing scores, by the set's name.
    """

    calibrator: Name
    command: Line
    over_common: dict[str, float]
    over_own: dict[str, float]
    seconds: float | None
    rms_px: dict[str, float]
    failures: dict[str, Line]

    @property
    def tried(self) -> int:
        """Number of sets on which it was run."""
        return len(self.rms_px) + len(self.failures)


class Leaderboard(Value):
    """Calibrators, best first: by the mean RMS error over common sets, then over their own sets.

    Attributes
    ----------
    common
        Names of the sets that all calibrators with any score have scored.
    not_run
        Reasons why other calibrators could not be run, by name.
    """

    schema_id: Literal["mirrorcam.leaderboard/1"] = Field(default="mirrorcam.leaderboard/1", alias="schema")
    sets: tuple[BoardSet, ...]
    common: tuple[str, ...]
    rows: tuple[BoardRow, ...]
    not_run: dict[Name, Line]

    def text(self) -> str:
        """Return the JSON."""
        return self.model_dump_json(indent=1, by_alias=True) + "\n"


def leaderboard(
    attempts: Mapping[str, Sequence[Attempt]], commands: Mapping[str, str], not_run: Mapping[str, str]
) -> Leaderboard:
    """Return the board of calibrators by name; raises InputError for inconsistent results."""
    sets = _sets(attempts)
    names = {board_set.dataset_sha256: board_set.name for board_set in sets}
    by_set = {name: _by_set_name(name, tries, names) for name, tries in attempts.items()}
    scored = {name: {each for each, attempt in tries.items() if not attempt.failure} for name, tries in by_set.items()}
    nonempty = [scored_names for scored_names in scored.values() if scored_names]
    common_names = set.intersection(*nonempty) if nonempty else set()
    common = tuple(board_set.name for board_set in sets if board_set.name in common_names)
    rows = [
        BoardRow(
            calibrator=name,
            command=commands[name],
            over_common=_over([tries[set_name] for set_name in common] if scored[name] else []),
            over_own=_over([tries[set_name] for set_name in sorted(scored[name])]),
            seconds=float(np.mean([tries[set_name].seconds for set_name in scored[name]])) if scored[name] else None,
            rms_px={each: _value(tries[each], RANKED) for each in names.values() if each in scored[name]},
            failures={each: tries[each].failure for each in names.values() if each in tries.keys() - scored[name]},
        )
        for name, tries in by_set.items()
    ]
    last = float("inf")
    rows.sort(key=lambda row: (row.over_common.get(RANKED, last), row.over_own.get(RANKED, last)))
    return Leaderboard(sets=sets, common=common, rows=tuple(rows), not_run=dict(not_run))


def _sets(attempts: Mapping[str, Sequence[Attempt]]) -> tuple[BoardSet, ...]:
    """Return the distinct sets in order of first appearance."""
    first = {attempt.dataset_sha256: attempt for tries in attempts.values() for attempt in reversed(tries)}
    digests = dict.fromkeys(attempt.dataset_sha256 for tries in attempts.values() for attempt in tries)
    ordered = {digest: first[digest] for digest in digests}
    counts = Counter(attempt.name for attempt in ordered.values())
    return tuple(
        BoardSet(
            name=attempt.name
            if counts[attempt.name] == 1
            else f"{attempt.name[: LONGEST - HASH_CHARS - 1]} {digest[:HASH_CHARS]}",
            why=attempt.why,
            dataset_sha256=digest,
        )
        for digest, attempt in ordered.items()
    )


def _by_set_name(calibrator: str, tries: Sequence[Attempt], names: Mapping[str, str]) -> dict[str, Attempt]:
    """Return a calibrator's attempts by the names of the sets on the board; raises InputError for an invalid one."""
    by_name: dict[str, Attempt] = {}
    for attempt in tries:
        name = names[attempt.dataset_sha256]
        if name in by_name:
            raise InputError(f"{calibrator}: the set {name} appears twice, expected each set once")
        by_name[name] = attempt
        if not attempt.failure and RANKED not in attempt.figures:
            raise InputError(f"{calibrator}: the score of {name} lacks {RANKED}, which every score must have")
        for figure, metric in attempt.figures.items():
            if abs(metric.value) > MAX_FIGURE:
                raise InputError(
                    f"{calibrator}: {figure[:40]} of {name} is {metric.value:g}, expected at most {MAX_FIGURE:g}"
                )
        if not 0.0 <= attempt.seconds <= MAX_FIGURE:
            raise InputError(f"{calibrator}: {name} took {attempt.seconds:g} s, expected 0 to {MAX_FIGURE:g} s")
    return by_name


def _over(scores: Sequence[Attempt]) -> dict[str, float]:
    """Return the figures over several scores."""
    over: dict[str, float] = {}
    for name in (*MEANS, WORST):
        values = [_value(score, name) for score in scores if name in score.figures]
        if values and len(values) == len(scores):
            over[name] = float(max(values) if name == WORST else np.mean(values))
    with_nees = [score for score in scores if score.figures.keys() >= {NEES, FREEDOM} and _value(score, FREEDOM) >= 1.0]
    joint = pooled([_nees(score) for score in with_nees]) if len(with_nees) == len(scores) else None
    if joint is not None:
        low, high = joint.interval
        over |= {NEES: joint.mean, LOW: low, HIGH: high, FREEDOM: float(joint.freedom)}
    return over


def _nees(attempt: Attempt) -> Nees:
    freedom = round(_value(attempt, FREEDOM))
    return Nees(_value(attempt, NEES) * freedom, freedom)


def _value(attempt: Attempt, name: str) -> float:
    return attempt.figures[name].value


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
    "with the best motion of the rig removed. Except for RMS over own sets and time, figures are over the common "
    "sets: means, but the maximum for the worst view. NEES is the squared error in units of the stated covariance, 1 "
    "if that is right; brackets hold the 95 % interval in this case. Time is per set, on the machine that ran it."
)


def board_rows(board: Leaderboard) -> list[list[str]]:
    """Return the header of the table of calibrators, and a row for each."""
    header = ["calibrator", "sets scored", "RMS px", "RMS px, own sets", *COLUMNS.values(), "NEES", "s per set"]
    return [header, *(_row(row) for row in board.rows)]


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
    """Return the header of the table of sets, and a row for each: its name, and the result of every calibrator."""
    return [
        ["RMS px", *(row.calibrator for row in board.rows)],
        *([board_set.name, *(set_text(row, board_set.name) for row in board.rows)] for board_set in board.sets),
    ]


def set_text(row: BoardRow, name: str) -> str:
    """Format a calibrator's result on a set."""
    if name in row.rms_px:
        return _text(row.rms_px[name])
    return FAILED if name in row.failures else NOT_TRIED


def reasons(board: Leaderboard) -> list[tuple[str, str, tuple[str, ...]]]:
    """Return each calibrator, each reason of its failures, and the sets on which it failed for this reason."""
    sets: dict[tuple[str, str], list[str]] = {}
    for row in board.rows:
        for name, reason in row.failures.items():
            sets.setdefault((row.calibrator, reason), []).append(name)
    return [(calibrator, reason, tuple(names)) for (calibrator, reason), names in sets.items()]


def common_text(board: Leaderboard) -> str:
    """State which sets are compared."""
    if not board.common:
        return "No set was scored by all calibrators: only figures over own sets are given"
    return f"Common sets, scored by all calibrators that scored any: {', '.join(board.common)}"


def markdown(board: Leaderboard) -> str:
    """Return the board as Markdown: both tables, reasons, and commands."""
    parts = [
        f"# Leaderboard: {count_text(len(board.rows), 'calibrator')} on {count_text(len(board.sets), 'set')}\n",
        _table(board_rows(board)),
        f"{HOW_TO_READ}\n\n{markdown_text(common_text(board))}.\n",
    ]
    if board.not_run:
        parts.append("## Not run\n")
        parts += [f"- {markdown_text(name)}: {markdown_text(reason)}" for name, reason in board.not_run.items()]
        parts.append("")
    parts += ["## Each set\n", _table(set_rows(board))]
    if failed := reasons(board):
        parts.append("## Failed\n")
        lines = (f"{name} on {', '.join(sets)}: {reason}" for name, reason, sets in failed)
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
