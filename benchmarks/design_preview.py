"""Previews of designs beside the exact ones: `python -m benchmarks.design_preview [--rows N] [--cols N]`.

For typical steps of one parameter, the preview from the design before the step alone, and from the designs before and
at twice the step. Prints the errors of their grid error and efficiencies; of the latter, how far corners of mirrors are
from the exact design's and the largest gap that it misses; and the time of one preview.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from benchmarks.records import Rows, add_json_option, short, write_record
from mirrorcam.optics.design.assess.layout_metrics import evaluate, grid_error
from mirrorcam.optics.design.assess.verify import verify
from mirrorcam.optics.design.optimise import design
from mirrorcam.optics.design.preview import preview
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.layout import Layout

C920 = Camera.c920()
STEPS: tuple[tuple[str, dict[str, Any], dict[str, Any]], ...] = (
    ("scale 90 mm", {"scale_mm": 90.0}, {"scale_mm": 100.0}),
    ("fold 125°", {"fold_deg": 125.0}, {"fold_deg": 130.0}),
    ("nearest depth 350 mm", {"depths_mm": (350.0, 500.0)}, {"depths_mm": (400.0, 500.0)}),
    ("spacing 1.5 mm", {"spacing_mm": 1.5}, {"spacing_mm": 2.0}),
    ("seen gap 1 mm", {"seen_gap_mm": 1.0}, {"seen_gap_mm": 1.5}),
    ("thickness 2 mm", {"thickness_mm": 2.0}, {"thickness_mm": 3.0}),
    ("trade-off 0.4", {"tradeoff": 0.4}, {"tradeoff": 0.5}),
    (
        "focal length + 10 %",
        {"camera": C920.replaced(fx_px=1.1 * C920.fx_px, fy_px=1.1 * C920.fy_px)},
        {"camera": C920.replaced(fx_px=1.2 * C920.fx_px, fy_px=1.2 * C920.fy_px)},
    ),
)
GAPS = ("smallest_gap_mm", "smallest_seen_gap_mm")

designed = cache(design)


@dataclass(frozen=True)
class Errors:
    """A preview's errors: grid error, pixel efficiency at each depth, corners, and the gap that is missed."""

    grid: float
    shares: tuple[float, ...]
    rms_mm: float
    most_mm: float
    missed_mm: float

    def __str__(self) -> str:
        shares = " / ".join(short(each, sign="+") for each in self.shares)
        return f"{short(self.grid, sign='+')}, {shares}"


def errors(found: Layout, exact: Layout, spec: DesignSpec) -> Errors:
    """A preview's errors against the exact design."""
    metrics, truth = evaluate(found, spec.depths_mm), exact.metrics
    names = [f"pixel_efficiency_{depth:g}mm" for depth in spec.depths_mm]
    shares = tuple(metrics[name].value - truth[name].value for name in names)
    corners = [
        np.linalg.norm(a.outline_in_rig_mm - b.outline_in_rig_mm, axis=1)
        for a, b in zip(found.mirrors, exact.mirrors, strict=True)
    ]
    verdict = verify(found, spec)
    missed = max((verdict[name].limit or 0.0) - verdict[name].value for name in GAPS)
    rms = float(np.sqrt(np.mean(np.square(corners))))
    grid = grid_error(found) - grid_error(exact)
    return Errors(grid, shares, rms, float(np.max(corners)), max(missed, 0.0))


def main() -> None:
    """Print a line for each step and each choice of designs."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rows", type=int, default=3)
    parser.add_argument("--cols", type=int, default=3)
    add_json_option(parser)
    arguments = parser.parse_args()
    base = DesignSpec(rows=arguments.rows, cols=arguments.cols)
    nearest = "from the default alone: grid error, efficiency"
    rows = Rows("step", nearest, "between it and twice the step", "corners, rms", "gap missed")
    took_ms, most_mm = [], []
    for name, step, twice in STEPS:
        spec = base.replaced(**step)
        exact, found = designed(spec), []
        for specs in ([base], [base, base.replaced(**twice)]):
            solved = [designed(each) for each in specs]
            started = time.perf_counter()
            shown = preview(spec, solved)
            took_ms.append(1e3 * (time.perf_counter() - started))
            if shown is None:
                raise RuntimeError(f"{name}: no preview from {len(solved)} designs")
            found.append(errors(shown, exact, spec))
        between = found[-1]
        most_mm.append(between.most_mm)
        missed = f"{between.missed_mm:.2f} mm" if between.missed_mm >= 0.005 else "0"
        rows.add(name, *map(str, found), f"{between.rms_mm:.2f} mm", missed)
    least_ms, largest_ms = min(took_ms), max(took_ms)
    print(f"corners off by {max(most_mm):.2f} mm at most; a preview takes {least_ms:.1f} to {largest_ms:.1f} ms")
    write_record(arguments.json, "design_preview", table=rows.table)
    write_record(arguments.json, "design_preview_choices", {"corner_off_mm": max(most_mm)})
    write_record(arguments.json, "design_preview_time", {"preview_least_ms": least_ms, "preview_most_ms": largest_ms})


if __name__ == "__main__":
    main()
