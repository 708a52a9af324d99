"""`mirrorcam sweep`: designs for a grid of specs, with a table and a figure of their trade-offs."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter

from mirrorcam.core.console.options import Force, Scheduler, Workers, check_executor
from mirrorcam.core.console.progress import long_work, say
from mirrorcam.core.extras import require

if TYPE_CHECKING:
    from mirrorcam.optics.design.spec_grid import Outcome


def sweep(
    request: Annotated[
        Path | None,
        Parameter(name="SWEEP", help="sweep.toml with the values to combine (docs/design.md) [default: 27 designs]"),
    ] = None,
    /,
    *,
    table: Annotated[Literal["csv", "parquet", "json"], Parameter(help="format of the table")] = "csv",
    workers: Workers = None,
    scheduler: Scheduler = None,
    out: Annotated[Path, Parameter(help="output folder, in which an interrupted sweep is resumed")] = Path(
        "output/sweep"
    ),
    force: Force = False,
) -> int:
    """Optimise layouts for all combinations of counts, depths, scales and trade-offs.

    Writes the table sweep.csv, pareto.png (trade-offs) and, for each solved design, layouts/NAME.json. Exit
    code 1: a design failed, or none was solved.

    Examples:
        mirrorcam sweep
        mirrorcam sweep sweep.toml --table parquet --out output/counts
    """
    check_executor(workers, scheduler)
    if table == "parquet":
        require("parquet")
    if scheduler is not None:
        require("cluster")
    from mirrorcam.core.figures.figure_texts import count_text
    from mirrorcam.core.processes.worker_pool import cores
    from mirrorcam.designs.sweep_files import SweepRequest, design_locally, design_on_cluster, read_sweep, write_sweep
    from mirrorcam.optics.geometry.sub_images import sensor_polygon

    specs = (SweepRequest() if request is None else read_sweep(request)).specs()
    sensor_polygon(specs[0].camera)  # refuses a lens whose distortion is not monotonic on the sensor, before any work
    if scheduler is not None:
        runner, executor = partial(design_on_cluster, address=scheduler), f"the workers of {scheduler}"
    else:
        count = workers or cores()
        runner, executor = partial(design_locally, workers=count), count_text(count, "worker")
    with long_work("sweep", f"{count_text(len(specs), 'design')}, {executor}", "designs") as advance:
        swept = write_sweep(specs, out, runner, table=table, force=force, progress=advance)
    for line in summary(swept.outcomes):
        say("sweep", line)
    say("sweep", f"{' and '.join(str(path) for path in swept.files)} written")
    statuses = {outcome.status for outcome in swept.outcomes}
    return 1 if "failed" in statuses or "solved" not in statuses else 0


def summary(outcomes: Sequence[Outcome]) -> list[str]:
    """Summarise outcomes in lines of text: counts of each status, violated constraints, failures."""
    statuses = Counter(outcome.status for outcome in outcomes)
    lines = [", ".join(f"{statuses[status]} {status}" for status in ("solved", "infeasible", "failed"))]
    violated = Counter(outcome.constraint for outcome in outcomes if outcome.status == "infeasible")
    if violated:
        lines.append("infeasible for " + ", ".join(f"{constraint} ({n})" for constraint, n in violated.most_common()))
    for outcome in outcomes:
        if outcome.status == "failed":
            spec = outcome.spec
            depths = ",".join(f"{depth:g}" for depth in spec.depths_mm)
            name = f"{spec.rows}x{spec.cols} scale {spec.scale_mm:g} depths {depths} tradeoff {spec.tradeoff:g}"
            lines.append(f"{name} failed: {outcome.finding}")
    return lines
