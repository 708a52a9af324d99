"""Calibration of sets that another renderer made: `python -m benchmarks.calibration_foreign SET [SET ...]`.

A set is a folder with `frames/`, `base/`, `board.toml`, the nominal `layout.json` and `truth/truth.json`: intrinsics K
(fx, fy, cx, cy) and D (k1, k2, p1, p2, k3), virtual centres C in the rig frame, mm, and the thickness `sheet` of
plates, mm, 0 of first-surface mirrors. Each is calibrated from its pictures, layout and board alone before its truth is
read. One with second-surface mirrors is calibrated once more from a layout that says first-surface, as
`--model second_surface+auto` does it.

Prints, for each: corners dropped; errors of normals and distances; NEES per parameter (squared errors by the
covariance: 1 where it is right) of all, of the mirrors, of the intrinsics; the thickness; the verdict.
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
    """True intrinsics and virtual centres by the names of a calibration's parameters."""
    values = dict(zip(LENS, (*truth["K"], *truth["D"]), strict=True))
    for index, centre in enumerate(truth["C"]):
        values |= {f"mirror {index} {axis}": value for axis, value in zip(AXES, centre, strict=True)}
    return values


def found_values(layout: Layout) -> dict[str, float]:
    """The same of a calibrated layout."""
    values = dict(zip(layout.camera.intrinsic_names, layout.camera.intrinsics.tolist(), strict=True))
    for index, mirror in enumerate(layout.mirrors):
        centre = mirror.virtual_centre_in_rig_mm.tolist()
        values |= {f"mirror {index} {axis}": value for axis, value in zip(AXES, centre, strict=True)}
    return values


def nees(layout: Layout, truth: dict[str, Any], counts: Callable[[str], bool]) -> float:
    """Squared errors of the parameters that count, by their covariance and per parameter."""
    known = layout.uncertainty
    assert known is not None
    found, expected = found_values(layout), true_values(truth)
    places = [
        place for place, name in enumerate(known.parameters) if counts(name) and name in found and name in expected
    ]
    off = np.array([found[known.parameters[place]] - expected[known.parameters[place]] for place in places])
    return float(off @ np.linalg.solve(known.covariance[np.ix_(places, places)], off)) / len(off)


def thickness(layout: Layout) -> str:
    """Thickness of the plates with its standard deviation, where it was fitted."""
    known = layout.uncertainty
    assert known is not None
    mean = float(np.mean([mirror.thickness_mm for mirror in layout.mirrors]))
    if "sheet_mm" not in known.parameters:
        return f"{mean:.4f} mm, as in the layout"
    place = known.parameters.index("sheet_mm")
    return f"{mean:.4f} +- {np.sqrt(known.covariance[place, place]):.4f} mm"


def worst_normal_deg(layout: Layout, truth: dict[str, Any]) -> float:
    """Largest angle between a mirror's normal and the true one."""
    found = np.array([mirror.virtual_centre_in_rig_mm for mirror in layout.mirrors])
    unit, true_unit = (c / np.linalg.norm(c, axis=1, keepdims=True) for c in (found, np.array(truth["C"])))
    return float(np.degrees(np.linalg.norm(np.cross(unit, true_unit), axis=1).max()))


TITLES = {
    "a_ch": "ChArUco",
    "a_cb": "checkerboard, often in part",
    "s2_ch": "ChArUco, 2 mm acrylic, second surface",
}
"""Columns of the table."""
WAS = {
    ("a_ch", "dropped"): "4.7 %",
    ("a_cb", "dropped"): "7.0 % of 2,304",
    ("s2_ch", "nees"): "144",
    ("s2_ch", "thickness"): "1.933 ± 0.024",
}
"""What the table says of the calibration before corners were weighed and found in parts of boards."""


@dataclass(frozen=True)
class Report:
    """Cells of the table: corners dropped, errors of normals and distances, NEES, thickness and verdict."""

    dropped: str
    worst: str
    nees: str
    thickness: str
    verdict: str


def report(how: str, calibration: Calibration, truth: dict[str, Any]) -> Report:
    """Print the figures of one calibration, and return them."""
    layout, true = calibration.layout, np.array(truth["C"])
    found = np.array([mirror.virtual_centre_in_rig_mm for mirror in layout.mirrors])
    distance_mm = np.abs(np.linalg.norm(found, axis=1) - np.linalg.norm(true, axis=1)).max() / 2.0
    level = "" if calibration.diagnostics is None else calibration.diagnostics.model_name
    everything, mirrors, lens = (
        nees(layout, truth, counts)
        for counts in (lambda name: True, lambda name: name.startswith("mirror "), lambda name: name in LENS)
    )
    print(
        f"  {how}: {level}, {np.mean(~calibration.inliers):.2%} of {len(calibration.inliers)} corners dropped, normals "
        f"{worst_normal_deg(layout, truth):.4f} deg, distances {distance_mm:.4f} mm"
    )
    print(f"    NEES per parameter {everything:.2f}, of mirrors {mirrors:.2f}, of intrinsics {lens:.2f}")
    if truth["sheet"]:
        print(f"    plates {thickness(layout)}, true {truth['sheet']:g} mm")
    verdict = check_solution(calibration, view_figures(calibration))
    print(f"    {STATES[verdict.state]}{''.join(f'; {reason}' for reason in verdict.reasons)}")
    dropped = f"{100.0 * np.mean(~calibration.inliers):.2f} % of {len(calibration.inliers):,}"
    return Report(
        dropped,
        f"{worst_normal_deg(layout, truth):.4f}°, {distance_mm:.4f} mm",
        f"{everything:.2f}",
        thickness(layout).replace("+-", "±") if truth["sheet"] else "",
        f"{STATES[verdict.state]}{''.join(f': {reason}' for reason in verdict.reasons[:1])}",
    )


def tabled(found: dict[str, Report]) -> Table:
    """The table, a column for each set."""
    rows = {
        "corners dropped": "dropped",
        "worst normal, distance": "worst",
        "NEES per parameter": "nees",
        "thickness (truth 2.000 mm), from a layout that says first surface": "thickness",
        "verdict": "verdict",
    }

    def cell(name: str, part: str) -> str:
        was = WAS.get((name, part))
        return f"{getattr(found[name], part)}{f' (was {was})' if was else ''}"

    cells = [(title, *(cell(name, part) for name in found)) for title, part in rows.items()]
    return table(("", *(TITLES.get(name, name) for name in found)), cells)


def main(folders: list[Path], record_to: Path | None) -> None:
    reports: dict[str, Report] = {}
    for folder in folders:
        request = CalibrationRequest(
            board=folder / "board.toml", layout=folder / "layout.json", base=(folder / "base",)
        )
        layout = Layout.load(folder / "layout.json")
        print(folder.name)
        with tempfile.TemporaryDirectory() as kept:
            pictures, corners = [folder / "frames"], Path(kept) / "corners"
            found = calibrate_files(pictures, request, detections=corners)
            as_first = None
            if layout.mirrors[0].is_second_surface:
                layout.with_surface("first").save(Path(kept) / "layout.json")
                model = RequestedModel.parse("second_surface+auto")
                request = request.replaced(layout=Path(kept) / "layout.json", model=model)
                as_first = calibrate_files(pictures, request, detections=corners)
        truth = json.loads((folder / "truth" / "truth.json").read_text())
        reports[folder.name] = report("as the layout says", found, truth)
        if as_first is not None:
            first = report("from a first-surface layout, --model second_surface+auto", as_first, truth)
            both = f"{reports[folder.name].nees}, with the thickness {first.nees}"
            reports[folder.name] = replace(reports[folder.name], nees=both, thickness=first.thickness)
    write_record(record_to, "calibration_foreign", table=tabled(reports))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("sets", nargs="+", type=Path, metavar="SET")
    add_json_option(parser)
    options = parser.parse_args()
    main(options.sets, options.json)
