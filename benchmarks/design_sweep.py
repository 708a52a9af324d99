"""How many of 70 varied specs the optimiser solves: `python benchmarks/design_sweep.py [--out FILE] [--only 3x5 ...]`.

Counts from 1x2 to 7x7, scales of 40 to 200 mm, one to three depths, gaps of 0 to 3 mm, every tradeoff, four cameras,
both reflecting surfaces and mirrors of four to six sides: each level of each about equally often, in a fixed mixture.
Writes one JSON line per spec as it ends (spec, status, constraint, finding, metrics, seconds) and prints how many were
solved, found infeasible (by constraint) or failed, with the times per count.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import random
import statistics
import time
from collections import Counter, defaultdict
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Any, TypeVar

from optics.camera import Camera
from optics.spec import DesignSpec

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


def solved(number: int, spec: DesignSpec) -> dict[str, Any]:
    """One line of the result: what became of a spec, and how long it took."""
    from optics.design.errors import InfeasibleDesign
    from optics.design.optimise import design

    line: dict[str, Any] = {"number": number, "status": "solved", "constraint": "", "finding": ""}
    started = time.perf_counter()
    try:
        metrics = design(spec).metrics
        line["metrics"] = {name: metric.value for name, metric in metrics.items()}
    except InfeasibleDesign as refusal:
        line |= {"status": "infeasible", "constraint": refusal.constraint, "finding": refusal.finding}
    except Exception as error:
        line |= {"status": "failed", "finding": f"{type(error).__name__}: {error}"}
    line["seconds"] = round(time.perf_counter() - started, 2)
    line["spec"] = spec.model_dump(mode="json", exclude={"camera"}) | {"camera": spec.camera.name}
    return line


def main(out: Path, only: Sequence[str], workers: int) -> None:
    chosen = [
        (number, spec)
        for number, spec in enumerate(specs())
        if not only or f"{spec.rows}x{spec.cols}" in only or str(number) in only
    ]
    for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ[variable] = "1"
    lines = []
    context = multiprocessing.get_context("spawn")
    with out.open("w", encoding="utf-8") as stream, ProcessPoolExecutor(workers, mp_context=context) as pool:
        for future in as_completed([pool.submit(solved, number, spec) for number, spec in chosen]):
            line = future.result()
            lines.append(line)
            stream.write(json.dumps(line) + "\n")
            stream.flush()
            spec = line["spec"]
            found = f"{line['constraint']} {line['finding']}".strip()
            count = f"{spec['rows']}x{spec['cols']}"
            print(f"{line['number']:3} {count} {line['status']:10} {line['seconds']:7.2f} s  {found}", flush=True)
    statuses = Counter(line["status"] for line in lines)
    print("  ".join(f"{status} {statuses[status]}" for status in ("solved", "infeasible", "failed")))
    constraints = Counter(line["constraint"] for line in lines if line["constraint"])
    print("infeasible by constraint: " + (", ".join(f"{c} {n}" for c, n in constraints.most_common()) or "none"))
    times = defaultdict(list)
    for line in lines:
        times[line["spec"]["rows"], line["spec"]["cols"]].append(line["seconds"])
    for (rows, cols), each in sorted(times.items(), key=lambda item: (item[0][0] * item[0][1], item[0])):
        print(f"{rows}x{cols}: median {statistics.median(each):6.2f} s  longest {max(each):6.2f} s")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("design_sweep.jsonl"), help="a JSON line per spec")
    parser.add_argument("--only", nargs="*", default=[], help="counts (3x5) or numbers of specs")
    parser.add_argument("--workers", type=int, default=min(2, os.cpu_count() or 1))
    arguments = parser.parse_args()
    main(arguments.out, arguments.only, arguments.workers)
