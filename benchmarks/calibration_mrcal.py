"""mrcal as a referee: `python -m benchmarks.calibration_mrcal CORNERS SET [CORNERS SET ...]`.

CORNERS is a table of corners (`corners.csv`) that `mirrorcam calibrate` wrote; SET a folder with the `layout.json` and
`board.toml` of the calibration and, if known, `truth/truth.json` (see `benchmarks.calibration_foreign`).
Both solve for camera and mirrors from these corners: this project with planes of mirrors (3 parameters each) and
corners weighted by their standard deviations; mrcal, which has no model of mirrors, with one lens and a free pose (6
parameters) for each mirror, with equal weights and with the same weights. Both may reject further corners.

PYTHON is an interpreter that has mrcal (https://mrcal.secretsauce.net; in Debian the package python3-mrcal), by default
the running one, or else that of the system; without any, the exit code is 2.

Prints residuals, seconds and lens of each, and their difference from the truth (without a truth, from this project)
according to mrcal: its projection difference over the picture, with the implied motion; and the difference in all
mirrors at once, with one rigid motion removed. Points are as far away as the boards.
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
from benchmarks.referees.mrcal_runner import LENSES, python_with_mrcal, run_solver
from mirrorcam.calibration.calibration_files import calibrate_files
from mirrorcam.calibration.calibration_request import CalibrationRequest
from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.corner_files import load_corners
from mirrorcam.optics.calibration.diagnostics.calibration_result import Calibration
from mirrorcam.optics.calibration.solver.observations import DIRECT, Observations
from mirrorcam.optics.geometry.boards import AprilGrid, CalibrationBoard, load_board
from mirrorcam.optics.geometry.layout import Layout

OWN = "this project"
MAX_SAMPLES = 400
"""Maximum number of corners in each mirror at which projections are compared."""


def reflection(centre: FloatArray) -> FloatArray:
    """Return the reflection (4, 4) of the rig in the mirror with the given virtual centre."""
    normal = centre / np.linalg.norm(centre)
    matrix = np.eye(4)
    matrix[:3, :3] -= 2.0 * np.outer(normal, normal)
    matrix[:3, 3] = centre
    return matrix


def cameras_m(centres: FloatArray) -> list[Any]:
    """Return rigid motions (4, 4), in metres, from the image of a point in the first mirror to its image in each."""
    first = reflection(centres[0])  # its own inverse
    motions = np.array([reflection(centre) @ first for centre in centres])
    motions[:, :3, 3] /= 1000.0
    return motions.tolist()


def centres_of(layout: Layout) -> FloatArray:
    return np.array([mirror.virtual_centre_in_rig_mm for mirror in layout.mirrors])


def task_of(corners: Path, layout: Layout, board: CalibrationBoard) -> dict[str, Any]:
    """Return the solver's task: board, and corners as frame, camera (0 without a mirror), corner, x, y, sigma."""
    table = load_corners(corners, layout, len(board.corners_in_board_mm))
    rows: list[list[float]] = []
    frame = 0
    samples: list[list[Any]] = [[] for _ in layout.mirrors]
    for observations in (*table.mirrored.values(), *table.base.values()):
        for direct in (False, True):
            part: Observations = observations.where((observations.view == DIRECT) == direct)
            columns = (part.view, part.corner, *part.pixels.T, part.sigma_px)
            for view, corner, x, y, sigma in zip(*(column.tolist() for column in columns), strict=True):
                rows.append([frame, max(view, 0), corner, x, y, sigma])
                if not direct:
                    samples[view].append([x, y])
            frame += int(len(part) > 0)
    cols, rows_across = board.corner_counts
    return {
        "width_px": layout.camera.width_px,
        "height_px": layout.camera.height_px,
        "focal_px": layout.camera.fx_px,
        "board": {"rows": rows_across, "cols": cols, "spacing_m": board.pitch_mm / 1000.0},
        "corners": rows,
        "samples": [pixels[:: max(len(pixels) // MAX_SAMPLES, 1)] for pixels in samples],
    }


def figures_of(calibration: Calibration, seconds: float) -> dict[str, Any]:
    """Return the figures that mrcal's solver also gives."""
    uncertainty = calibration.layout.uncertainty
    assert uncertainty is not None
    sigma = np.sqrt(np.diag(uncertainty.covariance))
    camera, centres = calibration.layout.camera, centres_of(calibration.layout)
    return {
        "lens": camera.intrinsics.tolist(),
        "sigma": [float(sigma[uncertainty.parameters.index(name)]) for name in camera.intrinsic_names],
        "cameras": cameras_m(centres),
        "rms_px": [calibration.metrics[f"rms_{axis}_px"].value for axis in "xy"],
        "corners": int(calibration.inliers.sum()),
        "seconds": seconds,
    }


def true_calibration(folder: Path) -> dict[str, Any]:
    """Return the true calibration of a set; empty if it is unknown."""
    path = folder / "truth" / "truth.json"
    if not path.exists():
        return {}
    truth = json.loads(path.read_text())
    lens = [*truth["K"], *truth["D"]]
    return {"truth": {"lens": lens} | ({} if truth["sheet"] else {"cameras": cameras_m(np.array(truth["C"]))})}


def compare(corners: Path, folder: Path, python: str, rows: Rows) -> None:
    """Calibrate with both, and add a row for each."""
    layout, board = Layout.load(folder / "layout.json"), load_board(folder / "board.toml")
    if isinstance(board, AprilGrid):
        raise InputError(f"{folder / 'board.toml'}: an AprilGrid, expected equally spaced corners")
    start_s = time.perf_counter()
    request = CalibrationRequest(board=folder / "board.toml", corners=(corners,), layout=folder / "layout.json")
    calibration = calibrate_files((), request)
    ours, camera = figures_of(calibration, time.perf_counter() - start_s), calibration.layout.camera
    if camera.lens_model not in LENSES:
        raise InputError(f"{folder}: a {camera.lens_model} lens, expected one of {', '.join(LENSES)}")
    if calibration.layout.mirrors[0].is_second_surface:
        del ours["cameras"]  # behind glass, no place of a camera is exact
    known = true_calibration(folder)
    task = task_of(corners, layout, board) | {"lens": LENSES[camera.lens_model], "calibrations": known | {OWN: ours}}
    answer = run_solver(python, task)
    reference = "truth" if known else OWN
    differences = {pair["of"][1]: pair for pair in answer["differences"] if pair["of"][0] == reference}
    for name, solution in ({OWN: ours} | answer["found"]).items():
        lens = (
            f"{short} {value:.6g} ± {sigma:.2g}"
            for short, value, sigma in zip(camera.intrinsic_names, solution["lens"], solution["sigma"], strict=True)
        )
        errors = (differences.get(name, {}).get(key) for key in ("lens_px", "device_px"))
        distances = ("" if value is None else f"{value:.4f}" for value in errors)
        used = f"{solution['corners']:,} of {len(task['corners']):,}"
        residuals = "{:.4f} / {:.4f}".format(*solution["rms_px"])
        rows.add(folder.name, name, used, residuals, *distances, f"{solution['seconds']:.1f}", ", ".join(lens))


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("pairs", type=Path, nargs="+", metavar="CORNERS SET")
    parser.add_argument("--python")
    add_json_option(parser)
    options = parser.parse_args()
    if len(options.pairs) % 2:
        parser.error("expected pairs of CORNERS and SET")
    python = python_with_mrcal(options.python)
    if python is None:
        where = options.python or "this or the system python3"
        print(f"mrcal: not installed in {where}; --python PYTHON states a different one")
        return 2
    rows = Rows("set", "by", "corners used", "RMS x / y, px", "off: picture, px", "mirrors, px", "seconds", "lens")
    try:
        for corners, folder in zip(options.pairs[::2], options.pairs[1::2], strict=True):
            compare(corners, folder, python, rows)
    except InputError as error:
        print(error)
        return 2
    write_record(options.json, "calibration_mrcal", table=rows.table)
    return 0


if __name__ == "__main__":
    sys.exit(main())
