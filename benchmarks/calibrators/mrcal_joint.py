"""All mirrors as cameras with one lens, by mrcal: `python -m benchmarks.calibrators.mrcal_joint SET OUT`.

OpenCV detects the corners, because mrcal has no detector of ChArUco boards, and estimates the initial poses: those that
mrcal estimates itself are far off if every camera shows only a corner of the picture. mrcal
(https://mrcal.secretsauce.net) solves for one lens and a free pose of each mirror, rejects outliers, and states the
covariance. It supports only equally spaced corners, so no AprilGrid. With `--spline` the lens is mrcal's splined
stereographic model, written for each view as the nearest lens of OpenCV's twelve numbers, without a covariance.
`--python PYTHON` is an interpreter with mrcal, by default the running one or the system's.
Writes OUT, a FileStorage in YAML, and with `--covariance FILE` the covariance of its parameters.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import cv2
import numpy as np
from scipy.linalg import block_diag
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from benchmarks.calibrators.command_line import run
from benchmarks.calibrators.opencv_joint import POSE, start
from benchmarks.calibrators.set_corners import SetCorners, corners_of_set
from benchmarks.calibrators.view_poses import OpencvCamera, write_cameras
from benchmarks.referees.mrcal_runner import LENSES, python_with_mrcal, run_solver
from mirrorcam.core.disk.files import write_json
from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.boards import load_board
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.transforms import inverse

LENS = ("fx_px", "fy_px", "cx_px", "cy_px", *("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"))
MM_PER_M = 1000.0
SPLINE, MARGIN = "LENSMODEL_SPLINED_STEREOGRAPHIC_order=3_Nx=16_Ny=10_fov_x_deg={fov_deg:.0f}", 1.15
"""The grid that mrcal's documentation uses for such a lens, over the field of view with a margin."""


def by_board_count(corners: SetCorners) -> list[int]:
    """Return the views, the one with the most boards first: mrcal's poses are relative to it."""
    views = [view for _, view in corners.seen]
    return sorted(range(len(corners.names)), key=lambda view: -views.count(view))


def task_of(corners: SetCorners, folder: Path, *, spline: bool) -> dict[str, object]:
    """Return the solver's task: board and corners, with cameras in the order of `by_board_count`."""
    layout, board = Layout.load(folder / "layout.json"), load_board(folder / "board.toml")
    lens = LENSES.get(layout.camera.lens_model)
    if lens is None:
        raise InputError(f"{folder}: a {layout.camera.lens_model} lens, expected one of {', '.join(LENSES)}")
    if spline:
        fov_deg = 2.0 * MARGIN * np.degrees(np.arctan(corners.size_px[0] / 2.0 / layout.camera.fx_px))
        lens = SPLINE.format(fov_deg=fov_deg)
    bundle, _, _ = start(corners)
    order = by_board_count(corners)
    reference = bundle.views[order[0]]
    camera = {view: number for number, view in enumerate(order)}
    frames = {frame: number for number, frame in enumerate(sorted({frame for frame, _ in corners.seen}))}
    cols, rows = board.corner_counts
    return {
        "width_px": corners.size_px[0],
        "height_px": corners.size_px[1],
        "focal_px": float(corners.matrix[0, 0]),
        "lens": lens,
        "start": {
            "core": bundle.lens[:4].tolist(),
            "cameras": [_in_m(bundle.views[view] @ inverse(reference)) for view in order[1:]],
            "poses": [_in_m(reference @ pose) for pose in bundle.frames],
        },
        "board": {"rows": rows, "cols": cols, "spacing_m": board.pitch_mm / MM_PER_M},
        "corners": [
            [frames[frame], camera[view], corner, x, y, 1.0]
            for (frame, view), detected in sorted(corners.seen.items())
            for corner, (x, y) in zip(detected.corner.tolist(), detected.pixels.tolist(), strict=True)
        ],
    }


def _in_m(pose: FloatArray) -> list[list[float]]:
    scaled = pose.copy()
    scaled[:3, 3] /= MM_PER_M
    return scaled.tolist()


def left_jacobian(rotation: FloatArray) -> FloatArray:
    """Return the left Jacobian J (3, 3) of a rotation vector r (3,): exp(J dr) exp(r) = exp(r + dr)."""
    cross = _cross(rotation)
    angle = float(np.linalg.norm(rotation))
    if angle < 1e-6:
        return np.eye(3) + cross / 2.0
    return (
        np.eye(3)
        + (1.0 - np.cos(angle)) / angle**2 * cross
        + (angle - np.sin(angle)) / angle**3 * np.asarray(cross @ cross)
    )


def _cross(vector: FloatArray) -> FloatArray:
    """Return the matrix (3, 3) of the cross product with a vector (3,) on the left."""
    x, y, z = vector
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def covariance_of(covariance: FloatArray, poses: FloatArray, lens: int) -> FloatArray:
    """Convert mrcal's covariance of a lens and of poses (n, 4, 4) but the first, m, to the one that is scored.

    The scored one is of a rotation of points in a camera's frame about its origin, followed by a shift. A change of
    mrcal's rotation vector leaves its translation unchanged, so the equivalent shift compensates the rotation.
    """
    blocks = [np.eye(lens)]
    for pose in poses[1:]:
        d_rotation = left_jacobian(Rotation.from_matrix(pose[:3, :3]).as_rotvec())
        d_shift = MM_PER_M * np.hstack([_cross(pose[:3, 3]) @ d_rotation, np.eye(3)])
        blocks.append(np.vstack([np.hstack([d_rotation, np.zeros((3, 3))]), d_shift]))
    jacobian = block_diag(*blocks)
    return np.asarray(jacobian @ covariance @ jacobian.T)


def nearest_lens(rays: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return matrix (3, 3) and twelve coefficients of the OpenCV lens nearest to pixels and their rays (n, 4)."""
    pixels, points = rays[:, :2], np.column_stack([rays[:, 2:], np.ones(len(rays))])
    focal, centre = np.polyfit(rays[:, 2], pixels[:, 0], 1)[0], pixels.mean(axis=0)

    def matrix(lens: FloatArray) -> FloatArray:
        return np.array([[lens[0], 0.0, lens[2]], [0.0, lens[1], lens[3]], [0.0, 0.0, 1.0]])

    def errors(lens: FloatArray) -> FloatArray:
        projected = cv2.projectPoints(points, np.zeros(3), np.zeros(3), matrix(lens), lens[4:])[0]
        return np.asarray(projected[:, 0] - pixels).ravel()

    first = np.array([focal, focal, *(centre - focal * rays[:, 2:].mean(axis=0)), *np.zeros(12)])
    lens = least_squares(errors, first, x_scale="jac", max_nfev=500).x
    print(f"nearest lens: {np.sqrt(np.mean(errors(lens) ** 2)):.2g} px RMS from the spline")
    return matrix(lens), lens[4:]


def calibrate_set(
    folder: Path, out: Path, python: str, covariance_file: Path | None = None, *, spline: bool = False
) -> None:
    """Calibrate a set from its frames, nominal layout and board; write cameras and, if requested, their covariance."""
    corners = corners_of_set(folder)
    solution = run_solver(python, task_of(corners, folder, spline=spline))["found"]["mrcal"]
    lens, poses, order = np.array(solution["lens"]), np.array(solution["cameras"]), by_board_count(corners)
    fx, fy, cx, cy = lens[:4]
    one_lens = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]]), lens[4:]
    lenses = [nearest_lens(np.array(rays)) for rays in solution["rays"]] if spline else [one_lens] * len(order)
    in_mm = poses.copy()
    in_mm[:, :3, 3] *= MM_PER_M
    cameras = {}
    for number, view in enumerate(order):
        matrix, distortion = lenses[number]
        cameras[view] = OpencvCamera(corners.names[view], matrix, distortion, in_mm[number])
    write_cameras(out, [cameras[view] for view in range(len(order))], corners.size_px, corners.flip)
    if covariance_file is not None:
        names = [f"all {name}" for name in LENS[: len(lens)]]
        names += [f"{corners.names[view]} {name}" for view in order[1:] for name in POSE]
        covariance = covariance_of(np.array(solution["covariance"]), poses, len(lens))
        content = {"schema": "mirrorcam.covariance/1", "parameters": names, "covariance": covariance.tolist()}
        write_json(covariance_file, content)


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options besides SET OUT."""
    group = parser.add_mutually_exclusive_group()
    group.add_argument("--covariance", type=Path)
    group.add_argument("--spline", action="store_true")
    parser.add_argument("--python")


def calibrate(options: argparse.Namespace) -> None:
    """Calibrate according to the options; raises InputError if no interpreter has mrcal."""
    python = python_with_mrcal(options.python)
    if python is None:
        where = options.python or "this or the system python3"
        raise InputError(f"mrcal: not installed in {where}; --python PYTHON states a different one")
    calibrate_set(options.set, options.out, python, options.covariance, spline=options.spline)


if __name__ == "__main__":
    sys.exit(run(__doc__, calibrate, add_options))
