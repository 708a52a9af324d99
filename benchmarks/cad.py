"""Time to build every file of a device: `python -m benchmarks.cad [LAYOUT ...] [--json F]`.

For each layout, in one run: by all cores into an empty folder (beside the limit set for that number of mirrors),
again over the same folder (all parts taken over), and by one process, where it is noted what the time goes to.
By default the layout of the tests, 3x3, and the default design of 5x5 mirrors.
"""

from __future__ import annotations

import argparse
import functools
import time
from collections import defaultdict
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from unittest.mock import patch

from benchmarks.records import add_json_option, write_record
from mirrorcam.cad import device_files, part_files
from mirrorcam.cad.assembly import catalogue
from mirrorcam.cad.assembly.device_plan import Device
from mirrorcam.cad.build import build_parts
from mirrorcam.cad.plan.part_plan import PartPlan
from mirrorcam.cad.write.slicer import slicer_version
from mirrorcam.core.processes.worker_pool import cores
from mirrorcam.optics.design.optimise import design
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.layout import Layout

DEFAULT_LAYOUT = Path(__file__).parents[1] / "tests" / "data" / "default_layout.json"
LIMITS_S = {9: 40.0, 25: 120.0}
PART_STEPS = ("write_step", "write_stl", "write_3mf", "write_drawing", "check_part")
DEVICE_STEPS = (
    *("write_sheets", "pieces_of", "write_glb", "check_device", "write_assembly", "write_picture", "write_bom"),
    *("write_robot", "write_guide", "write_page"),
)


def seconds(work: Callable[[], object]) -> float:
    started = time.perf_counter()
    work()
    return time.perf_counter() - started


def account(layout: Layout, out: Path) -> tuple[float, dict[str, float]]:
    """Seconds of a build in this process, and of its steps: solids by the names of their parts, the rest as named."""
    spent: dict[str, float] = defaultdict(float)

    def timed(name: str, function: Callable[..., Any]) -> Callable[..., Any]:
        @functools.wraps(function)
        def wrapped(*arguments: Any) -> Any:
            started = time.perf_counter()
            try:
                return function(*arguments)
            finally:
                spent[name] += time.perf_counter() - started

        return wrapped

    def parts_of(device: Device) -> tuple[PartPlan, ...]:
        return tuple(
            replace(part, make=timed(f"solid of {part.name}", part.make)) for part in catalogue.parts_of(device)
        )

    with ExitStack() as stack:
        for module, names in ((part_files, PART_STEPS), (device_files, DEVICE_STEPS)):
            for name in names:
                stack.enter_context(patch.object(module, name, timed(name, getattr(module, name))))
        stack.enter_context(patch.object(device_files, "parts_of", parts_of))
        whole = seconds(lambda: build_parts(layout, out))
    return whole, spent


def measure(layout: Layout, folder: Path) -> dict[str, float]:
    """Build a layout in three ways below a folder, and print the times; seconds by names of ways."""
    kept = folder / "kept"
    first = seconds(lambda: build_parts(layout, folder / "first", results=kept, workers=cores()))
    again = seconds(lambda: build_parts(layout, folder / "again", results=kept, workers=cores()))
    alone, spent = account(layout, folder / "alone")
    limit = LIMITS_S.get(len(layout.mirrors))
    print(f"\n{layout.rows}x{layout.cols} mirrors" + (f" (limit {limit:g} s)" if limit else ""))
    print(f"  all cores       {first:6.1f} s")
    print(f"  nothing changed {again:6.1f} s")
    print(f"  one process     {alone:6.1f} s, of which")
    for step, taken in sorted(spent.items(), key=lambda item: -item[1]):
        print(f"    {step:24} {taken:6.2f} s {taken / alone:5.0%}", flush=True)
    solids_s = sum(taken for step, taken in spent.items() if step.startswith("solid of "))
    return {"first": first, "again": again, "one_process": alone, "solids": solids_s}


def main(layouts: list[Layout]) -> list[dict[str, float]]:
    """Seconds of each layout."""
    print(f"{cores()} cores, slicer: {slicer_version() or 'none'}")
    found = []
    for layout in layouts:
        with TemporaryDirectory() as name:
            found.append(measure(layout, Path(name)))
    return found


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("layouts", type=Path, nargs="*", metavar="LAYOUT")
    add_json_option(parser)
    options = parser.parse_args()
    if options.layouts and options.json:
        parser.error("--json is for the default layouts")
    seconds_by_way = main(
        [Layout.load(path) for path in options.layouts]
        or [Layout.load(DEFAULT_LAYOUT), design(DesignSpec(rows=5, cols=5))]
    )
    if not options.layouts:
        three, five = seconds_by_way
        figures = {"three_s": three["first"], "five_s": five["first"]}
        figures |= {"three_again_s": three["again"], "five_again_s": five["again"]}
        figures |= {"one_process_s": three["one_process"], "solids_s": three["solids"]}
        write_record(options.json, "cad_speed", figures)
