"""All mirrors as cameras with one lens, by mrcal: `python -m benchmarks.calibrators.mrcal_joint SET OUT`.

OpenCV finds the corners, as mrcal has no detector of ChArUco boards, and the poses to start from: those that mrcal
finds by itself are far off where every camera shows a corner of the picture alone. mrcal (https://mrcal.secretsauce.net)
solves for one lens and a free place of each mirror, leaves out outliers, and says how certain it is. It knows boards of
even squares alone, so no AprilGrid. `--python PYTHON` has mrcal, by default the running one or that of the system.
Writes OUT, a FileStorage in YAML, and with `--covariance FILE` the covariance of its parameters.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np
from scipy.linalg import block_diag
from scipy.spatial.transform import Rotation

from benchmarks.calibrators.command_line import run
from benchmarks.calibrators.opencv_joint import POSE, start
from benchmarks.calibrators.set_corners import SetCorners, corners_of_set
from benchmarks.calibrators.view_poses import OpencvCamera, write_cameras
from benchmarks.referees.mrcal_runner import LENSES, asked, python_with_mrcal
from mirrorcam.core.disk.files import write_json
from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.targets import load_board
from mirrorcam.optics.geometry.transforms import inverse

LENS = ("fx_px", "fy_px", "cx_px", "cy_px", *("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"))
MM_PER_M = 1000.0


def by_boards(corners: SetCorners) -> list[int]:
    """The views, that with most boards first: mrcal refers all places to it."""
    views = [view for _, view in corners.seen]
    return sorted(range(len(corners.names)), key=lambda view: -views.count(view))


def task_of(corners: SetCorners, folder: Path) -> dict[str, object]:
    """Board and corners as the solver takes them, cameras in the order of `by_boards`."""
    layout, target = Layout.load(folder / "layout.json"), load_board(folder / "board.toml")
    lens = LENSES.get(layout.camera.lens_model)
    if lens is None:
        raise InputError(f"{folder}: a {layout.camera.lens_model} lens, expected one of {', '.join(LENSES)}")
    bundle, _, _ = start(corners)
    order = by_boards(corners)
    reference = bundle.views[order[0]]
    camera = {view: number for number, view in enumerate(order)}
    frames = {frame: number for number, frame in enumerate(sorted({frame for frame, _ in corners.seen}))}
    cols, along = target.corner_counts
    return {
        "width_px": corners.size_px[0],
        "height_px": corners.size_px[1],
        "focal_px": float(corners.matrix[0, 0]),
        "lens": lens,
        "start": {
            "core": bundle.lens[:4].tolist(),
            "places": [_in_m(bundle.views[view] @ inverse(reference)) for view in order[1:]],
            "poses": [_in_m(reference @ pose) for pose in bundle.frames],
        },
        "board": {"rows": along, "cols": cols, "spacing_m": target.pitch_mm / MM_PER_M},
        "corners": [
            [frames[frame], camera[view], corner, x, y, 1.0]
            for (frame, view), board in sorted(corners.seen.items())
            for corner, (x, y) in zip(board.corner.tolist(), board.pixels.tolist(), strict=True)
        ],
    }


def _in_m(pose: FloatArray) -> list[list[float]]:
    moved = pose.copy()
    moved[:3, 3] /= MM_PER_M
    return moved.tolist()


def left_jacobian(turn: FloatArray) -> FloatArray:
    """The turn on the left (3, 3) for each change of a Rodrigues vector (3,): exp(J dr) exp(r) = exp(r + dr)."""
    across = _cross(turn)
    angle = float(np.linalg.norm(turn))
    if angle < 1e-6:
        return np.eye(3) + across / 2.0
    return (
        np.eye(3)
        + (1.0 - np.cos(angle)) / angle**2 * across
        + (angle - np.sin(angle)) / angle**3 * np.asarray(across @ across)
    )


def _cross(vector: FloatArray) -> FloatArray:
    """The matrix (3, 3) of the cross product with a vector (3,) on the left."""
    x, y, z = vector
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def covariance_of(covariance: FloatArray, places: FloatArray, lens: int) -> FloatArray:
    """mrcal's covariance of a lens and places (n, 4, 4) but the first, m, as a covariance that is scored has it.

    There, points in a camera's frame are turned about its origin, then shifted: where a Rodrigues vector changes, the
    shift in mrcal's place, which stays, is what turns with it less that.
    """
    slopes = [np.eye(lens)]
    for place in places[1:]:
        turned = left_jacobian(Rotation.from_matrix(place[:3, :3]).as_rotvec())
        shifted = MM_PER_M * np.hstack([_cross(place[:3, 3]) @ turned, np.eye(3)])
        slopes.append(np.vstack([np.hstack([turned, np.zeros((3, 3))]), shifted]))
    slope = block_diag(*slopes)
    return np.asarray(slope @ covariance @ slope.T)


def calibrate_set(folder: Path, out: Path, python: str, covariance_file: Path | None = None) -> None:
    """Calibrate a set from its frames, nominal layout and board; write cameras, and their covariance where asked."""
    corners = corners_of_set(folder)
    found = asked(python, task_of(corners, folder))["found"]["mrcal"]
    lens, places, order = np.array(found["lens"]), np.array(found["cameras"]), by_boards(corners)
    fx, fy, cx, cy = lens[:4]
    matrix = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
    in_mm = places.copy()
    in_mm[:, :3, 3] *= MM_PER_M
    cameras = {view: OpencvCamera(corners.names[view], matrix, lens[4:], in_mm[at]) for at, view in enumerate(order)}
    write_cameras(out, [cameras[view] for view in range(len(order))], corners.size_px, corners.flip)
    if covariance_file is not None:
        names = [f"all {name}" for name in LENS[: len(lens)]]
        names += [f"{corners.names[view]} {name}" for view in order[1:] for name in POSE]
        covariance = covariance_of(np.array(found["covariance"]), places, len(lens))
        stated = {"schema": "mirrorcam.covariance/1", "parameters": names, "covariance": covariance.tolist()}
        write_json(covariance_file, stated)


def add_options(parser: argparse.ArgumentParser) -> None:
    """Options beside SET OUT."""
    parser.add_argument("--covariance", type=Path)
    parser.add_argument("--python")


def calibrate(options: argparse.Namespace) -> None:
    """Calibrate as the command line asks; raises InputError where no interpreter has mrcal."""
    python = python_with_mrcal(options.python)
    if python is None:
        where = options.python or "this or the system python3"
        raise InputError(f"mrcal: not there in {where}; --python PYTHON names another")
    calibrate_set(options.set, options.out, python, options.covariance)


if __name__ == "__main__":
    sys.exit(run(__doc__, calibrate, add_options))
