"""`mirrorcam compare`: the difference of two calibrations of one device."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from mirrorcam.core.bounds import DEPTH_MM
from mirrorcam.core.console.options import Force, bounded
from mirrorcam.core.console.progress import print_table, say
from mirrorcam.core.figures.figure_texts import SIGMA, equal_decimals, figure_text

if TYPE_CHECKING:
    from mirrorcam.optics.calibration.diagnostics.calibration_difference import CalibrationDifference
    from mirrorcam.optics.geometry.layout import Layout

COLUMNS = {
    "rms_px": "RMS px",
    "max_px": "max px",
    "sigma_px": f"{SIGMA} px",
    "ratio": "ratio",
    "rms_mm": "RMS mm",
    "max_mm": "max mm",
    "sigma_mm": f"{SIGMA} mm",
}


def compare(
    a: Annotated[Path, Parameter(name="A", help="layout.json of one calibration")],
    b: Annotated[Path, Parameter(name="B", help="layout.json of the other calibration")],
    /,
    *,
    distance_mm: Annotated[
        float | None,
        bounded(DEPTH_MM, "distance of the points that are compared, from each view", unset="where A's board was"),
    ] = None,
    out: Annotated[Path, Parameter(help="output folder")] = Path("output/compared"),
    force: Force = False,
) -> int:
    """Compare two calibrations of one device.

    The rigid motion between the two rigs is removed, and the remaining difference is compared with the uncertainties.
    Writes difference.png, a map of the difference in every view, and metrics.json.

    Examples:
        mirrorcam compare calibrated/layout.json again/layout.json
    """
    from mirrorcam.calibration.comparison import FILES, compare_files, read_compared, write_comparison
    from mirrorcam.core.disk.output_folder import output_folder

    with output_folder(out, "compare", force=force) as output:
        output.refuse_others(*FILES)
        layout = read_compared(a)
        difference = compare_files(a, b, distance_mm)
        with output.staged(result="metrics.json") as folder:
            write_comparison(difference, layout, folder)
    _print(difference, layout)
    for name, path, predicted in zip("AB", (a, b), difference.predicted, strict=True):
        if not predicted:
            say("compare", f"{path} has no covariance: {SIGMA} leaves out the covariance of {name}")
    say("compare", f"{out / 'difference.png'} and {out / 'metrics.json'} written")
    return 0


def _verdict(difference: CalibrationDifference, layout: Layout) -> str:
    """State whether the difference exceeds noise, by its worst view."""
    from mirrorcam.optics.calibration.diagnostics.calibration_difference import NOISE_RATIO, view_label

    if difference.metrics(difference.views)["max_px"].value == 0.0:
        return "the calibrations do not differ"
    if difference.worst is None:
        return "cannot compare the difference with noise: no covariance predicts it"
    view, ratio = difference.worst
    verdict = "more than noise:" if ratio > NOISE_RATIO else "within noise: at most"
    times = f"{ratio:.2f}" if ratio < 10.0 else f"{ratio:.0f}"
    location = f"in {view_label(layout, view.view)} (limit {NOISE_RATIO:g})"
    return f"the difference is {verdict} {times} times the predicted {SIGMA}, {location}"


def _print(difference: CalibrationDifference, layout: Layout) -> None:
    """Print a row of figures for each view, one for all, and the motion."""
    from mirrorcam.optics.calibration.diagnostics.calibration_difference import view_label

    rows = {view_label(layout, view.view): difference.metrics([view]) for view in difference.views}
    rows["all views"] = difference.metrics(difference.views)
    names = [name for name in COLUMNS if name in rows["all views"]]
    columns = [equal_decimals([figures[name].value for figures in rows.values()], digits=3) for name in names]
    print_table(["", *(COLUMNS[name] for name in names)], list(zip(rows, *columns, strict=True)))
    rotation, shift = (figure_text(difference.motion[f"motion_{name}"].value, 3) for name in ("turn_deg", "shift_mm"))
    say("compare", _verdict(difference, layout))
    points = f"points {difference.range_mm:.0f} mm from each view"
    say("compare", f"{points}; a motion of the rig by {rotation}° and {shift} mm is removed")
