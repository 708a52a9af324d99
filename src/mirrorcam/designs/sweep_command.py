"""`mirrorcam sweep`: designs for a grid of specs, with a table and a figure of their trade-offs."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, Self

import tyro
from pydantic import Field, model_validator

from mirrorcam.core.bounds import LENGTH_MM, WORKERS
from mirrorcam.core.console.option_texts import FORCE
from mirrorcam.core.console.progress import long_work, say
from mirrorcam.core.extras import require
from mirrorcam.core.figures.figure_texts import count_text
from mirrorcam.core.values import InputError, Value
from mirrorcam.optics.design.spec_grid import grid
from mirrorcam.optics.geometry.arrangement import Pattern
from mirrorcam.optics.geometry.design_spec import DesignSpec

if TYPE_CHECKING:
    from mirrorcam.designs.design_sweep import Runner
    from mirrorcam.optics.design.spec_grid import Outcome


def count_from_text(text: str) -> tuple[int, int]:
    """Parse rows and columns from a text like 3x5."""
    found = re.fullmatch(r"(\d+)x(\d+)", text)
    if found is None:
        raise InputError(f"--counts {text!r}: expected rows x columns, like 3x5")
    return int(found[1]), int(found[2])


def depths_from_text(text: str) -> tuple[float, ...]:
    """Parse depths from a text like 300,500."""
    try:
        return tuple(float(part) for part in text.split(","))
    except ValueError:
        raise InputError(f"--depth-sets-mm {text!r}: expected depths with commas between them, like 300,500") from None


class CommonSpec(DesignSpec):
    """The part of a spec that all designs of a sweep share."""

    rows: tyro.conf.Suppress[int] = 3
    cols: tyro.conf.Suppress[int] = 3
    pattern: tyro.conf.Suppress[Pattern | None] = Field(default=None, exclude_if=lambda pattern: pattern is None)
    scale_mm: tyro.conf.Suppress[float] = 80.0
    depths_mm: tyro.conf.Suppress[tuple[float, ...]] = (300.0, 500.0)
    tradeoff: tyro.conf.Suppress[float] = 0.3


class SweepOptions(Value):
    """Optimise layouts for all combinations of counts, depths, scales and trade-offs, and show the Pareto fronts."""

    counts: Annotated[tuple[str, ...], tyro.conf.arg(metavar="[ROWSxCOLS ...]")] = Field(
        default=("2x2", "3x3", "3x5"), description="rows x columns of mirrors"
    )
    scales_mm: tuple[Annotated[float, LENGTH_MM.each], ...] = Field(
        default=(60.0, 80.0, 120.0), description=f"heights of the central mirror above the pupil, {LENGTH_MM}"
    )
    tradeoffs: tuple[Annotated[float, Field(ge=0, le=1)], ...] = Field(
        default=(0.1, 0.3, 0.5), description="from 0 (pixel efficiency alone) to 1 (a perfect grid of views alone)"
    )
    depth_sets_mm: Annotated[tuple[str, ...], tyro.conf.arg(metavar="[MM,MM... ...]")] = Field(
        default=("300,500",),
        description="scene depths at which views overlap; commas separate the depths of one design",
    )
    common: Annotated[CommonSpec, tyro.conf.OmitArgPrefixes] = Field(default_factory=CommonSpec)
    table: Literal["csv", "parquet", "json"] = Field(default="csv", description="format of the table")
    workers: Annotated[int | None, tyro.conf.arg(metavar="INT", help_behavior_hint="(all cores)")] = WORKERS.field(
        None, "number of designs solved at the same time on this machine"
    )
    scheduler: Annotated[str | None, tyro.conf.arg(metavar="ADDRESS", help_behavior_hint="")] = Field(
        default=None, description="Dask scheduler whose workers solve them instead, such as tcp://host:8786"
    )
    out: Path = Field(
        default=Path("output/sweep"),
        description="folder for the table, pareto.png and layouts/; an interrupted sweep is resumed",
    )
    force: bool = FORCE

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.workers is not None and self.scheduler is not None:
            raise ValueError("--workers and --scheduler: expected one of the two")
        self.specs()
        return self

    def specs(self) -> tuple[DesignSpec, ...]:
        """The specs of all designs, in the order of the table."""
        return grid(
            self.common,
            counts=[count_from_text(text) for text in self.counts],
            depth_sets_mm=[depths_from_text(text) for text in self.depth_sets_mm],
            scales_mm=self.scales_mm,
            tradeoffs=self.tradeoffs,
        )


def _runner(options: SweepOptions) -> tuple[Runner, str]:
    """The runner of the designs, and its description for the progress line."""
    from mirrorcam.core.processes.worker_pool import cores
    from mirrorcam.designs.sweep_run import design_here, design_on_cluster

    if options.scheduler is not None:
        return partial(design_on_cluster, address=options.scheduler), f"the workers of {options.scheduler}"
    workers = options.workers or cores()
    return partial(design_here, workers=workers), count_text(workers, "worker")


def summary(outcomes: Sequence[Outcome]) -> list[str]:
    """Summarise outcomes in lines of text: counts of each status, the constraints that cannot hold, the failures."""
    statuses = Counter(outcome.status for outcome in outcomes)
    lines = [", ".join(f"{statuses[status]} {status}" for status in ("solved", "infeasible", "failed"))]
    bound = Counter(outcome.constraint for outcome in outcomes if outcome.status == "infeasible")
    if bound:
        lines.append("infeasible for " + ", ".join(f"{constraint} ({n})" for constraint, n in bound.most_common()))
    for outcome in outcomes:
        if outcome.status == "failed":
            spec = outcome.spec
            depths = ",".join(f"{depth:g}" for depth in spec.depths_mm)
            name = f"{spec.rows}x{spec.cols} scale {spec.scale_mm:g} depths {depths} tradeoff {spec.tradeoff:g}"
            lines.append(f"{name} failed: {outcome.finding}")
    return lines


def run(options: SweepOptions) -> int:
    """Sweep, write the table and the figures, and sum up; 1 where a design failed, or none was solved."""
    if options.table == "parquet":
        require("parquet")
    if options.scheduler is not None:
        require("cluster")
    from mirrorcam.designs.sweep_files import write_sweep
    from mirrorcam.optics.geometry.sub_images import sensor_polygon

    sensor_polygon(options.common.camera)  # refuses a lens that folds inside the sensor, before any work
    specs = options.specs()
    runner, who = _runner(options)
    with long_work("sweep", f"{count_text(len(specs), 'design')}, {who}", "designs") as advance:
        swept = write_sweep(specs, options.out, runner, table=options.table, force=options.force, progress=advance)
    for line in summary(swept.outcomes):
        say("sweep", line)
    say("sweep", f"{' and '.join(str(path) for path in swept.files)} written")
    statuses = {outcome.status for outcome in swept.outcomes}
    return 1 if "failed" in statuses or "solved" not in statuses else 0
