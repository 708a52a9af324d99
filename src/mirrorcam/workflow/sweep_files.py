"""A sweep as files: the table of its designs and the figure of their trade-offs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from mirrorcam.figures.sweep_figure import pareto
from mirrorcam.optics.base.progress import Progress, no_progress
from mirrorcam.optics.design.spec_grid import Outcome
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.workflow.design_sweep import Runner, sweep, table_of, write_table

TableFormat = Literal["csv", "parquet", "json"]


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
    progress
        Called with the numbers of designs done and of all.

    Returns
    -------
    SweepFiles
        Outcomes and files: the table and, where a spec was solved, `pareto.png`.
    """
    outcomes = sweep(specs, folder, run, progress)
    path, figure = folder / f"sweep.{table}", folder / "pareto.png"
    write_table(path, table_of(outcomes))
    if not any(outcome.status == "solved" for outcome in outcomes):
        figure.unlink(missing_ok=True)  # of an earlier sweep
        return SweepFiles(tuple(outcomes), (path,))
    pareto(outcomes, figure)
    return SweepFiles(tuple(outcomes), (path, figure))
