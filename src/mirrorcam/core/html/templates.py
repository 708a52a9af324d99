"""Render templates of pages; each page is one file that works offline.

Every value is escaped unless it is Markup. Templates extend `base.html` and take tables, pictures and cards from
`kit.html`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup

from mirrorcam.core.figures.figure_labels import LABELS
from mirrorcam.core.figures.figure_texts import fraction_of_limit, label_text, limit_text, sentence_case, value_text
from mirrorcam.core.values import Metric

KIT = Path(__file__).parent


@dataclass(frozen=True)
class PagePicture:
    """A picture: its file, the file that a click opens, its size in px, and its description."""

    path: str
    opens: str
    size_px: tuple[int, int]
    alt: str


@dataclass(frozen=True)
class PageFile:
    """A file that the page links: its path and purpose."""

    path: str
    purpose: str


@dataclass(frozen=True)
class Tile:
    """A figure in large type, and its description."""

    value: str
    text: str


@dataclass(frozen=True)
class Table:
    """A table whose first column names the rows; `style` is a class of the style sheet."""

    heads: Sequence[str]
    rows: Sequence[Sequence[str | Markup]]
    style: str = "plain"


@dataclass(frozen=True)
class FigureRow:
    """Row of a metric; `share` is the used share of its limit, 0 to 1."""

    label: str
    value: str
    limit: str = ""
    share: float = 0.0
    passed: bool = True


@dataclass(frozen=True)
class FigureTable:
    """Metrics with a limit, worst first, and those without one."""

    limited: tuple[FigureRow, ...]
    others: tuple[FigureRow, ...]

    @classmethod
    def of(cls, metrics: Mapping[str, Metric], labels: Mapping[str, str] = LABELS) -> FigureTable:
        """Return the table of metrics by name; `labels` are their labels by name."""
        with_limit = [(name, metric) for name, metric in metrics.items() if metric.limit is not None]
        with_limit.sort(key=lambda item: (item[1].passed, -fraction_of_limit(item[1])))
        others = [(name, metric) for name, metric in metrics.items() if metric.limit is None]
        return cls(
            tuple(figure_row(name, metric, labels) for name, metric in with_limit),
            tuple(figure_row(name, metric, labels) for name, metric in others),
        )

    @property
    def failed(self) -> int:
        """Number of metrics past their limits."""
        return sum(not row.passed for row in self.limited)


def figure_row(name: str, metric: Metric, labels: Mapping[str, str] = LABELS) -> FigureRow:
    """Format label, value and limit of a metric."""
    share = 0.0 if metric.limit is None else min(fraction_of_limit(metric), 1.0)
    label = sentence_case(label_text(name, labels))
    return FigureRow(label, value_text(metric), limit_text(metric), share, metric.passed)


def full_stop(text: str) -> str:
    """Return a text as a sentence with a capital first letter and a full stop."""
    return sentence_case(text) + ("" if text.endswith((".", "!", "?")) else ".")


def render(folder: Path, template: str, **values: object) -> str:
    """Fill in a template of a folder, which may extend and import the kit's templates.

    `file(name)` in a template is the content of a file in the same folder, or in the kit's, verbatim.
    """
    loader = FileSystemLoader([folder, KIT])
    environment = Environment(
        loader=loader,
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters["full_stop"] = full_stop
    environment.globals["file"] = lambda name: Markup(loader.get_source(environment, name)[0])
    return environment.get_template(template).render(**values)
