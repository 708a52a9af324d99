"""Messages and progress on standard output: a bar in a terminal, plain lines in a log.

Standard error is reserved for the one line of an error.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cache
from typing import TYPE_CHECKING

from rich.console import Console
from rich.progress import BarColumn, SpinnerColumn, TextColumn, TimeElapsedColumn
from rich.progress import Progress as ProgressBar
from rich.table import Table
from rich.text import Text

from mirrorcam.core.console.session import session
from mirrorcam.core.processes import interruption
from mirrorcam.core.progress import Progress, no_progress

if TYPE_CHECKING:
    from mirrorcam.core.values import Metric

SECONDS_BETWEEN_LINES = 5.0
TITLE_WIDTH = 12


@cache
def console() -> Console:
    """The console on standard output; text is printed as it is, without markup."""
    return Console(markup=False, highlight=False, emoji=False)


def say(title: str, text: str) -> None:
    """Print a message under the title of the work."""
    if session().json:
        session().message(title, text)
    if not session().prints:
        return
    console().print(Text.assemble((title.ljust(TITLE_WIDTH), "bold"), " ", text), soft_wrap=True)


@contextmanager
def long_work(title: str, doing: str, unit: str = "") -> Iterator[Progress]:
    """Show the progress of the work `title` until the block ends without an error, then print its duration.

    The block gets `advance(done, total)`, to be called as the work proceeds; work without a known total never calls it.
    """
    started = time.monotonic()
    if not session().prints:
        yield no_progress
        interruption.check()
        return
    if console().is_terminal:
        text, count = TextColumn("{task.description}"), TextColumn("{task.fields[count]}")
        columns = (SpinnerColumn(), text, BarColumn(bar_width=30), count, TimeElapsedColumn())
        with ProgressBar(*columns, console=console(), transient=True) as bar:
            task = bar.add_task(f"{title.ljust(TITLE_WIDTH)} {doing}", total=None, count="")
            yield lambda done, total: bar.update(task, completed=done, total=total, count=f"{done}/{total} {unit}")
    else:
        say(title, f"{doing} ...")
        last = started

        def advance(done: int, total: int) -> None:
            nonlocal last
            now = time.monotonic()
            if now - last >= SECONDS_BETWEEN_LINES:
                last = now
                say(title, f"{done}/{total} {unit}".rstrip() + f" after {now - started:.0f} s")

        yield advance
    interruption.check()
    say(title, f"done in {time.monotonic() - started:.1f} s")


def _cells(metrics: Sequence[Metric | None], unit: str) -> list[str]:
    """Values of one figure with equal decimals; a unit is added if it differs from the row's."""
    from mirrorcam.core.figures.figure_texts import equal_decimals, figure_text, unit_text

    texts = iter(equal_decimals([metric.value for metric in metrics if metric is not None and metric.unit == unit]))
    cells = []
    for metric in metrics:
        if metric is None:
            cells.append("")
        elif metric.unit == unit:
            cells.append(next(texts))
        else:
            cells.append(f"{figure_text(metric.value)} {unit_text(metric.unit)}")
    return cells


def print_table(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Print a table of texts; all columns but the first are right-aligned, and the first is never cut."""
    session().table(heads, rows)
    if not session().prints:
        return
    table = Table(box=None, pad_edge=False, header_style="bold")
    for column, head in enumerate(heads):
        table.add_column(head, justify="right" if column else "left", no_wrap=not column)
    for row in rows:
        table.add_row(*row)
    console().print(table)


def print_metrics(
    columns: Mapping[str, Mapping[str, Metric]], groups: Mapping[str, Sequence[str]] | None = None
) -> None:
    """Print a table of figures: one named column per set of metrics, in the order of the last set, with limits if any.

    `groups` maps titles of parts of the table to prefixes of figures' names ("" for all); figures without a group come
    last. The last column decides whether a figure passes. Lines below the table give the reasons for unknown figures.
    """
    session().figures(columns)
    if not session().prints:
        return
    from mirrorcam.core.figures.figure_texts import (
        NONE,
        digits_past_limit,
        figure_text,
        label_text,
        limit_text,
        unit_text,
    )

    names = list(dict.fromkeys(name for metrics in reversed(list(columns.values())) for name in metrics))
    by_name = {name: metric for metrics in columns.values() for name, metric in metrics.items()}
    limited = any(metric.limit is not None for metric in by_name.values())
    table = Table(box=None, pad_edge=False, header_style="bold")
    table.add_column("")
    for title in columns:
        table.add_column(title, justify="right")
    table.add_column("unit")
    if limited:
        table.add_column("limit")
        table.add_column("")

    def add(name: str, indent: str) -> None:
        unit = by_name[name].unit
        cells = _cells([metrics.get(name) for metrics in columns.values()], unit)
        if cells[-1] and (digits := digits_past_limit(by_name[name], 4)) > 4:  # show by how much it exceeds the limit
            cells[-1] = figure_text(by_name[name].value, digits)
        row = [indent + label_text(name), *cells, unit_text(unit)]
        if limited:
            row.append(limit_text(by_name[name], with_unit=False))
            row.append("" if by_name[name].limit is None else "pass" if by_name[name].passed else "FAIL")
        table.add_row(*row)

    for title, prefixes in (groups or {}).items():
        members = [name for name in names if name.startswith(tuple(prefixes))]
        if members:
            table.add_row(Text(title, style="bold"))
        for name in members:
            names.remove(name)
            add(name, "  ")
    for name in names:
        add(name, "")
    console().print(table)
    reasons: dict[str, list[str]] = {}
    for metrics in columns.values():
        for name, metric in metrics.items():
            if not metric.known and label_text(name) not in (labels := reasons.setdefault(metric.reason, [])):
                labels.append(label_text(name))
    for reason, labels in reasons.items():
        console().print(Text(f"{NONE}: {', '.join(labels)}: {reason}"), soft_wrap=True)
