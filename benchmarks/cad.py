"""Time to build every file of a device: `python -m benchmarks.cad [LAYOUT ...]`.

For each layout, in one run: by all cores into an empty folder (beside the limit set for that number of mirrors),
again over the same folder (all parts taken over), and by one process, where it is noted what the time goes to.
By default the layout of the tests, 3x3, and the default design of 5x5 mirrors.
"""

from __future__ import annotations

import functools
import sys
import time
from collections import defaultdict
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from unittest.mock import patch

from mirrorcam.cad import device_files, part_files
from mirrorcam.cad.assembly import catalogue
from mirrorcam.cad.assembly.device_plan import Device
from mirrorcam.cad.build import build_parts
from mirrorcam.cad.plan.part_plan import PartPlan
from mirrorcam.cad.write.slicer import slicer_version
from mirrorcam.optics.base.worker_pool import cores
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


def measure(layout: Layout, folder: Path) -> None:
    """Build a layout in three ways below a folder, and print the times."""
    first = seconds(lambda: build_parts(layout, folder / "first", workers=cores()))
    again = seconds(lambda: build_parts(layout, folder / "again", previous=folder / "first", workers=cores()))
    alone, spent = account(layout, folder / "alone")
    limit = LIMITS_S.get(len(layout.mirrors))
    print(f"\n{layout.rows}x{layout.cols} mirrors" + (f" (limit {limit:g} s)" if limit else ""))
    print(f"  all cores       {first:6.1f} s")
    print(f"  nothing changed {again:6.1f} s")
    print(f"  one process     {alone:6.1f} s, of which")
    for step, taken in sorted(spent.items(), key=lambda item: -item[1]):
        print(f"    {step:24} {taken:6.2f} s {taken / alone:5.0%}", flush=True)


def main(layouts: list[Layout]) -> None:
    print(f"{cores()} cores, slicer: {slicer_version() or 'none'}")
    for layout in layouts:
        with TemporaryDirectory() as name:
            measure(layout, Path(name))


if __name__ == "__main__":
    main(
        [Layout.load(Path(path)) for path in sys.argv[1:]]
        or [Layout.load(DEFAULT_LAYOUT), design(DesignSpec(rows=5, cols=5))]
    )
