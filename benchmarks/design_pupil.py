"""What the pupil of a lens costs a design, and what scale buys: `python -m benchmarks.design_pupil [--picture FILE]`.

3x3, C920, depths 300 and 500 mm. Fronts of usable efficiency against grid error at scales of 60, 80 and 120 mm, of
layouts optimised for a pinhole and for the whole pupil, both judged with the whole pupil; then usable efficiency over
the scale for lenses of other apertures and focus. `--fold-deg` is that of all designs, auto by default.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from benchmarks.records import Rows, add_json_option, short, write_record
from mirrorcam.core.disk.files import atomic
from mirrorcam.core.processes.worker_pool import call_all
from mirrorcam.optics.design.assess.layout_metrics import grid_error
from mirrorcam.optics.design.optimise import design
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.pupil import PINHOLE
from mirrorcam.optics.geometry.sub_images import fields_of_view

SCALES_MM = (60.0, 80.0, 120.0)
TRADEOFFS = (0.1, 0.3, 0.6, 0.9)
LENSES = {
    "f/4": (0.9, 500.0),
    "f/2": (1.8, 500.0),
    "f/1": (3.6, 500.0),
    "f/2, in focus at 250 mm": (1.8, 250.0),
    "f/2, in focus far away": (1.8, 1e6),
}
"""Apertures, as f-numbers of a C920's focal length, and focus, mm."""
BUILT_MM = (40.0, 50.0, 60.0, 80.0, 100.0, 120.0, 150.0)
COLOURS = ("#0077bb", "#000000", "#cc3311", "#ee7733", "#009988")

OF_TABLE, TABLED_MM = "f/2", (40.0, 60.0, 80.0, 100.0, 120.0, 150.0)
NAMES = {
    "f/4": "f4",
    "f/1": "f1",
    "f/2": "f2",
    "f/2, in focus at 250 mm": "focus_250mm",
    "f/2, in focus far away": "focus_far",
}
"""Lenses by names of their figures."""

Fold = float | Literal["auto"]


@dataclass(frozen=True)
class Point:
    """A design: its fold, grid error, and means over the depths of what a pinhole and the whole pupil can use."""

    fold_deg: Fold
    grid_error: float
    pinhole: float
    usable: float


def designed(spec: DesignSpec, judged_with: Camera) -> Point:
    """The figures of `design`'s answer to a spec, with another pupil than it was designed for."""
    layout = design(spec)
    shares = []
    for pupil in (PINHOLE, judged_with.pupil):
        views = fields_of_view(layout, pupil)
        regions = [(views.common_region(depth)[0], depth) for depth in spec.depths_mm]
        shares.append(sum(views.pixel_efficiency(*region) for region in regions) / len(regions))
    fold = layout.spec.fold_deg if layout.spec else spec.fold_deg
    return Point(fold, grid_error(layout), *shares)


def fronts(fold: Fold, workers: int) -> dict[tuple[float, str], list[Point]]:
    """Fronts by scale and by what the design was optimised for."""
    lens = Camera.c920()
    cameras = {"pinhole": lens.replaced(aperture_mm=0.0), "whole pupil": lens}
    keys = [(scale, name, tradeoff) for scale in SCALES_MM for name in cameras for tradeoff in TRADEOFFS]
    answers = call_all(
        [
            (designed, (DesignSpec(camera=cameras[name], scale_mm=scale, tradeoff=tradeoff, fold_deg=fold), lens))
            for scale, name, tradeoff in keys
        ],
        workers,
    )
    found: dict[tuple[float, str], list[Point]] = {}
    for (scale, name, _), point in zip(keys, answers, strict=True):
        found.setdefault((scale, name), []).append(point)
    return found


def gained(plain: list[Point], whole: list[Point]) -> list[float]:
    """What a front for the whole pupil has more than one for a pinhole, where the grid may be uneven.

    At the grid errors of its designs of the two lowest trade-offs, as far as the other front reaches there.
    """
    front = sorted((point.grid_error, point.usable) for point in plain)
    errors, shares = zip(*front, strict=True)
    reached = [point for point in whole[:2] if errors[0] <= point.grid_error <= errors[-1]]
    return [point.usable - float(np.interp(point.grid_error, errors, shares)) for point in reached]


def over_scales(fold: Fold, workers: int) -> dict[str, list[Point]]:
    """Designs over the scale, by lens."""
    cameras = {
        name: Camera.c920().replaced(aperture_mm=aperture, focus_mm=focus) for name, (aperture, focus) in LENSES.items()
    }
    keys = [(name, scale) for name in cameras for scale in BUILT_MM]
    answers = call_all(
        [
            (designed, (DesignSpec(camera=cameras[name], scale_mm=scale, fold_deg=fold), cameras[name]))
            for name, scale in keys
        ],
        workers,
    )
    found: dict[str, list[Point]] = {}
    for (name, _), point in zip(keys, answers, strict=True):
        found.setdefault(name, []).append(point)
    return found


def _scale_panel(axes: Axes, found: dict[str, list[Point]]) -> None:
    for colour, (name, points) in zip(COLOURS, found.items(), strict=True):
        axes.plot(BUILT_MM, [point.usable for point in points], "o-", color=colour, markersize=4, label=name)
    axes.plot(BUILT_MM, [point.pinhole for point in found["f/2"]], ":", color="#777777", label="f/2, as of a pinhole")
    axes.set_xlabel("scale: height of the central mirror above the pupil (mm)")
    axes.set_ylabel("usable efficiency, mean of 300 and 500 mm")
    axes.set_ylim(bottom=0.0)
    axes.set_title("How large to build", fontsize=11)
    axes.grid(alpha=0.3, linewidth=0.5)
    axes.legend(fontsize=9, loc="lower right")


def _front_panel(axes: Axes, found: dict[tuple[float, str], list[Point]]) -> None:
    for (scale, name), points in found.items():
        axes.plot(
            [point.grid_error for point in points],
            [point.usable for point in points],
            "o-" if name == "whole pupil" else "x:",
            color=COLOURS[SCALES_MM.index(scale)],
            markersize=5,
            label=f"{scale:g} mm, optimised for {'the ' if name == 'whole pupil' else 'a '}{name}",
        )
    axes.set_xscale("log")
    axes.set_xlabel("grid error (of a spacing)")
    axes.set_ylabel("usable efficiency, mean of 300 and 500 mm")
    axes.set_title("What optimising for the whole pupil buys", fontsize=11)
    axes.grid(alpha=0.3, which="both", linewidth=0.5)
    axes.legend(fontsize=9, loc="upper left")


def draw(built: dict[str, list[Point]], found: dict[tuple[float, str], list[Point]], path: Path) -> None:
    """Write a PNG: usable efficiency over the scale and lenses, and fronts at three scales."""
    figure = Figure(figsize=(11.5, 4.8), layout="constrained")
    left, right = figure.subplots(1, 2)
    _scale_panel(left, built)
    _front_panel(right, found)
    with atomic(path) as temporary:
        figure.savefig(temporary, dpi=110)


def figures_of(point: Point) -> tuple[str, ...]:
    """Fold, grid error, and the efficiency as of a pinhole and as usable."""
    return f"{point.fold_deg:g}°", f"{point.grid_error:.3f}", short(point.pinhole), short(point.usable)


def main(fold: Fold, workers: int, picture: Path | None, json: Path | None) -> None:
    built, found = over_scales(fold, workers), fronts(fold, workers)
    rows = Rows("scale", "optimised for", "fold", "grid error", "as of a pinhole", "usable")
    for (scale, name), points in found.items():
        for point in points:
            rows.add(f"{scale:g} mm", name, *figures_of(point))
    head = ("scale", "best fold", "grid error", "as of a pinhole", "usable")
    for name, points in built.items():
        print(f"\n{name}")
        rows = Rows(*head)
        for scale, point in zip(BUILT_MM, points, strict=True):
            if scale in TABLED_MM or name != OF_TABLE:
                rows.add(f"{scale:g} mm", *figures_of(point))
        if name == OF_TABLE:
            write_record(json, "design_pupil", table=rows.table)
    gains = {scale: gained(found[scale, "pinhole"], found[scale, "whole pupil"]) for scale in SCALES_MM}
    for scale, each in gains.items():
        print(f"{scale:g} mm: {', '.join(f'{gain:+.3f}' for gain in each)} by optimising for the whole pupil")
    at_80 = {name: points[BUILT_MM.index(80.0)].usable for name, points in built.items()}
    figures = {f"usable_{short_name}": at_80[name] for name, short_name in NAMES.items()}
    nearer = [gain for scale in (60.0, 80.0) for gain in gains[scale]]
    figures |= {"gain_least": min(nearer), "gain_most": max(nearer)}
    write_record(json, "design_pupil_lenses", figures)
    if picture:
        draw(built, found, picture)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--fold-deg", type=lambda text: text if text == "auto" else float(text), default="auto")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--picture", type=Path, help="a PNG to write")
    add_json_option(parser)
    arguments = parser.parse_args()
    main(arguments.fold_deg, arguments.workers, arguments.picture, arguments.json)
