"""Records of benchmarks: figures and tables, with the command, the machine, the date and the commit.

A benchmark with `--json FILE` adds its record to FILE (`add_json_option`, `write_record`). `python -m
docs.make_measured` writes docs/measured.md from the records in docs/measured.json.
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
"""For texts of tables: in literals, a linter confuses these characters with x and o."""


class Machine(Value):
    """The machine of a benchmark."""

    cpu: str
    cores: int
    memory_gb: float
    system: str
    python: str


class Figure(Value):
    """A measured figure. Its name ends in its unit, if any; figures of `metrics.json` state the unit in `unit`."""

    value: int | float
    unit: str = ""


class Table(Value):
    """A measured table as printed: cells are Markdown."""

    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]

    @model_validator(mode="after")
    def _rectangular(self) -> Self:
        wrong = [row for row in self.rows if len(row) != len(self.columns)]
        if wrong:
            raise ValueError(f"a row of {len(wrong[0])} cells, expected {len(self.columns)}: {wrong[0]}")
        return self

    def markdown(self) -> str:
        """Return the table in Markdown, a line for each row, without a final line break."""
        return "\n".join([_line(self.columns), f"|{'---|' * len(self.columns)}", *map(_line, self.rows)])


def _line(cells: Sequence[str]) -> str:
    return "| " + "".join(f"{cell} | " if cell else "| " for cell in cells).rstrip()


class Record(Value):
    """The measurements of one command."""

    command: str
    date: datetime.date
    commit: str
    changed: bool = False
    """Whether tracked files other than docs/measured.json differed from the commit."""
    machine: Machine
    values: dict[str, Figure] = Field(default_factory=dict)
    table: Table | None = None


class Records(Value):
    """A file of records, by key."""

    schema_id: Literal["mirrorcam.measured/1"] = Field(default="mirrorcam.measured/1", alias="schema")
    records: dict[str, Record] = Field(default_factory=dict)

    @classmethod
    def load(cls, path: Path) -> Self:
        """Read the records of a file; raises InputError if it is invalid."""
        return read_model(cls, path)

    def with_records(self, records: Mapping[str, Record]) -> Self:
        """Return these records with others, which replace those with the same keys, sorted by key."""
        return type(self)(records=dict(sorted((self.records | dict(records)).items())))

    def save(self, path: Path) -> None:
        """Write the records, one figure or one row of a table per line."""
        records = {key: record.model_dump(mode="json", exclude_defaults=True) for key, record in self.records.items()}
        write_text(path, _json({"schema": self.schema_id, "records": records}) + "\n")


def _json(value: Any, indent: int = 0) -> str:
    """Return JSON with containers of single values on one line."""
    inside = value.values() if isinstance(value, dict) else value if isinstance(value, list) else ()
    if not any(isinstance(child, dict | list) for child in inside):
        return json.dumps(value, ensure_ascii=False, allow_nan=False)
    pad = " " * (indent + 1)
    if isinstance(value, dict):
        items = [f"{json.dumps(name)}: {_json(child, indent + 1)}" for name, child in value.items()]
    else:
        items = [_json(child, indent + 1) for child in value]
    opening, closing = "{}" if isinstance(value, dict) else "[]"
    return f"{opening}\n{pad}" + f",\n{pad}".join(items) + f"\n{' ' * indent}{closing}"


def table(columns: Sequence[str], rows: Iterable[Sequence[str]]) -> Table:
    """Return a table of texts."""
    return Table(columns=tuple(columns), rows=tuple(map(tuple, rows)))


class Rows:
    """A table printed row by row while it is measured."""

    def __init__(self, *columns: str) -> None:
        self._columns, self._rows = columns, list[tuple[str, ...]]()
        print(table(columns, []).markdown(), flush=True)

    def add(self, *cells: str) -> None:
        """Print and keep a row."""
        self._rows.append(cells)
        print(_line(cells), flush=True)

    @property
    def table(self) -> Table:
        """The table of the rows so far."""
        return table(self._columns, self._rows)


def this_machine() -> Machine:
    """Return the machine of this process."""
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
    """Return a record of a measurement made now, on this machine, with the checked-out commit."""
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
    parser.add_argument("--json", type=Path, metavar="FILE", help="add the measurements to a file of records")


def write_record(
    path: Path | None,
    key: str,
    values: Mapping[str, Figure | float] | None = None,
    table: Table | None = None,
    *,
    command: str | None = None,
) -> None:
    """Add a record to a file, replacing one with the same key; without a path, do nothing.

    By default, `command` is that of this process, as `python -m benchmarks.NAME ARGUMENTS`, without `--json FILE`.
    """
    if path is None:
        return
    figures = {
        name: value if isinstance(value, Figure) else Figure(value=value, unit=unit_of(name))
        for name, value in (values or {}).items()
    }
    record = record_of(command or this_command(sys.argv), figures, table)
    (Records.load(path) if path.is_file() else Records()).with_records({key: record}).save(path)


def this_command(argv: Sequence[str]) -> str:
    """Return the command line of a benchmark in the root of the project, with only the last name of absolute paths."""
    program = Path(argv[0])
    name = program.parent.name if program.stem == "__main__" else program.stem
    arguments = [Path(argument).name if Path(argument).is_absolute() else argument for argument in argv[1:]]
    if "--json" in arguments:
        index = arguments.index("--json")
        del arguments[index : index + 2]
    return " ".join([f"python -m benchmarks.{name}", *arguments])


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
    """Return the unit at the end of a name, or an empty string."""
    return next((unit for end, unit in UNITS.items() if name.endswith(f"_{end}") or name == end), "")
