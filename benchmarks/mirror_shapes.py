"""Usable efficiency of rectangles against free quadrilaterals: `python -m benchmarks.mirror_shapes [--counts N ...]`.

For 2x2 to 5x5 mirrors of the default design, at its fold and at each shape's best fold: free outlines, rectangles cut
in steps of 1 mm, the best single size of a list, and the best size of the list for each mirror. The efficiency is the
mean over the depths; percentages are of the free outlines in the same row.
"""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np

from benchmarks.records import TIMES, Rows, add_json_option, write_record
from mirrorcam.core.processes.worker_pool import in_two_processes
from mirrorcam.optics.design.optimise import design
from mirrorcam.optics.geometry.design_spec import DesignSpec, InfeasibleDesign
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror_gaps import edges_mm

COUNTS = (2, 3, 4, 5)
STOCK = "stock:15x10,20x10,20x15,25x15,25x20,30x20,35x25,40x20,40x30,50x30,60x40"
SHAPES: dict[str, dict[str, Any]] = {
    "cut": {"shape": "rectangles"},
    "one_size": {"shape": STOCK, "same_size": True},
    "list": {"shape": STOCK},
}


def usable_efficiency(layout: Layout) -> float:
    """Return the usable efficiency, averaged over the depths."""
    values = [metric.value for name, metric in layout.metrics.items() if name.startswith("usable_efficiency")]
    return float(np.mean(values))


def fold_text(layout: Layout) -> str:
    """Return the fold of a design."""
    if layout.spec is None:
        raise ValueError("the layout has no spec, expected a design")
    return f"{layout.spec.fold_deg:g}°"


def size_text(layout: Layout) -> str:
    """Return the size of all mirrors of one size, mm."""
    longer, shorter = sorted(edges_mm(layout.mirrors[0])[:2], reverse=True)
    return f"{longer:.0f} {TIMES} {shorter:.0f}"


def main() -> None:
    """Print the table, and write its record."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--counts", type=int, nargs="+", default=COUNTS, help="rows and columns; 5 takes an hour")
    add_json_option(parser)
    arguments = parser.parse_args()
    rows = Rows("mirrors", "free", "cut in 1 mm steps", "one size of the list", "each of the list")
    figures: dict[str, float] = {}
    with in_two_processes(["mirrorcam.optics.design.optimise"]) as calls:
        for count in arguments.counts:
            for fold_deg in (120.0, "auto"):
                spec = DesignSpec(rows=count, cols=count, fold_deg=fold_deg, shape="free")
                free = design(spec, calls=calls)
                cells, of_free = [f"{usable_efficiency(free):.3f} ({fold_text(free)})"], usable_efficiency(free)
                for name, fields in SHAPES.items():
                    try:
                        layout = design(spec.replaced(**fields), calls=calls)
                    except InfeasibleDesign as error:
                        print(f"{count}x{count} {fold_deg} {name}: {error}", flush=True)
                        cells.append("-")
                        continue
                    share = 100.0 * usable_efficiency(layout) / of_free
                    figures[f"{count}x{count}_{fold_deg}_{name}_percent"] = share
                    size = f", {size_text(layout)}" if name == "one_size" else ""
                    cells.append(f"{share:.0f} % ({fold_text(layout)}{size})")
                fold = "default fold" if fold_deg == 120.0 else "best fold"
                rows.add(f"{count} {TIMES} {count}, {fold}", *cells)
    write_record(arguments.json, "mirror_shapes", figures, rows.table)


if __name__ == "__main__":
    main()
