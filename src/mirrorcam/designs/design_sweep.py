"""Design sweeps: results stored as each design is finished, and the table of all designs."""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterator, Sequence
from io import StringIO
from pathlib import Path
from typing import TYPE_CHECKING

from mirrorcam.core.disk.files import atomic, write_json, write_text
from mirrorcam.core.disk.fingerprint import differing, value_digest
from mirrorcam.core.disk.output_folder import OutputFolder
from mirrorcam.core.disk.resumable import intact, read_record
from mirrorcam.core.errors import InputError
from mirrorcam.core.names import spreadsheet_text
from mirrorcam.core.processes.worker_pool import Died
from mirrorcam.core.progress import Progress, no_progress
from mirrorcam.designs.sweep_work import Answer, Record, made_with, record_text
from mirrorcam.optics.design.spec_grid import Cell, Outcome, rows_of
from mirrorcam.optics.geometry.design_spec import DesignSpec

if TYPE_CHECKING:
    import pyarrow

Runner = Callable[[Sequence[DesignSpec]], Iterator[tuple[int, Answer | Died]]]


class Results:
    """Finished designs in a folder: results/KEY.json holds the outcome of a spec, layouts/KEY.json its layout."""

    def __init__(self, output: OutputFolder) -> None:
        self._output = output

    @staticmethod
    def names(spec: DesignSpec) -> tuple[str, str]:
        """Paths in the folder of the record of a spec and of its layout."""
        return f"results/{_key(spec)}.json", f"layouts/{_key(spec)}.json"

    @staticmethod
    def layout_name(spec: DesignSpec) -> str:
        """Path in the folder of the layout of a spec."""
        return Results.names(spec)[1]

    def finished(self, spec: DesignSpec) -> Outcome | None:
        """The outcome of a spec; None where it is missing, a failure, or made by other versions than now.

        Raises InputError, unless files of others may be replaced, where its files are not as they were written.
        """
        self._output.grouped(_key(spec)).refuse_others(*self.names(spec))
        path, layout = (self._output.path / name for name in self.names(spec))
        record = read_record(Record, path)
        if record is None or record.outcome.spec != spec:
            return None
        outcome, files = record.outcome, {layout.name: record.layout_sha256}
        whole = bool(intact(layout.parent, files)) if record.layout_sha256 else not layout.exists()
        current = record.made_with == made_with() and outcome.status != "failed"
        return outcome if whole and current else None

    def keep(self, spec: DesignSpec, got: Answer | Died) -> Outcome:
        """Write the outcome of a spec: its record, and the layout whose checksum is in it.

        Raises InputError where a worker runs another version of the sources or distributions that designs depend on.
        """
        if isinstance(got, Died):
            got = Answer(record_text(outcome_of(spec, got)))
        record = Record.model_validate_json(got.record)
        other = differing(record.made_with, made_with())
        if other:
            raise InputError(
                f"{other[0]} of a worker is not what this sweep began with, expected the same in all of them"
            )
        name, layout = self.names(spec)
        with self._output.grouped(_key(spec)).staged() as folder:
            write_text(folder / name, got.record)
            if got.layout:
                write_text(folder / layout, got.layout)
        return record.outcome


def finished_designs(folder: Path) -> list[tuple[Outcome, Path]]:
    """The solved designs in the folder of a sweep, each with its layout's file; raises InputError where none is."""
    found = []
    for path in sorted((folder / "results").glob("*.json")):
        record = read_record(Record, path)
        layout = folder / "layouts" / path.name
        if record is not None and record.outcome.status == "solved" and layout.is_file():
            found.append((record.outcome, layout))
    if not found:
        raise InputError(f"{folder}: holds no solved design, expected the folder of a `mirrorcam sweep`")
    return found


def outcome_of(spec: DesignSpec, got: Answer | Died) -> Outcome:
    """The outcome of a spec, from the answer of a worker or the death of all that tried it."""
    if isinstance(got, Died):
        return Outcome(spec=spec, status="failed", finding=got.reason)
    return Record.model_validate_json(got.record).outcome


def _key(spec: DesignSpec) -> str:
    return value_digest(spec.model_dump(mode="json"))[:16]


def sweep(
    specs: Sequence[DesignSpec], output: OutputFolder, run: Runner, progress: Progress = no_progress
) -> list[Outcome]:
    """Return the outcome of each spec, in their order: those in the folder are read, the others run.

    Every design is stored as soon as it is finished, so that an interrupted sweep loses none.
    """
    results = Results(output)
    outcomes = {number: found for number, spec in enumerate(specs) if (found := results.finished(spec)) is not None}
    missing = [number for number in range(len(specs)) if number not in outcomes]
    progress(len(outcomes), len(specs))
    if missing:
        for place, got in run([specs[number] for number in missing]):
            outcomes[missing[place]] = results.keep(specs[missing[place]], got)
            progress(len(outcomes), len(specs))
    return [outcomes[number] for number in range(len(specs))]


def table_of(outcomes: Sequence[Outcome]) -> list[dict[str, Cell]]:
    """A row for each outcome, with the place of its layout in the folder of the sweep."""
    return [
        row | {"layout": Results.layout_name(outcome.spec) if outcome.status == "solved" else None}
        for outcome, row in zip(outcomes, rows_of(outcomes), strict=True)
    ]


def write_table(path: Path, rows: Sequence[dict[str, Cell]]) -> None:
    """Write rows of the same columns atomically, as the suffix says: .csv, .parquet (needs its extra) or .json.

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
    """Rows as Arrow columns, of the type of their first value; a column without values is of floats."""
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
