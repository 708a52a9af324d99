"""A sweep as files: the table of its designs and the figure of their trade-offs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from mirrorcam.core.disk.output_folder import output_folder
from mirrorcam.core.progress import Progress, no_progress
from mirrorcam.designs.design_sweep import Runner, sweep, table_of, write_table
from mirrorcam.designs.sweep_figure import pareto
from mirrorcam.optics.design.spec_grid import Outcome
from mirrorcam.optics.geometry.design_spec import DesignSpec

TableFormat = Literal["csv", "parquet", "json"]
FIGURE = "pareto.png"


@dataclass(frozen=True)
class SweepFiles:
    """Outcomes of the specs of a sweep, in their order, and the files that sum them up."""

    outcomes: tuple[Outcome, ...]
    files: tuple[Path, ...]


def write_sweep(
    specs: Sequence[DesignSpec],
    folder: Path,
    run: Runner,
    *,
    table: TableFormat = "csv",
    force: bool = False,
    progress: Progress = no_progress,
) -> SweepFiles:
    """Design all specs, then write their table and the figure of their trade-offs.

    Parameters
    ----------
    specs
        The specs, in the order of the table.
    folder
        Folder of the sweep; designs that an interrupted sweep has finished in it are kept.
    run
        Runner of the designs.
    table
        Format and suffix of the table, `sweep.csv` by default.
    force
        Whether a table and a figure may be replaced that no sweep wrote, or that were changed since.
    progress
        Called with the numbers of designs done and of all.

    Returns
    -------
    SweepFiles
        Outcomes and files: the table and, where a spec was solved, `pareto.png`.
    """
    with output_folder(folder, "sweep", force=force) as output:
        output.refuse_others(f"sweep.{table}", FIGURE)
        outcomes = sweep(specs, output, run, progress)
        with output.staged(result=f"sweep.{table}") as staged:
            write_table(staged / f"sweep.{table}", table_of(outcomes))
            if any(outcome.status == "solved" for outcome in outcomes):
                pareto(outcomes, staged / FIGURE)
            files = tuple(folder / name for name in (f"sweep.{table}", FIGURE) if (staged / name).exists())
    return SweepFiles(tuple(outcomes), files)
