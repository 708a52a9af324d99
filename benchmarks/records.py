"""Records of what benchmarks measure: figures and tables, with the command, the machine, the date and the commit.

A benchmark with `--json FILE` adds its record to FILE (`add_json_option`, `write_record`). `python -m
docs.make_measured` writes docs/measured.md from those in docs/measured.json.
"""

from __future__ import annotations

import argparse
import datetime
import json
import os
import platform
import subprocess
import sys
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, Self

from pydantic import Field, model_validator

from mirrorcam.core.disk.files import read_model, write_text
from mirrorcam.core.processes.worker_pool import cores
from mirrorcam.core.values import Value

ROOT = Path(__file__).parents[1]

TIMES, SIGMA = "\N{MULTIPLICATION SIGN}", "\N{GREEK SMALL LETTER SIGMA}"
"""For texts of tables: a linter takes these letters for x and o."""


class Machine(Value):
    """What a benchmark ran on."""

    cpu: str
    cores: int
    memory_gb: float
    system: str
    python: str


class Figure(Value):
    """One measured figure. A name ends in its unit where it has one; figures of `metrics.json` have theirs beside."""

    value: int | float
    unit: str = ""


class Table(Value):
    """A measured table as it is printed: cells are texts, in Markdown."""

    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]

    @model_validator(mode="after")
    def _rectangular(self) -> Self:
        wrong = [row for row in self.rows if len(row) != len(self.columns)]
        if wrong:
            raise ValueError(f"a row of {len(wrong[0])} cells, expected {len(self.columns)}: {wrong[0]}")
        return self

    def markdown(self) -> str:
        """The table in Markdown, a line for each row, without a line break at its end."""
        return "\n".join([_line(self.columns), f"|{'---|' * len(self.columns)}", *map(_line, self.rows)])


def _line(cells: Sequence[str]) -> str:
    return "| " + "".join(f"{cell} | " if cell else "| " for cell in cells).rstrip()


class Record(Value):
    """What one command measured."""

    command: str
    date: datetime.date
    commit: str
    changed: bool = False
    """Whether tracked files other than docs/measured.json differed from the commit."""
    machine: Machine
    values: dict[str, Figure] = Field(default_factory=dict)
    table: Table | None = None


class Records(Value):
    """A file of records by their keys."""

    schema_id: Literal["mirrorcam.measured/1"] = Field(default="mirrorcam.measured/1", alias="schema")
    records: dict[str, Record] = Field(default_factory=dict)

    @classmethod
    def load(cls, path: Path) -> Self:
        """The records of a file; `InputError` where it is none."""
        return read_model(cls, path)

    def with_records(self, records: Mapping[str, Record]) -> Self:
        """These with others, which replace those of the same key; in the order of their keys."""
        return type(self)(records=dict(sorted((self.records | dict(records)).items())))

    def save(self, path: Path) -> None:
        """Write the records, a figure or a row of a table to a line."""
        records = {name: each.model_dump(mode="json", exclude_defaults=True) for name, each in self.records.items()}
        write_text(path, _dumped({"schema": self.schema_id, "records": records}) + "\n")


def _dumped(value: Any, indent: int = 0) -> str:
    """JSON with what holds no more than single values on one line."""
    inside = value.values() if isinstance(value, dict) else value if isinstance(value, list) else ()
    if not any(isinstance(each, dict | list) for each in inside):
        return json.dumps(value, ensure_ascii=False, allow_nan=False)
    pad = " " * (indent + 1)
    if isinstance(value, dict):
        items = [f"{json.dumps(name)}: {_dumped(each, indent + 1)}" for name, each in value.items()]
    else:
        items = [_dumped(each, indent + 1) for each in value]
    opening, closing = "{}" if isinstance(value, dict) else "[]"
    return f"{opening}\n{pad}" + f",\n{pad}".join(items) + f"\n{' ' * indent}{closing}"


def table(columns: Sequence[str], rows: Iterable[Sequence[str]]) -> Table:
    """A table of texts."""
    return Table(columns=tuple(columns), rows=tuple(map(tuple, rows)))


class Rows:
    """A table that is printed row by row, as it is measured."""

    def __init__(self, *columns: str) -> None:
        self._columns, self._rows = columns, list[tuple[str, ...]]()
        print(table(columns, []).markdown(), flush=True)

    def add(self, *cells: str) -> None:
        """Print and keep a row."""
        self._rows.append(cells)
        print(_line(cells), flush=True)

    @property
    def table(self) -> Table:
        """The rows so far."""
        return table(self._columns, self._rows)


def this_machine() -> Machine:
    """The machine of this process."""
    try:
        system = platform.freedesktop_os_release()["PRETTY_NAME"]
    except (OSError, KeyError):
        system = f"{platform.system()} {platform.release()}"
    return Machine(
        cpu=_cpu(),
        cores=cores(),
        memory_gb=round(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 1e9, 1),
        system=system,
        python=platform.python_version(),
    )


def _cpu() -> str:
    info = Path("/proc/cpuinfo")
    lines = info.read_text(encoding="utf-8").splitlines() if info.is_file() else []
    names = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return next(names, platform.processor() or platform.machine())


def _git(*arguments: str) -> str:
    return subprocess.run(["git", *arguments], cwd=ROOT, capture_output=True, text=True, check=True).stdout.strip()


def record_of(command: str, values: Mapping[str, Figure] | None = None, table: Table | None = None) -> Record:
    """A record of what was measured now, on this machine, by the commit that is checked out."""
    return Record(
        command=command,
        date=datetime.datetime.now(datetime.UTC).date(),
        commit=_git("rev-parse", "--short=12", "HEAD"),
        changed=bool(_git("status", "--porcelain", "--untracked-files=no", "--", ".", ":!docs/measured.json")),
        machine=this_machine(),
        values=dict(values or {}),
        table=table,
    )


def add_json_option(parser: argparse.ArgumentParser) -> None:
    """Add `--json FILE`, for `write_record`."""
    parser.add_argument("--json", type=Path, metavar="FILE", help="add what is measured to a file of records")


def write_record(
    path: Path | None,
    key: str,
    values: Mapping[str, Figure | float] | None = None,
    table: Table | None = None,
    *,
    command: str | None = None,
) -> None:
    """Add a record to a file, in place of one of the same key; nothing where `--json` named none.

    Without `command`, it is that of this process, as `python -m benchmarks.NAME ARGUMENTS`, without `--json FILE`.
    """
    if path is None:
        return
    figures = {
        name: each if isinstance(each, Figure) else Figure(value=each, unit=unit_of(name))
        for name, each in (values or {}).items()
    }
    record = record_of(command or this_command(sys.argv), figures, table)
    (Records.load(path) if path.is_file() else Records()).with_records({key: record}).save(path)


def this_command(argv: Sequence[str]) -> str:
    """The command line of a benchmark, as it is typed in the root of the project; of absolute paths the last name."""
    program, *arguments = (Path(each).name if Path(each).is_absolute() else each for each in argv)
    if "--json" in arguments:
        at = arguments.index("--json")
        del arguments[at : at + 2]
    return " ".join([f"python -m benchmarks.{Path(program).stem}", *arguments])


UNITS = {
    "px": "px",
    "mm": "mm",
    "um": "µm",
    "nm": "nm",
    "deg": "°",
    "percent": "%",
    "s": "s",
    "ms": "ms",
    "min": "min",
    "h": "h",
    "hz": "1/s",
    "db": "dB",
    "g": "g",
    "n": "N",
    "mpa": "MPa",
    "mb": "MB",
    "gb": "GB",
    "mib": "MiB",
    "ml": "ml",
    "grey": "grey levels",
    "sigma": "sigma",
    "per_m": "1/m",
    "squares": "squares",
}


def unit_of(name: str) -> str:
    """The unit in which a name ends; none where it has none."""
    return next((unit for end, unit in UNITS.items() if name.endswith(f"_{end}") or name == end), "")
