"""mrcal as a referee: `python -m benchmarks.calibration_mrcal CORNERS SET [CORNERS SET ...]`.

CORNERS is a table of corners, as `mirrorcam calibrate` writes one (`corners.csv`); SET a folder with the `layout.json`
and `board.toml` that it was made with and, where it is known, `truth/truth.json` (`benchmarks.calibration_foreign`).
Both solve for camera and mirrors from these corners: this project with planes of mirrors (3 numbers each) and corners
weighted by their standard deviations; mrcal, which knows no mirrors, with one lens and a free place (6 numbers) for
each mirror, with equal weights and with the same weights. Both may leave out further corners.

PYTHON is an interpreter that has mrcal (https://mrcal.secretsauce.net; in Debian the package python3-mrcal), by default
the running one or else that of the system; without any, a line says so and the exit code is 2.

Prints residuals, lens and seconds of each, and how they differ, from each other and from the truth, as mrcal says it:
by its projection difference over the picture, with the implied motion; and in all mirrors at once, with one rigid
motion taken out. Points are as far away as the boards.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.calibration_foreign import LENS
from benchmarks.records import Table, add_json_option, table, write_record
from mirrorcam.calibration.calibration_files import CalibrationRequest, calibrate_files
from mirrorcam.core.values import FloatArray, InputError
from mirrorcam.optics.calibration.corner_files import load_corners
from mirrorcam.optics.calibration.diagnostics.calibration_result import Calibration
from mirrorcam.optics.calibration.solver.observations import DIRECT, Observations
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.targets import AprilGrid, Target, load_board

SOLVER = Path(__file__).parent / "referees" / "mrcal_solver.py"
LENSES = {"brown_conrady": "LENSMODEL_OPENCV5", "rational": "LENSMODEL_OPENCV8", "thin_prism": "LENSMODEL_OPENCV12"}
OWN = "this project"
LEAST_PX = 1e-3  # standard deviation of a number in pixels; distortion is known better
MOST_PLACES = 400
"""Corners of a mirror where projections are compared."""


def python_with_mrcal(asked: str | None) -> str | None:
    """An interpreter that has mrcal; None where there is none."""
    for python in (asked,) if asked else (sys.executable, "/usr/bin/python3"):
        try:
            subprocess.run([python, "-c", "import mrcal"], capture_output=True, check=True)
        except (OSError, subprocess.CalledProcessError):
            continue
        return python
    return None


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
    for seen in (*table.seen.values(), *table.base.values()):
        for direct in (False, True):
            part: Observations = seen.where((seen.view == DIRECT) == direct)
            columns = (part.view, part.corner, *part.pixels.T, part.sigma_px)
            for view, corner, x, y, sigma in zip(*(column.tolist() for column in columns), strict=True):
                rows.append([frame, max(view, 0), corner, x, y, sigma])
                if not direct:
                    places[view].append([x, y])
            frame += int(len(part) > 0)
    cols, along = target.corners_across
    return {
        "width_px": layout.camera.width_px,
        "height_px": layout.camera.height_px,
        "focal_px": layout.camera.fx_px,
        "board": {"rows": along, "cols": cols, "spacing_m": target.pitch_mm / 1000.0},
        "corners": rows,
        "places": [some[:: max(len(some) // MOST_PLACES, 1)] for some in places],
    }


def print_lens(names: list[str], calibrations: dict[str, dict[str, Any]], truth: list[float] | None) -> None:
    """Print the numbers of the lens with their standard deviations; their errors in these where the truth is known."""
    for place, name in enumerate(names):
        cells = []
        for each in calibrations.values():
            value, sigma = each["lens"][place], each["sigma"][place]
            off = "" if truth is None else f" ({(value - truth[place]) / sigma:+.1f} sigma)"
            digits = 4 if sigma > LEAST_PX else 6
            cells.append(f"{value:.{digits}f} +- {sigma:.{digits}f}{off}")
        print(f"  {name:8} " + "".join(f"{cell:36}" for cell in cells) + ("" if truth is None else f"{truth[place]:g}"))


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
    try:
        pairs = zip(options.pairs[::2], options.pairs[1::2], strict=True)
        found = [compare(corners, folder, judge) for corners, folder in pairs]
    except InputError as error:
        print(error)
        return 2
    if options.json:
        write_record(options.json, "calibration_mrcal", *recorded(found))
    return 0


@dataclass(frozen=True, eq=False)
class Compared:
    """What was found of a set: its kind of board, all corners, calibrations by name, the lens's names and the truth.

    `off_px` has, by name, how far each is from the truth: over the picture, and in all mirrors where these are known.
    """

    board: str
    corners: int
    calibrations: dict[str, dict[str, Any]]
    names: tuple[str, ...]
    truth: dict[str, Any]
    off_px: Mapping[str, tuple[float, float | None]]

    @property
    def glass(self) -> bool:
        """Whether its mirrors are plates, of which no calibration has places of cameras to compare."""
        return "cameras" not in self.truth.get("truth", {})


def recorded(found: list[Compared]) -> tuple[dict[str, float], Table]:
    """Figures, and a table with three columns for each set of first-surface mirrors."""
    figures, columns, cells = {}, [""], []
    for each in found:
        names = list(each.calibrations)
        if each.glass:
            figures["acrylic_lens_mrcal_px"] = each.off_px[names[1]][0]
            figures["acrylic_lens_own_px"] = each.off_px[names[0]][0]
            continue
        columns += [f"{each.board}: {names[0]}", *names[1:]]
        cells += [_cells(each, name) for name in names]
        left_out = 1.0 - each.calibrations[names[1]]["corners"] / each.corners
        figures[f"left_out_{each.board.lower()}_percent"] = 100.0 * left_out
    lens = next(each.truth["truth"]["lens"] for each in found if not each.glass)
    true = dict(zip(LENS, lens, strict=True))
    titles = ["corners used", "RMS x / y, px"]
    titles += [f"{name.removesuffix('_px')}, px (truth {true[name]:g})" for name in ("fx_px", "cy_px")]
    titles += ["from the truth, picture", "from the truth, mirrors", "seconds"]
    return figures, table(columns, zip(titles, *cells, strict=True))


def _cells(compared: Compared, name: str) -> tuple[str, ...]:
    found = compared.calibrations[name]
    numbers = []
    for wanted in ("fx_px", "cy_px"):
        place = compared.names.index(wanted)
        numbers.append(f"{found['lens'][place]:.3f} ± {found['sigma'][place]:.3f}")
    picture, mirrors = compared.off_px[name]
    seconds = f"{found['seconds']:.1f}" + (", with model selection" if name == OWN else "")
    off = (f"{picture:.4f}", "" if mirrors is None else f"{mirrors:.4f}")
    return (f"{found['corners']:,}", "{:.4f} / {:.4f}".format(*found["rms_px"]), *numbers, *off, seconds)


def known_of(folder: Path) -> dict[str, Any]:
    """The true calibration of a set, empty where it is not known."""
    path = folder / "truth" / "truth.json"
    if not path.exists():
        return {}
    truth = json.loads(path.read_text())
    lens = [*truth["K"], *truth["D"]]
    return {"truth": {"lens": lens} | ({} if truth["sheet"] else {"cameras": cameras_m(np.array(truth["C"]))})}


def compare(corners: Path, folder: Path, judge: str) -> Compared:
    """Calibrate by both and print the figures."""
    layout, target = Layout.load(folder / "layout.json"), load_board(folder / "board.toml")
    if isinstance(target, AprilGrid):
        raise InputError(f"{folder / 'board.toml'}: an AprilGrid, expected a board of even squares, as mrcal has them")
    started = time.perf_counter()
    found = calibrate_files(
        CalibrationRequest(board=folder / "board.toml", corners=(corners,), layout=folder / "layout.json")
    )
    ours = figures_of(found, time.perf_counter() - started)
    if found.layout.camera.lens_model not in LENSES:
        raise InputError(f"{folder}: a {found.layout.camera.lens_model} lens, expected one of {', '.join(LENSES)}")
    if found.layout.mirrors[0].is_second_surface:
        del ours["cameras"]  # behind glass, no place of a camera is exact
    truth = known_of(folder)
    task = task_of(corners, layout, target) | {
        "lens": LENSES[found.layout.camera.lens_model],
        "calibrations": truth | {OWN: ours},
    }
    answer = asked(judge, task)
    print(f"{folder.name}: {len(task['corners'])} corners")
    print_table({OWN: ours} | answer["found"], found, truth)
    for each in answer["differences"]:
        device = "" if each["device_px"] is None else f", in all mirrors {each['device_px']:.4f} px"
        print(f"  {each['of'][1]} from {each['of'][0]}: over the picture {each['lens_px']:.4f} px{device}")
    return Compared(
        board={"charuco": "ChArUco"}.get(target.kind, target.kind),
        corners=len(task["corners"]),
        calibrations={OWN: ours} | answer["found"],
        names=tuple(found.layout.camera.intrinsic_names),
        truth=truth,
        off_px={
            each["of"][1]: (each["lens_px"], each["device_px"])
            for each in answer["differences"]
            if each["of"][0] == "truth"
        },
    )


def asked(python: str, task: dict[str, Any]) -> dict[str, Any]:
    """What the solver answers in another interpreter."""
    with tempfile.TemporaryDirectory() as kept:
        given, answer = Path(kept) / "task.json", Path(kept) / "answer.json"
        given.write_text(json.dumps(task))
        subprocess.run([python, str(SOLVER), str(given), str(answer)], check=True)
        return dict(json.loads(answer.read_text()))


def print_table(calibrations: dict[str, dict[str, Any]], found: Calibration, truth: dict[str, Any]) -> None:
    """Print residuals, seconds and lens of each calibration."""
    print(f"  {'':8} " + "".join(f"{name:36}" for name in calibrations) + ("truth" if truth else ""))
    lines: dict[str, Callable[[dict[str, Any]], str]] = {
        "rms px": lambda each: "{:.4f} / {:.4f}".format(*each["rms_px"]),
        "corners": lambda each: str(each["corners"]),
        "seconds": lambda each: f"{each['seconds']:.1f}",
    }
    for name, text in lines.items():
        print(f"  {name:8} " + "".join(f"{text(each):36}" for each in calibrations.values()))
    names = [name.removesuffix("_px") for name in found.layout.camera.intrinsic_names]
    same = truth and len(names) == len(LENS)
    print_lens(names, calibrations, truth["truth"]["lens"] if same else None)


if __name__ == "__main__":
    sys.exit(main())
