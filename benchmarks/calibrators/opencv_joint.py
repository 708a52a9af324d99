"""All mirrors as one rig with one lens, by bundle adjustment: `python -m benchmarks.calibrators.opencv_joint SET OUT`.

What an experienced user does: the lens is the same via all mirrors, and the views are fixed to each other. OpenCV
detects corners, starts with `solvePnP`, and projects with derivatives; least squares are solved here. The model does
not use that cameras which are reflections of one camera have fewer degrees of freedom. Writes OUT, a FileStorage in
YAML, and the covariance for NEES: `covariance/NAME.json` in the same folder, or `--covariance FILE`.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from scipy.linalg import solve
from scipy.spatial.transform import Rotation

from benchmarks.calibrators.command_line import run
from benchmarks.calibrators.set_corners import SetCorners, corners_of_set
from benchmarks.calibrators.view_poses import OpencvCamera, mean_pose, view_from_reference, write_cameras
from mirrorcam.core.disk.files import write_json
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.transforms import inverse, rigid

LENS = ("fx_px", "fy_px", "cx_px", "cy_px", "k1", "k2", "p1", "p2")
"""Estimated lens parameters; k3 stays zero."""
POSE = ("rx_rad", "ry_rad", "rz_rad", "tx_mm", "ty_mm", "tz_mm")
HUBER_PX = 0.5
MAX_STEPS, CONVERGED = 60, 1e-9


@dataclass(frozen=True)
class Rows:
    """All corners: frame (n,), view (n,), point (n, 3) on the board in mm, and pixel (n, 2)."""

    frame: FloatArray
    view: FloatArray
    points: FloatArray
    pixels: FloatArray


@dataclass(frozen=True)
class Bundle:
    """A lens (8,), and poses (4, 4) of views relative to the reference view, and of each frame's board in that view."""

    lens: FloatArray
    views: FloatArray
    frames: FloatArray

    @property
    def matrix(self) -> FloatArray:
        """Camera matrix."""
        fx, fy, cx, cy = self.lens[:4]
        return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])

    @property
    def distortion(self) -> FloatArray:
        """k1, k2, p1, p2, k3."""
        return np.append(self.lens[4:], 0.0)

    def stepped(self, step: FloatArray, reference: int) -> Bundle:
        """Return the bundle after a step of the lens, the views but the reference, and the frames."""
        others = [view for view in range(len(self.views)) if view != reference]
        views, frames, column = self.views.copy(), self.frames.copy(), len(LENS)
        for poses, numbers in ((views, others), (frames, range(len(frames)))):
            for number in numbers:
                rotation = Rotation.from_rotvec(step[column : column + 3]).as_matrix()
                poses[number] = rigid(rotation, step[column + 3 : column + 6]) @ poses[number]
                column += 6
        return Bundle(self.lens + step[: len(LENS)], views, frames)


def calibrate_joint(corners: SetCorners) -> tuple[tuple[OpencvCamera, ...], tuple[str, ...], FloatArray]:
    """Return the cameras, and the names and covariance of their parameters."""
    bundle, reference, rows = start(corners)
    damping = 1e-3
    cost = _cost(bundle, rows)
    for _ in range(MAX_STEPS):
        normal, right = _normal_equations(bundle, rows, reference)
        step = solve(normal + damping * np.diag(np.diag(normal)), right, assume_a="pos")
        candidate = bundle.stepped(step, reference)
        new_cost = _cost(candidate, rows)
        if new_cost < cost:
            converged = cost - new_cost < CONVERGED * cost
            bundle, cost, damping = candidate, new_cost, max(damping / 10.0, 1e-12)
            if converged:
                break
        else:
            damping *= 10.0
    names, covariance = _covariance(bundle, rows, reference, corners.names)
    cameras = tuple(
        OpencvCamera(name, bundle.matrix, bundle.distortion, pose)
        for name, pose in zip(corners.names, bundle.views, strict=True)
    )
    return cameras, names, covariance


def start(corners: SetCorners) -> tuple[Bundle, int, Rows]:
    """Return the initial bundle, from `solvePnP` with the lens of the data sheet; the reference view; all corners."""
    poses = {}
    for (frame, view), board in corners.seen.items():
        points = corners.points_in_board[board.corner]
        is_solved, rotation, shift = cv2.solvePnP(points, board.pixels, corners.matrix, np.zeros(5))
        if is_solved:
            poses[frame, view] = rigid(cv2.Rodrigues(rotation)[0], np.ravel(shift))
    reference, views = view_from_reference(poses, len(corners.names))
    frames = sorted({frame for frame, _ in poses})
    boards = [
        mean_pose(np.array([inverse(views[view]) @ pose for (number, view), pose in poses.items() if number == frame]))
        for frame in frames
    ]
    frame_index = {frame: number for number, frame in enumerate(frames)}
    boards_used = [(key, board) for key, board in corners.seen.items() if key in poses]
    rows = Rows(
        np.concatenate([np.full(len(board.corner), frame_index[frame]) for (frame, _), board in boards_used]),
        np.concatenate([np.full(len(board.corner), view) for (_, view), board in boards_used]),
        np.concatenate([corners.points_in_board[board.corner] for _, board in boards_used]),
        np.concatenate([board.pixels for _, board in boards_used]),
    )
    core = corners.matrix[[0, 1, 0, 1], [0, 1, 2, 2]]
    return Bundle(np.concatenate([core, np.zeros(4)]), np.array(views), np.array(boards)), reference, rows


def _in_views(bundle: Bundle, rows: Rows) -> tuple[FloatArray, FloatArray]:
    """Return points (n, 3) in the reference view and in their views."""
    frames, views = bundle.frames[rows.frame], bundle.views[rows.view]
    in_reference = np.einsum("nij,nj->ni", frames[:, :3, :3], rows.points) + frames[:, :3, 3]
    return in_reference, np.einsum("nij,nj->ni", views[:, :3, :3], in_reference) + views[:, :3, 3]


def _residuals(bundle: Bundle, rows: Rows) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return observed minus projected pixels (n, 2), and gradients of the latter: points (n, 2, 3), lens (n, 2, 8)."""
    _, points = _in_views(bundle, rows)
    zero = np.zeros(3)
    projected, jacobian = cv2.projectPoints(points, zero, zero, bundle.matrix, bundle.distortion)
    d_all: FloatArray = np.asarray(jacobian, dtype=np.float64).reshape(len(points), 2, -1)
    return rows.pixels - np.reshape(projected, (-1, 2)), d_all[:, :, 3:6], d_all[:, :, 6 : 6 + len(LENS)]


def _cost(bundle: Bundle, rows: Rows) -> float:
    length = np.linalg.norm(_residuals(bundle, rows)[0], axis=1)
    return float(np.where(length < HUBER_PX, length**2, HUBER_PX * (2.0 * length - HUBER_PX)).sum())


def _weights(residuals: FloatArray) -> FloatArray:
    return np.minimum(1.0, HUBER_PX / np.maximum(np.linalg.norm(residuals, axis=1), 1e-12))


def _normal_equations(bundle: Bundle, rows: Rows, reference: int) -> tuple[FloatArray, FloatArray]:
    """The matrix and the right side of weighted least squares."""
    residuals, d_point, d_lens = _residuals(bundle, rows)
    weight = _weights(residuals)[:, None, None]
    in_reference, in_view = _in_views(bundle, rows)
    d_reference = d_point @ bundle.views[rows.view][:, :3, :3]
    d_view = np.concatenate([np.cross(in_view[:, None], d_point), d_point], axis=2)
    d_frame = np.concatenate([np.cross(in_reference[:, None], d_reference), d_reference], axis=2)
    count, others = len(LENS), len(bundle.views) - 1
    size = count + 6 * (others + len(bundle.frames))
    normal, right = np.zeros((size, size)), np.zeros(size)
    for view in range(len(bundle.views)):
        for frame in range(len(bundle.frames)):
            mask = (rows.view == view) & (rows.frame == frame)
            if not mask.any():
                continue
            indices, columns = [np.arange(count)], [d_lens[mask]]
            if view != reference:
                indices.append(count + 6 * (view - (view > reference)) + np.arange(6))
                columns.append(d_view[mask])
            indices.append(count + 6 * (others + frame) + np.arange(6))
            columns.append(d_frame[mask])
            index, column = np.concatenate(indices), np.concatenate(columns, axis=2)
            normal[np.ix_(index, index)] += np.einsum("nki,nkj->ij", weight[mask] * column, column)
            right[index] += np.einsum("nki,nk->i", weight[mask] * column, residuals[mask])
    return normal, right


def _covariance(
    bundle: Bundle, rows: Rows, reference: int, views: tuple[str, ...]
) -> tuple[tuple[str, ...], FloatArray]:
    """Return the names and covariance of the cameras' parameters, from the scatter of the residuals."""
    normal, _ = _normal_equations(bundle, rows, reference)
    residuals = _residuals(bundle, rows)[0]
    weight = _weights(residuals)
    variance = float((weight[:, None] * residuals**2).sum() / (2.0 * weight.sum() - len(normal)))
    count = len(LENS) + 6 * (len(views) - 1)
    others = [name for number, name in enumerate(views) if number != reference]
    names = [f"all {name}" for name in LENS] + [f"{view} {name}" for view in others for name in POSE]
    return tuple(names), np.asarray(variance * np.linalg.inv(normal)[:count, :count], dtype=np.float64)


def calibrate_set(folder: Path, out: Path, covariance_file: Path | None = None) -> None:
    """Calibrate a set from its frames, nominal layout and board; write the cameras and their covariance."""
    corners = corners_of_set(folder)
    cameras, names, covariance = calibrate_joint(corners)
    write_cameras(out, cameras, corners.size_px, corners.flip)
    content = {"schema": "mirrorcam.covariance/1", "parameters": list(names), "covariance": covariance.tolist()}
    write_json(covariance_file or out.parent / "covariance" / f"{out.stem}.json", content)


if __name__ == "__main__":
    sys.exit(
        run(
            __doc__,
            lambda options: calibrate_set(options.set, options.out, options.covariance),
            lambda parser: parser.add_argument("--covariance", type=Path),
        )
    )
