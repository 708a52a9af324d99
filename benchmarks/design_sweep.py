"""Success of the optimiser on 70 varied specs: `python -m benchmarks.design_sweep [--out FOLDER] [--only 3x5 ..]`.

Counts from 1x2 to 7x7, scales of 40 to 200 mm, one to three depths, gaps of 0 to 3 mm, every tradeoff, four cameras,
both reflecting surfaces and mirrors of four to six sides: each level of each about equally often, in a fixed mixture.
Goes through the code of `mirrorcam sweep`, prints how many were solved, found infeasible (by constraint) or failed with
the times per count, and leaves in FOLDER what a sweep leaves and design_sweep.jsonl: a line per spec as it ends.
"""

from __future__ import annotations

import argparse
import json
import random
import statistics
import time
from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, TypeVar

from benchmarks.records import add_json_option, write_record
from mirrorcam.core.disk.output_folder import output_folder
from mirrorcam.core.processes.worker_pool import Died, cores
from mirrorcam.designs.design_sweep import outcome_of, sweep, table_of, write_table
from mirrorcam.designs.sweep_figure import pareto
from mirrorcam.designs.sweep_files import design_here
from mirrorcam.designs.sweep_work import Answer
from mirrorcam.optics.design.spec_grid import Outcome
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.design_spec import DesignSpec

Level = TypeVar("Level")

PI_HQ = Camera(
    name="Raspberry Pi HQ, 6 mm lens",
    width_px=4056,
    height_px=3040,
    fx_px=6.0 / 1.55e-3,
    fy_px=6.0 / 1.55e-3,
    cx_px=2027.5,
    cy_px=1519.5,
)
WEBCAM = Camera(
    name="640x480 webcam",
    width_px=640,
    height_px=480,
    fx_px=520.0,
    fy_px=520.0,
    cx_px=322.0,
    cy_px=236.0,
    distortion=[-0.12, 0.05, 0.0006, -0.0004, 0.0],
)
SKEWED = Camera(
    name="unequal focal lengths, principal point off centre",
    width_px=1280,
    height_px=720,
    fx_px=905.0,
    fy_px=940.0,
    cx_px=672.0,
    cy_px=331.0,
    distortion=[0.06, -0.1, -0.0008, 0.0005, 0.02],
)
CAMERAS = (Camera.c920(), PI_HQ, WEBCAM, SKEWED)
COUNTS = (
    *((1, 2), (2, 1), (1, 3), (3, 1), (2, 2), (2, 3), (3, 2), (1, 5), (2, 4), (4, 2), (3, 3), (3, 4)),
    *((3, 5), (5, 3), (4, 4), (4, 5), (5, 5), (3, 7), (7, 3), (6, 6), (5, 7), (7, 7)),
)
SPECS_PER_COUNT = 3
DEFAULT_COUNTS = ((3, 3), (4, 4), (5, 5), (7, 7))
SCALES_MM = (40.0, 60.0, 80.0, 80.0, 120.0, 160.0, 200.0)
DEPTHS_PER_SCALE = ((3.75, 6.25), (5.0,), (4.0, 6.0, 12.0), (6.0, 20.0), (4.0,), (3.0, 5.0, 9.0))
SPACINGS_MM = (0.0, 0.3, 0.5, 1.0, 1.0, 2.0, 3.0)
TRADEOFFS = (0.0, 0.1, 0.3, 0.5, 0.7, 0.9, 1.0)
SURFACES = ("first", "first", "second")
SIDES = (4, 4, 5, 6)


def mixed(levels: Sequence[Level], count: int, seed: int) -> list[Level]:
    """`count` levels, each as often as any other (or once more), in an order that the seed alone decides."""
    draw = random.Random(seed)
    repeated = [levels[k % len(levels)] for k in range(count)]
    keys = [draw.random() for _ in repeated]
    return [repeated[k] for k in sorted(range(count), key=keys.__getitem__)]


def specs() -> list[DesignSpec]:
    """The fixed list: the mixture, by mirror count, then some counts with everything else as it is by default.

    Depths of the mixture are multiples of the scale, rounded to 10 mm: an array of any size is asked for alike.
    """
    counts = sorted(COUNTS * SPECS_PER_COUNT, key=lambda count: (count[0] * count[1], count))
    factors = [SCALES_MM, DEPTHS_PER_SCALE, SPACINGS_MM, TRADEOFFS, SURFACES, SIDES, CAMERAS]
    columns = [mixed(tuple(levels), len(counts), seed) for seed, levels in enumerate(factors)]
    mixture = [
        DesignSpec(
            rows=rows,
            cols=cols,
            scale_mm=scale,
            depths_mm=tuple(round(scale * multiple, -1) for multiple in depths),
            spacing_mm=spacing,
            tradeoff=tradeoff,
            surface=surface,
            sides=sides,
            camera=camera,
        )
        for (rows, cols), scale, depths, spacing, tradeoff, surface, sides, camera in zip(counts, *columns, strict=True)
    ]
    return mixture + [DesignSpec(rows=rows, cols=cols) for rows, cols in DEFAULT_COUNTS]


def line_of(number: int, outcome: Outcome, seconds: float) -> dict[str, Any]:
    """The outcome of a spec, as one line of the file."""
    spec = outcome.spec.model_dump(mode="json", exclude={"camera"}) | {"camera": outcome.spec.camera.name}
    found = {"status": outcome.status, "constraint": outcome.constraint, "finding": outcome.finding}
    figures = {name: metric.value for name, metric in outcome.metrics.items()}
    return {"number": number, "seconds": round(seconds, 3)} | found | {"spec": spec, "metrics": figures}


def print_sums(outcomes: Sequence[Outcome], times: dict[tuple[int, int], list[float]]) -> None:
    statuses = Counter(outcome.status for outcome in outcomes)
    print("  ".join(f"{status} {statuses[status]}" for status in ("solved", "infeasible", "failed")))
    bound = Counter(outcome.constraint for outcome in outcomes if outcome.status == "infeasible")
    print("infeasible by constraint: " + (", ".join(f"{name} {n}" for name, n in bound.most_common()) or "none"))
    if feasible := len(outcomes) - statuses["infeasible"]:
        print(f"solved of those not found infeasible: {statuses['solved'] / feasible:.1%}")
    for (rows, cols), each in sorted(times.items(), key=lambda item: (item[0][0] * item[0][1], item[0])):
        print(f"{rows}x{cols}: median {statistics.median(each):6.2f} s  longest {max(each):6.2f} s")


def main(folder: Path, only: Sequence[str], workers: int, record_to: Path | None) -> None:
    listed = specs()
    chosen = [
        spec
        for number, spec in enumerate(listed)
        if not only or f"{spec.rows}x{spec.cols}" in only or str(number) in only
    ]
    times: dict[tuple[int, int], list[float]] = defaultdict(list)

    def noted(missing: Sequence[DesignSpec]) -> Iterator[tuple[int, Answer | Died]]:
        for place, got in design_here(missing, workers):
            spec = missing[place]
            number, outcome = listed.index(spec), outcome_of(spec, got)
            seconds = got.seconds if isinstance(got, Answer) else 0.0
            times[spec.rows, spec.cols].append(seconds)
            with (folder / "design_sweep.jsonl").open("a", encoding="utf-8") as stream:
                stream.write(json.dumps(line_of(number, outcome, seconds)) + "\n")
            found = f"{outcome.constraint} {outcome.finding}".strip()
            print(f"{number:3} {spec.rows}x{spec.cols} {outcome.status:10} {seconds:7.2f} s  {found}", flush=True)
            yield place, got

    started = time.perf_counter()
    with output_folder(folder, "sweep") as output:
        outcomes = sweep(chosen, output, noted)
    print(f"{len(outcomes)} specs, {workers} workers, {time.perf_counter() - started:.1f} s")
    print_sums(outcomes, times)
    write_record(record_to, "design_sweep", {"solved": sum(outcome.status == "solved" for outcome in outcomes)})
    write_table(folder / "sweep.csv", table_of(outcomes))
    if any(outcome.status == "solved" for outcome in outcomes):
        pareto(outcomes, folder / "pareto.png")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, help="a folder to keep, where an interrupted run is continued")
    parser.add_argument("--only", nargs="*", default=[], help="counts (3x5) or numbers of specs")
    parser.add_argument("--workers", type=int, default=min(2, cores()))
    add_json_option(parser)
    arguments = parser.parse_args()
    with TemporaryDirectory() as temporary:
        main(arguments.out or Path(temporary), arguments.only, arguments.workers, arguments.json)
