"""Designs of patterns of views beside that of a grid: `python -m benchmarks.design_patterns [--json FILE]`.

With `--picture FILE`, also the figure of the guide: three of them beside each other. With `--sets FOLDER`, a set of
each is rendered (fast renderer, sensor c920, a device as built by hand), calibrated blind and compared with its truth.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from benchmarks.records import Rows, Table, add_json_option, write_record
from mirrorcam.calibration.validation import validate
from mirrorcam.designs.design_figure import beside_each_other
from mirrorcam.optics.design.optimise import design
from mirrorcam.optics.geometry.arrangement import Pattern
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.render_scenes.sets.render_set import render_set
from mirrorcam.render_scenes.sets.set_request import SetRequest
from mirrorcam.render_scenes.settings import RenderSettings

CROSS = Pattern(name="cross", positions=[[0, -1.5], [-2, 0], [0, 0], [1, 0], [3, 0], [0, 1]])
"""A pattern such as a user gives in a file: few views whose distances are all different."""
ASKED = (None, Pattern.hexagonal(1), Pattern.ring(6), Pattern.ring(8), CROSS, Pattern.hexagonal(2))
PICTURED = ("hex7", "ring8", "hex19")
FIGURES = (
    "grid_error",
    "pixel_efficiency_300mm",
    "pixel_efficiency_500mm",
    "usable_efficiency_300mm",
    "usable_efficiency_500mm",
    "baseline_x_mm",
    "baseline_y_mm",
)
TRUTHS = ("normal_error_max_deg", "held_out_rms_x_px", "held_out_rms_y_px", "decoded_corner_rms_px")


def designs() -> tuple[dict[str, Layout], Table]:
    """The design of each with a fold of 90 deg, by name, and the table of their figures, which it prints."""
    found = {}
    printed = Rows("views", "grid error", "pixel efficiency at 300 / 500 mm", "usable efficiency", "baselines, mm")
    for pattern in ASKED:
        layout = design(DesignSpec(pattern=pattern, fold_deg=90.0))
        name = layout.arrangement.text
        error, *figures = (layout.metrics[figure].value for figure in FIGURES)
        pixel, usable = (f"{near:.3f} / {far:.3f}" for near, far in (figures[:2], figures[2:4]))
        printed.add(name, f"{error:.3f}", pixel, usable, f"{figures[4]:.0f} x {figures[5]:.0f}")
        found[name] = layout
    return found, printed.table


def blind(layout: Layout, folder: Path) -> tuple[str, ...]:
    """Render a set, calibrate it blind, and return its name and errors against its truth."""
    request = SetRequest(
        layout=layout,
        frames=20,
        base_frames=10,
        seed=0,
        settings=RenderSettings(renderer="fast", maps=False),
    )
    if not (folder / "dataset.json").exists():
        render_set(request, folder)
    measured = validate(folder).metrics
    normal_deg, x_px, y_px, decoded_px = (measured[name].value for name in TRUTHS)
    return layout.arrangement.text, f"{normal_deg:.4f}", f"{x_px:.4f} / {y_px:.4f}", f"{decoded_px:.3f}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition(":")[0])
    parser.add_argument("--picture", type=Path, help="a PNG file for the figure")
    parser.add_argument("--sets", type=Path, help="a folder for rendered sets")
    add_json_option(parser)
    options = parser.parse_args()
    found, printed = designs()
    write_record(options.json, "design_patterns", table=printed)
    if options.picture:
        beside_each_other({name: found[name] for name in PICTURED}, (300.0, 500.0), options.picture, dots_per_inch=60.0)
    if options.sets:
        rows = Rows("views", "worst normal, deg", "held-out frames x / y, px", "decoded corners, px")
        for name, layout in found.items():
            rows.add(*blind(layout, options.sets / name.replace(" ", "")))
        write_record(options.json, "design_patterns_sets", table=rows.table)


if __name__ == "__main__":
    main()
