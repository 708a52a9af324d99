"""Calibrators beside each other: what each scored on which sets, and over the sets that all of them scored."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Literal

import numpy as np
from pydantic import Field

from mirrorcam.bench.scores.attempt import Attempt
from mirrorcam.bench.scores.consistency import Nees, pooled
from mirrorcam.core.names import LONGEST, Line, Name
from mirrorcam.core.values import InputError, Value

RANKED = "rms_px"
MEANS = (RANKED, "rms_mm", "triangulation_rms_mm", "focal_error_rms_percent")
"""Figures of which the mean over sets is compared."""
WORST = "worst_view_rms_px"
"""The figure of which the largest over sets is compared."""
NEES, LOW, HIGH, FREEDOM = "nees", "nees_low", "nees_high", "nees_freedom"
LARGEST = 1e9
"""No figure of a score is larger."""
HASH_CHARS = 6


class BoardSet(Value):
    """A set as the board names it: by its name, and a part of its checksum where others have that name, too."""

    name: Name
    why: Line
    dataset_sha256: str


class BoardRow(Value):
    """A calibrator's results.

    Attributes
    ----------
    over_common, over_own
        Figures over the sets that all calibrators scored, and over all that this one did: means of `MEANS`, the
        largest of `WORST`, and NEES over all their degrees of freedom with its interval. A figure that one of these
        scores lacks is left out.
    seconds
        Mean time of a set that it scored; None where it scored none.
    rms_px
        Of each set that it scored, by the set's name.
    failures
        Why it has no score of others that it was tried on.
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
        """Number of sets that it was tried on."""
        return len(self.rms_px) + len(self.failures)


class Leaderboard(Value):
    """Calibrators, best first: by the mean RMS error over common sets, then by that over their own.

    Attributes
    ----------
    common
        Names of the sets that every calibrator scored which scored any.
    not_run
        Why others could not be run, by their names.
    """

    schema_id: Literal["mirrorcam.leaderboard/1"] = Field(default="mirrorcam.leaderboard/1", alias="schema")
    sets: tuple[BoardSet, ...]
    common: tuple[str, ...]
    rows: tuple[BoardRow, ...]
    not_run: dict[Name, Line]

    def text(self) -> str:
        """The JSON."""
        return self.model_dump_json(indent=1, by_alias=True) + "\n"


def leaderboard(
    attempts: Mapping[str, Sequence[Attempt]], commands: Mapping[str, str], not_run: Mapping[str, str]
) -> Leaderboard:
    """The board of calibrators by their names; raises InputError in one line where results do not fit together."""
    sets = _sets(attempts)
    names = {each.dataset_sha256: each.name for each in sets}
    by_set = {name: _checked(name, tries, names) for name, tries in attempts.items()}
    scored = {name: {of for of, attempt in tries.items() if not attempt.failure} for name, tries in by_set.items()}
    every = [found for found in scored.values() if found]
    common = tuple(each.name for each in sets if every and all(each.name in found for found in every))
    rows = [
        BoardRow(
            calibrator=name,
            command=commands[name],
            over_common=_over([tries[of] for of in common] if scored[name] else []),
            over_own=_over([tries[of] for of in sorted(scored[name])]),
            seconds=float(np.mean([tries[of].seconds for of in scored[name]])) if scored[name] else None,
            rms_px={each.name: _value(tries[each.name], RANKED) for each in sets if each.name in scored[name]},
            failures={each.name: tries[each.name].failure for each in sets if each.name in tries.keys() - scored[name]},
        )
        for name, tries in by_set.items()
    ]
    last = float("inf")
    rows.sort(key=lambda row: (row.over_common.get(RANKED, last), row.over_own.get(RANKED, last)))
    return Leaderboard(sets=sets, common=common, rows=tuple(rows), not_run=dict(not_run))


def _sets(attempts: Mapping[str, Sequence[Attempt]]) -> tuple[BoardSet, ...]:
    """The different sets, in the order in which they come."""
    found = {each.dataset_sha256: each for tries in attempts.values() for each in reversed(tries)}
    ordered = {each.dataset_sha256: found[each.dataset_sha256] for tries in attempts.values() for each in tries}
    called = Counter(each.name for each in ordered.values())
    return tuple(
        BoardSet(
            name=each.name
            if called[each.name] == 1
            else f"{each.name[: LONGEST - HASH_CHARS - 1]} {digest[:HASH_CHARS]}",
            why=each.why,
            dataset_sha256=digest,
        )
        for digest, each in ordered.items()
    )


def _checked(calibrator: str, tries: Sequence[Attempt], names: Mapping[str, str]) -> dict[str, Attempt]:
    """A calibrator's attempts by the names of the sets on the board; raises InputError for what cannot be one."""
    found: dict[str, Attempt] = {}
    for attempt in tries:
        name = names[attempt.dataset_sha256]
        if name in found:
            raise InputError(f"{calibrator}: the set {name} appears twice, expected each set once")
        found[name] = attempt
        if not attempt.failure and RANKED not in attempt.figures:
            raise InputError(f"{calibrator}: the score of {name} lacks {RANKED}, expected it in every score")
        for figure, metric in attempt.figures.items():
            if abs(metric.value) > LARGEST:
                raise InputError(
                    f"{calibrator}: {figure[:40]} of {name} is {metric.value:g}, expected {LARGEST:g} at most"
                )
        if not 0.0 <= attempt.seconds <= LARGEST:
            raise InputError(f"{calibrator}: {name} took {attempt.seconds:g} s, expected a time")
    return found


def _over(scores: Sequence[Attempt]) -> dict[str, float]:
    """The figures over some scores."""
    over: dict[str, float] = {}
    for name in (*MEANS, WORST):
        values = [_value(each, name) for each in scores if name in each.figures]
        if values and len(values) == len(scores):
            # Some are signed, but these are all sizes.
            over[name] = float(max(values) if name == WORST else np.mean(values))
    stated = [each for each in scores if each.figures.keys() >= {NEES, FREEDOM} and _value(each, FREEDOM) >= 1.0]
    together = pooled([_nees(each) for each in stated]) if len(stated) == len(scores) else None
    if together is not None:
        low, high = together.interval
        over |= {NEES: together.mean, LOW: low, HIGH: high, FREEDOM: float(together.freedom)}
    return over


def _nees(attempt: Attempt) -> Nees:
    freedom = round(_value(attempt, FREEDOM))
    return Nees(_value(attempt, NEES) * freedom, freedom)


def _value(attempt: Attempt, name: str) -> float:
    return attempt.figures[name].value
