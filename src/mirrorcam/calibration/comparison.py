"""A comparison of two calibrations from files, and its result as files."""

from __future__ import annotations

from pathlib import Path

from mirrorcam.calibration.difference_figure import difference_figure
from mirrorcam.core.disk.files import write_metrics
from mirrorcam.core.values import InputError, Metric
from mirrorcam.optics.calibration.diagnostics.calibration_difference import (
    CalibrationDifference,
    calibration_difference,
)
from mirrorcam.optics.calibration.solver.observations import DIRECT
from mirrorcam.optics.camera_files.read.registry import formats_in, unread
from mirrorcam.optics.geometry.layout import Layout, working_distance_mm

FILES = ("difference.png", "metrics.json")


def compare_files(a: Path, b: Path, distance_mm: float | None) -> CalibrationDifference:
    """Compare two `layout.json`, for points at a distance from each view, or where A's board was.

    Raises InputError where a file cannot be read, the layouts are of different devices, or A does not tell a distance.
    """
    layout, other = read_compared(a), read_compared(b)
    if distance_mm is None:
        distance_mm = working_distance_mm(layout)
    if distance_mm is None:
        raise InputError(f"{a}: no working distance in it, expected --distance-mm MM")
    try:
        return calibration_difference(layout, other, range_mm=distance_mm)
    except InputError as error:
        raise InputError(f"{a} and {b}: {error}") from None


def read_compared(path: Path) -> Layout:
    """The layout in a file; raises InputError for none, and names what another tool's calibration is."""
    try:
        return Layout.load(path)
    except InputError:
        if not path.is_file():
            raise
        of_others = [name for name in formats_in(path) if name != "mirrorcam"]
        named = f"a calibration as {of_others[0]}" if of_others else unread(path)
        if not named:
            raise
        raise InputError(f"{path}: {named}, expected a layout.json, as `mirrorcam calibrate` writes it") from None


def comparison_metrics(difference: CalibrationDifference, layout: Layout) -> dict[str, Metric]:
    """The figures of a comparison: of all views, of the motion, and of every view of the layout."""
    metrics = {"distance_mm": Metric(value=difference.range_mm, unit="mm")}
    metrics |= {f"all_{name}": figure for name, figure in difference.figures(difference.views).items()}
    metrics |= difference.motion
    for view in difference.views:
        row, column = divmod(view.view, layout.cols)
        name = "direct" if view.view == DIRECT else f"view_{row}_{column}"
        metrics |= {f"{name}_{key}": figure for key, figure in difference.figures([view]).items()}
    return metrics


def write_comparison(difference: CalibrationDifference, layout: Layout, folder: Path) -> None:
    """Write difference.png and metrics.json into a folder, each atomically; `layout` is A's."""
    write_metrics(folder / "metrics.json", comparison_metrics(difference, layout))
    difference_figure(difference, layout, folder / "difference.png")
