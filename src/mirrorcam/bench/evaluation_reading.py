"""`evaluation.json` of anyone, in which a set with an impossible score has none."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from mirrorcam.bench.evaluation import WATCHED, Evaluation
from mirrorcam.core.disk.files import LARGEST_LAYOUT_BYTES, model_from, read_bytes, tables_of
from mirrorcam.core.messages import shortened


def read_evaluation(path: Path) -> Evaluation:
    """Read an evaluation; raises InputError in one line where it is none.

    A set whose RMS error is not a number from 0 on has no score, but a failure that says so.
    """
    tables = tables_of(path, read_bytes(path, LARGEST_LAYOUT_BYTES))
    scores = tables.get("scores") if isinstance(tables, dict) else None
    sets = scores.get("sets") if isinstance(scores, dict) else None
    if isinstance(scores, dict) and isinstance(sets, list):
        invalid = {name: why for each in sets if (name := _name_of(each)) and (why := _invalid(each))}
        scores["sets"] = [each for each in sets if _name_of(each) not in invalid]
        for each in tables["tried"] if isinstance(tables.get("tried"), list) else []:
            if (name := _name_of(each)) in invalid:
                each["failure"] = invalid[name]
    return model_from(Evaluation, path, tables)


def _name_of(table: Any) -> str:
    """The name of a set that a table states; empty where it does not."""
    name = table.get("name") if isinstance(table, dict) else None
    return name if isinstance(name, str) else ""


def _invalid(scored: dict[str, Any]) -> str:
    """Why the score in a table is none; empty where it is one, and where the table has no figures."""
    figures = scored.get("figures")
    if not isinstance(figures, dict):
        return ""
    figure = figures.get(WATCHED)
    value = figure.get("value") if isinstance(figure, dict) else None
    if isinstance(value, int | float) and not isinstance(value, bool) and 0.0 <= value < math.inf:
        return ""
    shown = shortened("".join(each for each in repr(value) if each.isprintable()), 40)
    return f"invalid result: {WATCHED} is {shown}, expected a number from 0 on"
