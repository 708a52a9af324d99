"""Calibration of sets made by a different renderer: `python -m benchmarks.calibration_foreign SET [SET ...]`.

A set is a folder with `frames/`, `base/`, `board.toml`, the nominal `layout.json` and `truth/truth.json`: intrinsics K
(fx, fy, cx, cy) and D (k1, k2, p1, p2, k3), virtual centres C in the rig frame, mm, and, for plates, their thickness
`sheet`, mm. Each is calibrated from its pictures, layout and board alone before its truth
is read. A set with second-surface mirrors is calibrated once more from a layout that states first-surface ones, with
`--model second_surface+auto`.

Prints, for each: corners dropped; errors of normals and distances; NEES per parameter (squared errors in units of the
covariance: 1 if that is right) of all parameters, the mirrors and the intrinsics; the thickness; the verdict.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.records import Table, add_json_option, table, write_record
from mirrorcam.calibration.calibration_files import calibrate_files
from mirrorcam.calibration.calibration_request import CalibrationRequest
from mirrorcam.optics.calibration.diagnostics.calibration_result import Calibration
from mirrorcam.optics.calibration.diagnostics.requested_model import RequestedModel
from mirrorcam.optics.calibration.diagnostics.verdict import STATES, check_solution
from mirrorcam.optics.calibration.diagnostics.view_statistics import view_figures
from mirrorcam.optics.geometry.layout import Layout

LENS = ("fx_px", "fy_px", "cx_px", "cy_px", "k1", "k2", "p1", "p2", "k3")
AXES = ("x_mm", "y_mm", "z_mm")


def true_values(truth: dict[str, Any]) -> dict[str, float]:
    """Return the true intrinsics and virtual centres, by the parameter names of a calibration."""
    values = dict(zip(LENS, (*truth["K"], *truth["D"]), strict=True))
    for index, centre in enumerate(truth["C"]):
        values |= {f"mirror {index} {axis}": value for axis, value in zip(AXES, centre, strict=True)}
    return values


def calibrated_values(layout: Layout) -> dict[str, float]:
    """Return the same values of a calibrated layout."""
    values = dict(zip(layout.camera.intrinsic_names, layout.camera.intrinsics.tolist(), strict=True))
    for index, mirror in enumerate(layout.mirrors):
        centre = mirror.virtual_centre_in_rig_mm.tolist()
        values |= {f"mirror {index} {axis}": value for axis, value in zip(AXES, centre, strict=True)}
    return values


def nees(layout: Layout, truth: dict[str, Any], counts: Callable[[str], bool]) -> float:
    """Return the NEES per parameter, for the parameters whose names `counts` accepts."""
    uncertainty = layout.uncertainty
    assert uncertainty is not None
    values, expected = calibrated_values(layout), true_values(truth)
    indices = [
        index
        for index, name in enumerate(uncertainty.parameters)
        if counts(name) and name in values and name in expected
    ]
    names = [uncertainty.parameters[index] for index in indices]
    errors = np.array([values[name] - expected[name] for name in names])
    return float(errors @ np.linalg.solve(uncertainty.covariance[np.ix_(indices, indices)], errors)) / len(errors)


def thickness(layout: Layout) -> str:
    """Return the thickness of the plates, with its standard deviation if it was fitted."""
    uncertainty = layout.uncertainty
    assert uncertainty is not None
    mean = float(np.mean([mirror.thickness_mm for mirror in layout.mirrors]))
    if "sheet_mm" not in uncertainty.parameters:
        return f"{mean:.4f} mm, as in the layout"
    index = uncertainty.parameters.index("sheet_mm")
    return f"{mean:.4f} +- {np.sqrt(uncertainty.covariance[index, index]):.4f} mm"


def worst_normal_deg(layout: Layout, truth: dict[str, Any]) -> float:
    """Return the largest angle between a mirror's normal and the true one."""
    centres = np.array([mirror.virtual_centre_in_rig_mm for mirror in layout.mirrors])
    unit, true_unit = (c / np.linalg.norm(c, axis=1, keepdims=True) for c in (centres, np.array(truth["C"])))
    return float(np.degrees(np.linalg.norm(np.cross(unit, true_unit), axis=1).max()))


TITLES = {
    "a_ch": "ChArUco",
    "a_cb": "checkerboard, often in part",
    "s2_ch": "ChArUco, 2 mm acrylic, second surface",
}
"""Columns of the table."""
EARLIER = {
    ("a_ch", "dropped"): "4.7 %",
    ("a_cb", "dropped"): "7.0 % of 2,304",
    ("s2_ch", "nees"): "144",
    ("s2_ch", "thickness"): "1.933 ± 0.024",
}
"""Results before corners were weighted and detected in parts of boards, which the table also states."""


@dataclass(frozen=True)
class Report:
    """Cells of the table: corners dropped, errors of normals and distances, NEES, thickness and verdict."""

    dropped: str
    worst: str
    nees: str
    thickness: str
    verdict: str


def report(title: str, calibration: Calibration, truth: dict[str, Any]) -> Report:
    """Print the figures of one calibration, and return them."""
    layout, true = calibration.layout, np.array(truth["C"])
    centres = np.array([mirror.virtual_centre_in_rig_mm for mirror in layout.mirrors])
    distance_mm = np.abs(np.linalg.norm(centres, axis=1) - np.linalg.norm(true, axis=1)).max() / 2.0
    level = "" if calibration.diagnostics is None else calibration.diagnostics.model_name
    all_nees, mirrors_nees, lens_nees = (
        nees(layout, truth, counts)
        for counts in (lambda name: True, lambda name: name.startswith("mirror "), lambda name: name in LENS)
    )
    print(
        f"  {title}: {level}, {np.mean(~calibration.inliers):.2%} of {len(calibration.inliers)} corners dropped, "
        f"normals {worst_normal_deg(layout, truth):.4f} deg, distances {distance_mm:.4f} mm"
    )
    print(f"    NEES per parameter {all_nees:.2f}, of mirrors {mirrors_nees:.2f}, of intrinsics {lens_nees:.2f}")
    if truth.get("sheet"):
        print(f"    plates {thickness(layout)}, true {truth['sheet']:g} mm")
    verdict = check_solution(calibration, view_figures(calibration))
    print(f"    {STATES[verdict.state]}{''.join(f'; {reason}' for reason in verdict.reasons)}")
    dropped = f"{100.0 * np.mean(~calibration.inliers):.2f} % of {len(calibration.inliers):,}"
    return Report(
        dropped,
        f"{worst_normal_deg(layout, truth):.4f}°, {distance_mm:.4f} mm",
        f"{all_nees:.2f}",
        thickness(layout).replace("+-", "±") if truth.get("sheet") else "",
        f"{STATES[verdict.state]}{''.join(f': {reason}' for reason in verdict.reasons[:1])}",
    )


def comparison_table(reports: dict[str, Report]) -> Table:
    """Return the table, with a column for each set."""
    rows = {
        "corners dropped": "dropped",
        "worst normal, distance": "worst",
        "NEES per parameter": "nees",
        "thickness (truth 2.000 mm), from a layout that states first surface": "thickness",
        "verdict": "verdict",
    }

    def cell(name: str, part: str) -> str:
        earlier = EARLIER.get((name, part))
        return f"{getattr(reports[name], part)}{f' (was {earlier})' if earlier else ''}"

    cells = [(title, *(cell(name, part) for name in reports)) for title, part in rows.items()]
    return table(("", *(TITLES.get(name, name) for name in reports)), cells)


def main(folders: list[Path], record_to: Path | None) -> None:
    reports: dict[str, Report] = {}
    for folder in folders:
        request = CalibrationRequest(
            board=folder / "board.toml", layout=folder / "layout.json", base=(folder / "base",)
        )
        layout = Layout.load(folder / "layout.json")
        print(folder.name)
        with tempfile.TemporaryDirectory() as folder_name:
            pictures, corners = [folder / "frames"], Path(folder_name) / "corners"
            calibration = calibrate_files(pictures, request, detections=corners)
            as_first = None
            if layout.mirrors[0].is_second_surface:
                layout.with_surface("first").save(Path(folder_name) / "layout.json")
                model = RequestedModel.parse("second_surface+auto")
                request = request.replaced(layout=Path(folder_name) / "layout.json", model=model)
                as_first = calibrate_files(pictures, request, detections=corners)
        truth = json.loads((folder / "truth" / "truth.json").read_text())
        reports[folder.name] = report("with the layout's surface", calibration, truth)
        if as_first is not None:
            first = report("from a first-surface layout, --model second_surface+auto", as_first, truth)
            both = f"{reports[folder.name].nees}, with the thickness {first.nees}"
            reports[folder.name] = replace(reports[folder.name], nees=both, thickness=first.thickness)
    write_record(record_to, "calibration_foreign", table=comparison_table(reports))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("sets", nargs="+", type=Path, metavar="SET")
    add_json_option(parser)
    options = parser.parse_args()
    main(options.sets, options.json)
