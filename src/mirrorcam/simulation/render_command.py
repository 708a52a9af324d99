"""`mirrorcam render`: a synthetic calibration set with ground truth, and the check of a set by its checksums."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import App, Parameter

from mirrorcam.core.console.options import Scheduler, Workers, check_executor
from mirrorcam.core.console.progress import long_work, say
from mirrorcam.core.extras import require
from mirrorcam.core.figures.figure_texts import count_text
from mirrorcam.simulation.render_request import RenderRequest

if TYPE_CHECKING:
    from mirrorcam.render_scenes.sets.dataset import Dataset

app = App(name="render")


@app.default
def render(
    layout: Annotated[Path, Parameter(name="LAYOUT", help="nominal layout.json")],
    /,
    *,
    request: RenderRequest = RenderRequest(),
    workers: Workers = None,
    scheduler: Scheduler = None,
    out: Annotated[Path, Parameter(help="folder for the set; an interrupted one is resumed")] = Path("output/set"),
) -> int:
    """Render frames of a calibration board, with ground truth.

    The frames show a device built with tolerances. Writes frames/, base/, layout.json, board.toml and
    dataset.json, and the ground truth in truth/, for mirrorcam validate only.

    Examples:
        mirrorcam render layout.json --out set
        mirrorcam render layout.json --renderer fast --sensor poor --as-built tilt_deg=0.5 --seed 7
        mirrorcam render verify set
    """
    check_executor(workers, scheduler)
    from mirrorcam.optics.geometry.layout import Layout

    nominal = Layout.load(layout)
    requested = request.read(nominal)
    require("render")
    from mirrorcam.core.disk.output_folder import output_folder
    from mirrorcam.core.processes.worker_pool import cores
    from mirrorcam.render_scenes.sets.dataset import MANIFEST
    from mirrorcam.render_scenes.sets.render_set import render_set
    from mirrorcam.simulation.rendering import in_workers, on_cluster

    count = workers or cores()
    run = in_workers(count) if scheduler is None else on_cluster(scheduler)
    workers_text = count_text(count, "worker") if scheduler is None else f"the workers of {scheduler}"
    with (
        output_folder(out, "render"),
        long_work("render", f"{requested.settings.renderer}, {workers_text}", "frames") as advance,
    ):
        dataset = render_set(requested, out, run=run, progress=advance)
    say("coverage", coverage_text(dataset, nominal.cols))
    say("coverage", depth_range_text(dataset, nominal.mirror_names))
    say("render", f"{out / MANIFEST} written; {out / 'truth'} is for mirrorcam validate only")
    return 0


@app.command
def verify(
    rendered: Annotated[Path, Parameter(name="SET", help="folder of a set that mirrorcam render wrote")], /
) -> int:
    """Compare the files of a set with their checksums.

    Exit code 1: a file is missing or altered.

    Examples:
        mirrorcam render verify output/set
    """
    from mirrorcam.simulation.rendering import check_set

    check = check_set(rendered)
    for state, names in (("altered", check.altered), ("missing", check.missing)):
        for name in names:
            say("verify", f"{rendered / name} is {state}")
    if check.unfinished:
        say("verify", f"{count_text(len(check.unfinished), 'file')} not rendered yet, {check.unfinished[0]} first")
    if check.passed:
        say("verify", f"{count_text(check.files, 'file')} as rendered")
    return 0 if check.passed else 1


def coverage_text(dataset: Dataset, cols: int) -> str:
    """State the percentage of each sub-image, row by row, and of the base frames, that corners cover."""
    percent = [f"{100.0 * fraction:.0f}" for fraction in dataset.coverage]
    rows = [" ".join(percent[begin : begin + cols]) for begin in range(0, len(percent), cols)]
    mirrors = f"corners cover {' / '.join(rows)} % of the sub-images"
    return f"{mirrors}, {100.0 * dataset.base_coverage:.0f} % of base frames" if dataset.base_frames else mirrors


def depth_range_text(dataset: Dataset, mirrors: Sequence[str]) -> str:
    """State the distances and tilts of the boards visible in every mirror."""
    ranges = dataset.reaches
    blind = [name for name, depths in zip(mirrors, ranges, strict=True) if depths.farthest_mm == 0]
    if blind:
        return f"mirror {', '.join(blind)} shows too few corners in every frame"
    nearest, farthest = max(depths.nearest_mm for depths in ranges), min(depths.farthest_mm for depths in ranges)
    tilt = min(depths.tilt_deg for depths in ranges)
    return f"every mirror shows boards from {nearest} to {farthest} mm away and tilted by up to {tilt}°"
