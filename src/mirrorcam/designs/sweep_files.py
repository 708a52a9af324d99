"""A sweep as files: its request, the table of its designs, and the figure of their trade-offs."""

from __future__ import annotations

from collections.abc import Generator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from mirrorcam.core.bounds import LENGTH_MM
from mirrorcam.core.disk.files import LARGEST_TEXT_BYTES, model_from, read_bytes, tables_of
from mirrorcam.core.disk.output_folder import output_folder
from mirrorcam.core.processes.cluster import run_cluster
from mirrorcam.core.processes.worker_pool import Died, run_local
from mirrorcam.core.progress import Progress, no_progress
from mirrorcam.core.values import Value
from mirrorcam.designs.design_files import with_camera
from mirrorcam.designs.design_sweep import Answer, Runner, answer, sweep, table_of, write_table
from mirrorcam.optics.design.spec_grid import Outcome, grid, structure
from mirrorcam.optics.geometry.design_spec import DesignSpec

TableFormat = Literal["csv", "parquet", "json"]
FIGURE = "pareto.png"
VARIED = ("rows", "cols", "pattern", "scale_mm", "depths_mm", "tradeoff")


class SweepRequest(Value):
    """The content of `sweep.toml`: values to combine, and fields that all designs share."""

    counts: tuple[tuple[int, int], ...] = Field(
        default=((2, 2), (3, 3), (3, 5)), description="rows and columns of mirrors"
    )
    depth_sets_mm: tuple[tuple[float, ...], ...] = Field(
        default=((300.0, 500.0),), description="scene depths at which the views of one design overlap"
    )
    scales_mm: tuple[Annotated[float, LENGTH_MM.limits], ...] = Field(
        default=(60.0, 80.0, 120.0), description=f"heights of the central mirror above the pupil, {LENGTH_MM}"
    )
    tradeoffs: tuple[Annotated[float, Field(ge=0, le=1)], ...] = Field(
        default=(0.1, 0.3, 0.5), description="from 0 (usable pixels alone) to 1 (a regular grid of views alone)"
    )
    common: DesignSpec = Field(default_factory=DesignSpec, description="fields of design.toml that all designs share")

    @model_validator(mode="after")
    def _check(self) -> Self:
        varied = next((name for name in VARIED if name in self.common.model_fields_set), None)
        if varied is not None:
            raise ValueError(f"common.{varied}: varied by the sweep, set it only in the sweep's lists")
        self.specs()
        return self

    def specs(self) -> tuple[DesignSpec, ...]:
        """The specs of all designs, in the order of the table."""
        return grid(
            self.common,
            counts=self.counts,
            depth_sets_mm=self.depth_sets_mm,
            scales_mm=self.scales_mm,
            tradeoffs=self.tradeoffs,
        )


def read_sweep(path: Path) -> SweepRequest:
    """Read a TOML or JSON request, with the common camera by name or file; raises a one-line InputError."""
    tables = tables_of(path, read_bytes(path, LARGEST_TEXT_BYTES))
    if isinstance(tables, dict) and isinstance(tables.get("common"), dict):
        tables = tables | {"common": with_camera(path, tables["common"])}
    return model_from(SweepRequest, path, tables)


@dataclass(frozen=True)
class SweepFiles:
    """Outcomes of the specs of a sweep, in order, and the files that summarise them."""

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
        Folder of the sweep; designs finished there by an interrupted sweep are kept.
    run
        Runner of the designs.
    table
        Format and suffix of the table, `sweep.csv` by default.
    force
        Whether to replace a table and a figure that were not written by a sweep, or were changed since.
    progress
        Called with the number of designs done and their total.

    Returns
    -------
    SweepFiles
        Outcomes and files: the table and, if a spec was solved, `pareto.png`.
    """
    with output_folder(folder, "sweep", force=force) as output:
        output.refuse_others(f"sweep.{table}", FIGURE)
        outcomes = sweep(specs, output, run, progress)
        with output.staged(result=f"sweep.{table}") as staged:
            write_table(staged / f"sweep.{table}", table_of(outcomes))
            if any(outcome.status == "solved" for outcome in outcomes):
                from mirrorcam.designs.sweep_figure import pareto

                pareto(outcomes, staged / FIGURE)
            files = tuple(folder / name for name in (f"sweep.{table}", FIGURE) if (staged / name).exists())
    return SweepFiles(tuple(outcomes), files)


def grouped(specs: Sequence[DesignSpec]) -> list[list[int]]:
    """Group the numbers of specs by structure: the problem built for one spec of a group is reused for the next.

    Arrays of many mirrors come first, so that all cores finish at about the same time.
    """
    groups: dict[tuple[int, int, int, int, str, bool], list[int]] = {}
    for number, spec in enumerate(specs):
        groups.setdefault(structure(spec), []).append(number)
    return sorted(groups.values(), key=lambda group: -specs[group[0]].rows * specs[group[0]].cols)


def design_locally(specs: Sequence[DesignSpec], workers: int) -> Generator[tuple[int, Answer | Died], None, None]:
    """Yield index and answer of each spec as processes of this machine finish it."""
    yield from run_local([spec.model_dump_json() for spec in specs], workers, answer, grouped(specs))


def design_on_cluster(specs: Sequence[DesignSpec], address: str) -> Generator[tuple[int, Answer | Died], None, None]:
    """Yield index and answer of each spec as workers of the scheduler at `address` finish it."""
    order = [number for group in grouped(specs) for number in group]
    for index, outcome in run_cluster([specs[number].model_dump_json() for number in order], address, answer):
        yield order[index], outcome
