"""Calibration from labels: `python -m benchmarks.labels [--arena FOLDER] [--mouse CSV]`.

Simulated labels of an animal (noise 1 px, 10 % wrong, 5 % swapped) in 2 to 4 mirrors, 20 sets each, with a known camera
and with a data sheet: NEES (1 if the covariance is right), error relative to the Cramer-Rao bound of the correct
labels, and processor time.

`--arena`: eight corners of an arena, in a direct view and four mirrors (iurillilab/3d-setup): `arena_views.h5` and
`arena_views_triangulated.h5`. Its crops are placed by the pipeline's own defaults. `--mouse`: labels of
lightning-pose's example mirror-mouse, CollectedData.csv.
"""

from __future__ import annotations

import argparse
import time
from itertools import pairwise
from pathlib import Path

import numpy as np
from scipy.io import netcdf_file

from benchmarks.records import Rows, add_json_option, write_record
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.diagnostics.verdict import STATES
from mirrorcam.optics.calibration.labels.label_calibration import unknown_camera
from mirrorcam.optics.calibration.labels.label_files import read_labels
from mirrorcam.optics.calibration.labels.label_result import LabelCalibration, calibrate_labels
from mirrorcam.optics.calibration.labels.label_table import LabelTable
from mirrorcam.optics.calibration.labels.label_verdict import label_verdict
from mirrorcam.optics.calibration.labels.point_adjustment import CameraPrior
from mirrorcam.optics.calibration.solver.observations import DIRECT
from tests.optics.calibration.labels.label_errors import pooled
from tests.optics.calibration.labels.simulated_labels import CAMERA, SHEET, sheet_camera, simulated

SETS = 20
ARENA_VIEWS = ("central", "mirror-top", "mirror-bottom", "mirror-left", "mirror-right")
ARENA_PX = (1104, 1104)
RIM = (0, 1, 2, 3, 0)


def in_frame(view: str, pixels: FloatArray) -> FloatArray:
    """Map pixels (n, 2) of the arena's crops, which its pipeline flips and rotates, to the frame of the camera."""
    u, v = pixels.T
    columns = {
        "central": (246 + u, 238 + v),
        "mirror-top": (246 + u, 18 + 219 - v),
        "mirror-bottom": (246 + 607 - u, 858 + v),
        "mirror-left": (28 + 223 - v, 238 + 623 - u),
        "mirror-right": (854 + v, 237 + u),
    }
    return np.stack(columns[view], axis=1)


def arena_labels(folder: Path) -> LabelTable:
    """The corners of the arena in all views."""
    with netcdf_file(folder / "arena_views.h5", mmap=False) as file:
        names = [b"".join(row).decode().strip("\0 ") for row in file.variables["view"].data]
        positions = np.array(file.variables["position"].data, dtype=np.float64)[:, 0, :, :, 0]
    pixels = [in_frame(view, positions[names.index(view)].T) for view in ARENA_VIEWS]
    count = len(pixels[0])
    return LabelTable(
        frames=("0",),
        labels=tuple(map(str, range(count))),
        views=ARENA_VIEWS,
        frame=np.zeros(count * len(pixels), dtype=np.int64),
        view=np.repeat(np.arange(len(pixels)), count) + DIRECT,
        label=np.tile(np.arange(count), len(pixels)),
        pixels=np.concatenate(pixels),
    )


def shape(points: FloatArray) -> str:
    """Height and largest side of the arena's rim, relative to the mean side."""
    sides = [float(np.linalg.norm(points[a] - points[b])) for a, b in pairwise(RIM)]
    height = float(np.mean(np.linalg.norm(points[:4] - points[4:], axis=1)))
    return f"height {height / np.mean(sides):.3f}, sides {min(sides) / np.mean(sides):.3f} to " + (
        f"{max(sides) / np.mean(sides):.3f} of the mean side"
    )


def described(result: LabelCalibration) -> str:
    """The figures of a calibration in a line, and its verdict with reasons."""
    metrics, verdict, camera = result.calibration.metrics, label_verdict(result), result.layout.camera
    normals = ", ".join(str(mirror.normal_in_rig.round(3).tolist()) for mirror in result.layout.mirrors)
    turns = np.abs(result.free.turn_deg / np.where(np.isfinite(result.free.sigma_deg), result.free.sigma_deg, np.inf))
    return (
        f"{metrics['labels'].value:.0f} labels agree, {len(result.rejected)} do not, noise "
        f"{metrics['label_sigma_px'].value:.2f} px, fx {camera.fx_px:.0f} px, normals {normals}; mirrors as free "
        f"cameras turn by up to {metrics['free_mirrors_turn_deg'].value:.2g} deg ({turns.max():.1f} sigmas); "
        f"{STATES[verdict.state]}: {'; '.join(verdict.reasons) or 'no reasons against'}"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--arena", type=Path, metavar="FOLDER", help="data of the arena")
    parser.add_argument("--mouse", type=Path, metavar="CSV", help="labels of mirror-mouse")
    add_json_option(parser)
    arguments = parser.parse_args()
    rows = Rows("camera", "mirrors", "NEES", "error / bound", "s per set")
    for name, prior in (("known", None), ("data sheet, 2 %", SHEET)):
        for mirrors in (2, 3, 4):
            cameras = [CAMERA if prior is None else sheet_camera(seed) for seed in range(SETS)]
            sets = [
                (simulated(seed, mirrors=mirrors, camera=camera), prior or CameraPrior.known(camera))
                for seed, camera in enumerate(cameras)
            ]
            started = time.process_time()
            nees, to_bound = pooled(sets)
            seconds = (time.process_time() - started) / SETS
            rows.add(name, str(mirrors), f"{nees:.2f}", f"{to_bound:.2f}", f"{seconds:.2f}")
    write_record(arguments.json, "labels", table=rows.table)
    if arguments.arena is not None:
        result = calibrate_labels(arena_labels(arguments.arena), unknown_camera(*ARENA_PX))
        print(f"arena: {described(result)}; {shape(result.points.positions)}")
        with netcdf_file(arguments.arena / "arena_views_triangulated.h5", mmap=False) as file:
            theirs = np.array(file.variables["position"].data, dtype=np.float64)[0, :, :, 0].T
        print(f"arena, mirrors as free cameras (anipose): {shape(theirs)}")
    if arguments.mouse is not None:
        table = read_labels([arguments.mouse], ("top", "bot"))
        print(f"mouse: {described(calibrate_labels(table, unknown_camera(396, 406)))}")


if __name__ == "__main__":
    main()
