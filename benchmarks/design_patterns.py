"""Designs of patterns of views beside that of a grid: `python -m benchmarks.design_patterns`.

With `--picture FILE`, also the figure of the guide: three of them beside each other. With `--sets FOLDER`, a set of
each is rendered (fast renderer, sensor c920, a device as built by hand), calibrated blind and compared with its truth.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

from mirrorcam.figures.design_figure import beside_each_other
from mirrorcam.optics.design.optimise import design
from mirrorcam.optics.geometry.arrangement import Pattern
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.render_scenes.sets.render_set import render_set
from mirrorcam.render_scenes.sets.set_request import SetRequest
from mirrorcam.render_scenes.settings import RenderSettings
from mirrorcam.workflow.validation import validate

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


def designs() -> dict[str, Layout]:
    """The design of each with a fold of 90 deg, by name; prints its figures."""
    print(f"{'views':8} {'s':>6} " + " ".join(f"{name.removesuffix('_mm'):>24}" for name in FIGURES))
    found = {}
    for pattern in ASKED:
        begun = time.perf_counter()
        layout = design(DesignSpec(pattern=pattern, fold_deg=90.0))
        spent = time.perf_counter() - begun
        name = layout.arrangement.text
        values = " ".join(f"{layout.metrics[figure].value:24.3f}" for figure in FIGURES)
        print(f"{name:8} {spent:6.2f} {values}", flush=True)
        found[name] = layout
    return found


def blind(layout: Layout, folder: Path) -> None:
    """Render a set, calibrate it blind, and print errors against its truth."""
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
    print(
        f"{layout.arrangement.text:8} " + "  ".join(f"{name} {measured[name].value:.5f}" for name in TRUTHS), flush=True
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition(":")[0])
    parser.add_argument("--picture", type=Path, help="a PNG file for the figure")
    parser.add_argument("--sets", type=Path, help="a folder for rendered sets")
    options = parser.parse_args()
    found = designs()
    if options.picture:
        beside_each_other({name: found[name] for name in PICTURED}, (300.0, 500.0), options.picture, dots_per_inch=60.0)
    if options.sets:
        for name, layout in found.items():
            blind(layout, options.sets / name.replace(" ", ""))


if __name__ == "__main__":
    main()
