"""mrcal as a referee: `python -m benchmarks.calibration_mrcal CORNERS SET [CORNERS SET ...]`.

CORNERS is a table of corners, as `mirrorcam calibrate` writes one (`corners.csv`); SET a folder with the `layout.json`
and `board.toml` that it was made with and, where it is known, `truth/truth.json` (`benchmarks.calibration_foreign`).
Both solve for camera and mirrors from these corners: this project with planes of mirrors (3 numbers each) and corners
weighted by their standard deviations; mrcal, which knows no mirrors, with one lens and a free place (6 numbers) for
each mirror, with equal weights and with the same weights. Both may leave out further corners.

PYTHON is an interpreter that has mrcal (https://mrcal.secretsauce.net; in Debian the package python3-mrcal), by default
the running one or else that of the system; without any, a line says so and the exit code is 2.

Prints residuals, seconds and lens of each, and how far each is from the truth (without a truth, from this project), as
mrcal says it: by its projection difference over the picture, with the implied motion; and in all mirrors at once, with
one rigid motion taken out. Points are as far away as the boards.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.records import Rows, add_json_option, write_record
from benchmarks.referees.mrcal_runner import LENSES, asked, python_with_mrcal
from mirrorcam.calibration.calibration_files import calibrate_files
from mirrorcam.calibration.calibration_request import CalibrationRequest
from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.corner_files import load_corners
from mirrorcam.optics.calibration.diagnostics.calibration_result import Calibration
from mirrorcam.optics.calibration.solver.observations import DIRECT, Observations
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.targets import AprilGrid, Target, load_board

OWN = "this project"
MOST_PLACES = 400
"""Corners of a mirror where projections are compared."""


def reflection(centre: FloatArray) -> FloatArray:
    """The reflection (4, 4) of the rig in the mirror with a virtual centre."""
    across = centre / np.linalg.norm(centre)
    matrix = np.eye(4)
    matrix[:3, :3] -= 2.0 * np.outer(across, across)
    matrix[:3, 3] = centre
    return matrix


def cameras_m(centres: FloatArray) -> list[Any]:
    """Rigid motions (4, 4), in metres, of points seen in the first mirror to points seen in each."""
    first = reflection(centres[0])  # its own inverse
    moved = np.array([reflection(centre) @ first for centre in centres])
    moved[:, :3, 3] /= 1000.0
    return moved.tolist()


def centres_of(layout: Layout) -> FloatArray:
    return np.array([mirror.virtual_centre_in_rig_mm for mirror in layout.mirrors])


def task_of(corners: Path, layout: Layout, target: Target) -> dict[str, Any]:
    """Board and corners as the solver takes them: frame, camera (0 without a mirror), corner, x, y, sigma."""
    table = load_corners(corners, layout, len(target.corners_in_board_mm))
    rows: list[list[float]] = []
    frame = 0
    places: list[list[Any]] = [[] for _ in layout.mirrors]
    for seen in (*table.mirrored.values(), *table.base.values()):
        for direct in (False, True):
            part: Observations = seen.where((seen.view == DIRECT) == direct)
            columns = (part.view, part.corner, *part.pixels.T, part.sigma_px)
            for view, corner, x, y, sigma in zip(*(column.tolist() for column in columns), strict=True):
                rows.append([frame, max(view, 0), corner, x, y, sigma])
                if not direct:
                    places[view].append([x, y])
            frame += int(len(part) > 0)
    cols, along = target.corner_counts
    return {
        "width_px": layout.camera.width_px,
        "height_px": layout.camera.height_px,
        "focal_px": layout.camera.fx_px,
        "board": {"rows": along, "cols": cols, "spacing_m": target.pitch_mm / 1000.0},
        "corners": rows,
        "places": [some[:: max(len(some) // MOST_PLACES, 1)] for some in places],
    }


def figures_of(found: Calibration, seconds: float) -> dict[str, Any]:
    """The same figures as mrcal's."""
    known = found.layout.uncertainty
    assert known is not None
    sigma = np.sqrt(np.diag(known.covariance))
    camera, centres = found.layout.camera, centres_of(found.layout)
    return {
        "lens": camera.intrinsics.tolist(),
        "sigma": [float(sigma[known.parameters.index(name)]) for name in camera.intrinsic_names],
        "cameras": cameras_m(centres),
        "rms_px": [found.metrics[f"rms_{axis}_px"].value for axis in "xy"],
        "corners": int(found.inliers.sum()),
        "seconds": seconds,
    }


def known_of(folder: Path) -> dict[str, Any]:
    """The true calibration of a set, empty where it is not known."""
    path = folder / "truth" / "truth.json"
    if not path.exists():
        return {}
    truth = json.loads(path.read_text())
    lens = [*truth["K"], *truth["D"]]
    return {"truth": {"lens": lens} | ({} if truth["sheet"] else {"cameras": cameras_m(np.array(truth["C"]))})}


def compare(corners: Path, folder: Path, judge: str, rows: Rows) -> None:
    """Calibrate by both, and add a row for each."""
    layout, target = Layout.load(folder / "layout.json"), load_board(folder / "board.toml")
    if isinstance(target, AprilGrid):
        raise InputError(f"{folder / 'board.toml'}: an AprilGrid, expected a board of even squares, as mrcal has them")
    started = time.perf_counter()
    request = CalibrationRequest(board=folder / "board.toml", corners=(corners,), layout=folder / "layout.json")
    found = calibrate_files((), request)
    ours, camera = figures_of(found, time.perf_counter() - started), found.layout.camera
    if camera.lens_model not in LENSES:
        raise InputError(f"{folder}: a {camera.lens_model} lens, expected one of {', '.join(LENSES)}")
    if found.layout.mirrors[0].is_second_surface:
        del ours["cameras"]  # behind glass, no place of a camera is exact
    known = known_of(folder)
    task = task_of(corners, layout, target) | {"lens": LENSES[camera.lens_model], "calibrations": known | {OWN: ours}}
    answer = asked(judge, task)
    off = {each["of"][1]: each for each in answer["differences"] if each["of"][0] == ("truth" if known else OWN)}
    for name, each in ({OWN: ours} | answer["found"]).items():
        lens = (
            f"{short} {value:.6g} ± {sigma:.2g}"
            for short, value, sigma in zip(camera.intrinsic_names, each["lens"], each["sigma"], strict=True)
        )
        apart = (off.get(name, {}).get(key) for key in ("lens_px", "device_px"))
        distances = ("" if value is None else f"{value:.4f}" for value in apart)
        used = f"{each['corners']:,} of {len(task['corners']):,}"
        residuals = "{:.4f} / {:.4f}".format(*each["rms_px"])
        rows.add(folder.name, name, used, residuals, *distances, f"{each['seconds']:.1f}", ", ".join(lens))


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("pairs", type=Path, nargs="+", metavar="CORNERS SET")
    parser.add_argument("--python")
    add_json_option(parser)
    options = parser.parse_args()
    if len(options.pairs) % 2:
        parser.error("expected pairs of CORNERS and SET")
    judge = python_with_mrcal(options.python)
    if judge is None:
        print(f"mrcal: not there in {options.python or 'this or the system python3'}; --python PYTHON names another")
        return 2
    rows = Rows("set", "by", "corners used", "RMS x / y, px", "off: picture, px", "mirrors, px", "seconds", "lens")
    try:
        for corners, folder in zip(options.pairs[::2], options.pairs[1::2], strict=True):
            compare(corners, folder, judge, rows)
    except InputError as error:
        print(error)
        return 2
    write_record(options.json, "calibration_mrcal", table=rows.table)
    return 0


if __name__ == "__main__":
    sys.exit(main())
