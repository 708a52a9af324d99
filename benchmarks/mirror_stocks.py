"""Mirrors that shops sell, from design to calibration: `python -m benchmarks.mirror_stocks [STOCK ...]`.

For each stock: the default design, the set that `mirrorcam run` renders of it, with the ghosts of its plates, and the
calibration from these pictures alone, against the truth.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

from benchmarks.mirror_shapes import usable_efficiency
from benchmarks.records import Rows, add_json_option, write_record
from mirrorcam.calibration.validation import validate
from mirrorcam.core.processes.worker_pool import in_two_processes
from mirrorcam.optics.design.optimise import design
from mirrorcam.optics.geometry.mirror_stock import stock_fields
from mirrorcam.render_scenes.sets.render_set import render_set
from mirrorcam.run.pipeline import full_recipe

STOCKS = (
    "first-glass-3",
    "second-glass-2",
    "second-glass-3",
    "second-acrylic-2",
    "second-acrylic-3",
    "first-acrylic-1",
)
SHOWN = {
    "corners": ("corners", "{:.0f}"),
    "normal_error_max_deg": ("worst normal", "{:.4f}°"),
    "distance_error_max_mm": ("worst distance", "{:.4f} mm"),
    "decoded_corner_rms_px": ("decoded corners, RMS", "{:.3f} px"),
    "depth_calibration_sigma_mm": ("sigma of depth by calibration", "{:.3f} mm"),
}


def main() -> None:
    """Print the table, and write its record."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("stocks", nargs="*", default=STOCKS)
    parser.add_argument("--shape", default="rectangles", help="outlines of the mirrors")
    add_json_option(parser)
    arguments = parser.parse_args()
    rows = Rows("stock", "usable efficiency", *(title for title, _ in SHOWN.values()))
    figures: dict[str, float] = {}
    recipe = full_recipe(seed=0)
    for stock in arguments.stocks:
        spec = recipe.spec.replaced(shape=arguments.shape, **stock_fields(stock))
        with in_two_processes(["mirrorcam.optics.design.optimise"]) as calls:
            layout = design(spec, calls=calls)
        with tempfile.TemporaryDirectory() as folder:
            render_set(recipe.set_request(layout), Path(folder) / "set")
            found = validate(Path(folder) / "set")
        values = {name: found.metrics[name].value for name in SHOWN}
        figures |= {f"{stock}_{name}": value for name, value in values.items()}
        usable = figures[f"{stock}_usable_efficiency"] = usable_efficiency(layout)
        rows.add(stock, f"{usable:.3f}", *(text.format(values[name]) for name, (_, text) in SHOWN.items()))
    write_record(arguments.json, "mirror_stocks", figures, rows.table)


if __name__ == "__main__":
    main()
