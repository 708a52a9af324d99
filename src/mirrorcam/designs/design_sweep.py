"""Design sweeps: results stored as each design is finished, and the table of all designs."""

from __future__ import annotations

import csv
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from io import StringIO
from pathlib import Path
from typing import TYPE_CHECKING

from mirrorcam.core.disk.files import atomic, read_record, write_json, write_text
from mirrorcam.core.disk.fingerprint import differing_keys, value_digest
from mirrorcam.core.disk.output_folder import OutputFolder
from mirrorcam.core.disk.program import program_of
from mirrorcam.core.errors import InputError
from mirrorcam.core.names import spreadsheet_text
from mirrorcam.core.processes.worker_pool import Died
from mirrorcam.core.progress import Progress, no_progress
from mirrorcam.core.values import Value
from mirrorcam.optics.design.spec_grid import Cell, Outcome, rows_of, solve
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.layout import Layout

if TYPE_CHECKING:
    import pyarrow

CODE = "mirrorcam.optics.design.spec_grid"
_OUTCOME, _LAYOUT = "outcome.json", "layout.json"

# MUMPS, IPOPT's linear solver, keeps its state in globals: two designs at once in one process crash.
_one_at_a_time = threading.Lock()


@dataclass(frozen=True)
class Answer:
    """A worker's answer: the outcome and, if the spec was solved, the layout as JSON texts.

    `made_with` holds the versions of the worker's code and libraries.
    """

    outcome: str
    layout: str = ""
    made_with: Mapping[str, str] = field(default_factory=lambda: program_of(CODE))


Runner = Callable[[Sequence[DesignSpec]], Iterator[tuple[int, Answer | Died]]]


def answer(spec_json: str) -> Answer:
    """Design one spec, in a worker."""
    with _one_at_a_time:
        outcome, layout = solve(DesignSpec.model_validate_json(spec_json))
    return Answer(file_text(outcome), "" if layout is None else file_text(layout))


def file_text(value: Value) -> str:
    """The content of a value's file."""
    return value.model_dump_json(indent=1, by_alias=True, exclude_none=True) + "\n"


def layout_name(spec: DesignSpec) -> str:
    """Path of a spec's layout in the folder of a sweep."""
    return f"layouts/{_key(spec)}.json"


def finished_designs(folder: Path) -> dict[DesignSpec, Path]:
    """The files of the solved designs in the folder of a sweep; raises InputError if there is none."""
    designs = {}
    for path in sorted((folder / "layouts").glob("*.json")):
        layout = read_record(Layout, path)
        if layout is not None and layout.spec is not None:
            designs[layout.spec] = path
    if not designs:
        raise InputError(f"{folder}: holds no solved design, expected the folder of a `mirrorcam sweep`")
    return designs


def _key(spec: DesignSpec) -> str:
    return value_digest(spec.model_dump(mode="json"))[:16]


def sweep(
    specs: Sequence[DesignSpec], output: OutputFolder, run: Runner, progress: Progress = no_progress
) -> list[Outcome]:
    """Return the outcome of each spec, in order, read from the store of the folder if possible, else computed.

    Every finished design is stored, and its layout written, at once: an interrupted sweep loses none. Raises InputError
    if a layout was changed since a sweep wrote it, unless files may be replaced, and if a worker runs a
    different version of the code or of the libraries that designs depend on.
    """
    outcomes = {number: stored for number, spec in enumerate(specs) if (stored := _finished(spec, output)) is not None}
    missing = [number for number in range(len(specs)) if number not in outcomes]
    progress(len(outcomes), len(specs))
    if missing:
        for index, outcome in run([specs[number] for number in missing]):
            outcomes[missing[index]] = _store(specs[missing[index]], outcome, output)
            progress(len(outcomes), len(specs))
    return [outcomes[number] for number in range(len(specs))]


def _finished(spec: DesignSpec, output: OutputFolder) -> Outcome | None:
    """Read a spec's outcome from the store, and restore a missing layout; None if the store has no outcome."""
    output.grouped(_key(spec)).refuse_others(layout_name(spec))
    stored = output.results.get(f"design-{_key(spec)}", program_of(CODE))
    if stored is None:
        return None
    outcome = Outcome.model_validate_json(stored[_OUTCOME])
    if stored[_LAYOUT] and not (output.path / layout_name(spec)).exists():
        _write_layout(spec, stored[_LAYOUT].decode(), output)
    return outcome


def _store(spec: DesignSpec, answer: Answer | Died, output: OutputFolder) -> Outcome:
    """Store an answer and write its layout; a failure is not stored, so that the next sweep tries again."""
    if isinstance(answer, Died):
        answer = Answer(file_text(Outcome(spec=spec, status="failed", finding=answer.reason)))
    outcome = Outcome.model_validate_json(answer.outcome)
    if differences := differing_keys(answer.made_with, program_of(CODE)):
        raise InputError(f"{differences[0]} of a worker differs from this machine's, expected the same on all workers")
    if outcome.status != "failed":
        contents = {_OUTCOME: answer.outcome.encode(), _LAYOUT: answer.layout.encode()}
        output.results.put(f"design-{_key(spec)}", program_of(CODE), contents)
    _write_layout(spec, answer.layout, output)  # last: the store restores a missing layout
    return outcome


def _write_layout(spec: DesignSpec, layout: str, output: OutputFolder) -> None:
    """Write the layout of a spec, or delete an earlier one if the spec has none."""
    with output.grouped(_key(spec)).staged() as folder:
        if layout:
            write_text(folder / layout_name(spec), layout)


def table_of(outcomes: Sequence[Outcome]) -> list[dict[str, Cell]]:
    """A row for each outcome, with the path of its layout in the folder of the sweep."""
    return [
        row | {"layout": layout_name(outcome.spec) if outcome.status == "solved" else None}
        for outcome, row in zip(outcomes, rows_of(outcomes), strict=True)
    ]


def write_table(path: Path, rows: Sequence[dict[str, Cell]]) -> None:
    """Write rows of equal columns atomically, in the format of the suffix: .csv, .parquet (needs its extra) or .json.

    In CSV, depths share one cell, separated by spaces, and missing values are empty.
    """
    if path.suffix == ".json":
        write_json(path, {"schema": "mirrorcam.sweep-table/1", "designs": list(rows)})
    elif path.suffix == ".parquet":
        from pyarrow import parquet

        with atomic(path) as temporary:
            parquet.write_table(_arrow(rows), temporary)
    else:
        text = StringIO(newline="")
        writer = csv.DictWriter(text, list(rows[0]), lineterminator="\n")
        writer.writeheader()
        for row in rows:
            writer.writerow({name: _cell_text(value) for name, value in row.items()})
        write_text(path, text.getvalue())


def _cell_text(value: Cell) -> Cell:
    if isinstance(value, str):
        return spreadsheet_text(value)
    return " ".join(f"{number:g}" for number in value) if isinstance(value, list) else value


def _arrow(rows: Sequence[dict[str, Cell]]) -> pyarrow.Table:
    """Rows as Arrow columns, typed by their first value; a column without values holds floats."""
    import pyarrow

    types = {
        str: pyarrow.string(),
        int: pyarrow.int64(),
        float: pyarrow.float64(),
        list: pyarrow.list_(pyarrow.float64()),
    }
    fields = []
    for name in rows[0]:
        first = next((row[name] for row in rows if row[name] is not None), 0.0)
        fields.append(pyarrow.field(name, types[type(first)]))
    return pyarrow.Table.from_pylist(list(rows), schema=pyarrow.schema(fields))
