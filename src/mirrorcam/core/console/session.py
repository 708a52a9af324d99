"""Output mode of a command: everything, errors only, or one JSON object of results."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from mirrorcam.core.values import Metric


@dataclass
class Session:
    """Output mode of one command, and the results reported so far for `--json`."""

    quiet: bool = False
    verbose: bool = False
    json: bool = False
    results: dict[str, Any] = field(default_factory=dict)

    @property
    def prints(self) -> bool:
        """Whether messages, tables and progress go to standard output."""
        return not (self.quiet or self.json)

    def message(self, title: str, text: str) -> None:
        """Record a message."""
        self.results.setdefault("messages", []).append({"title": title, "text": text})

    def table(self, heads: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
        """Record a table of texts whose first column names the rows."""
        self.results.setdefault("tables", []).append([dict(zip(heads, row, strict=True)) for row in rows])

    def figures(self, columns: Mapping[str, Mapping[str, Metric]]) -> None:
        """Record figures by the name of their column and their own name."""
        recorded = self.results.setdefault("figures", {})
        for column, metrics in columns.items():
            recorded.setdefault(column, {}).update(
                {name: metric.model_dump(mode="json") | {"passed": metric.passed} for name, metric in metrics.items()}
            )

    def text(self, exit_code: int, error: str = "") -> str:
        """Return the JSON object that `--json` prints at the end of a command; `error` is the message that ended it."""
        return json.dumps({"exit_code": exit_code} | ({"error": error} if error else {}) | self.results, indent=1)


_session = Session()


def session() -> Session:
    """Return the session of the current command."""
    return _session


def begin(*, quiet: bool, verbose: bool, json: bool) -> Session:
    """Begin the session of a command."""
    global _session
    _session = Session(quiet, verbose, json)
    return _session
