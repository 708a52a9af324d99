"""All mirrors as one rig with one lens, by bundle adjustment: `python -m benchmarks.calibrators.opencv_joint SET OUT`.

What a user who knows better does: the lens is the same behind all mirrors, and the views are fixed to each other.
OpenCV detects, starts with `solvePnP`, and projects with derivatives; the least squares are here. It does not know that
cameras which are reflections of one have fewer degrees of freedom. Writes OUT, a FileStorage in YAML, and the
covariance for NEES: `covariance/NAME.json` beside it, or `--covariance FILE`.
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
"""What is estimated of the lens; k3 stays zero."""
POSE = ("rx_rad", "ry_rad", "rz_rad", "tx_mm", "ty_mm", "tz_mm")
HUBER_PX = 0.5
MOST_STEPS, STEADY = 60, 1e-9


@dataclass(frozen=True)
class Rows:
    """All corners: frame (n,), view (n,), point (n, 3) on the board in mm, and pixel (n, 2)."""

    frame: FloatArray
    view: FloatArray
    points: FloatArray
    pixels: FloatArray


@dataclass(frozen=True)
class Bundle:
    """A lens (8,), the pose (4, 4) of each view after the reference, and that of the board in each frame before it."""

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

    def moved(self, step: FloatArray, reference: int) -> Bundle:
        """The bundle after a step: of the lens, of views but the reference, of frames."""
        others = [view for view in range(len(self.views)) if view != reference]
        views, frames, at = self.views.copy(), self.frames.copy(), len(LENS)
        for poses, numbers in ((views, others), (frames, range(len(frames)))):
            for number in numbers:
                turn = Rotation.from_rotvec(step[at : at + 3]).as_matrix()
                poses[number] = rigid(turn, step[at + 3 : at + 6]) @ poses[number]
                at += 6
        return Bundle(self.lens + step[: len(LENS)], views, frames)


def calibrate_joint(corners: SetCorners) -> tuple[tuple[OpencvCamera, ...], tuple[str, ...], FloatArray]:
    """The cameras, and the names and covariance of their parameters."""
    bundle, reference, rows = start(corners)
    damping = 1e-3
    cost = _cost(bundle, rows)
    for _ in range(MOST_STEPS):
        normal, right = _normal_equations(bundle, rows, reference)
        step = solve(normal + damping * np.diag(np.diag(normal)), right, assume_a="pos")
        tried = bundle.moved(step, reference)
        new_cost = _cost(tried, rows)
        if new_cost < cost:
            done = cost - new_cost < STEADY * cost
            bundle, cost, damping = tried, new_cost, max(damping / 10.0, 1e-12)
            if done:
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
    """The bundle that poses by `solvePnP` make with the lens of the data sheet, the reference view, and all corners."""
    poses = {}
    for (frame, view), board in corners.seen.items():
        points = corners.points_in_board[board.corner]
        found, turn, shift = cv2.solvePnP(points, board.pixels, corners.matrix, np.zeros(5))
        if found:
            poses[frame, view] = rigid(cv2.Rodrigues(turn)[0], np.ravel(shift))
    reference, views = view_from_reference(poses, len(corners.names))
    frames = sorted({frame for frame, _ in poses})
    boards = [
        mean_pose(np.array([inverse(views[view]) @ pose for (at, view), pose in poses.items() if at == frame]))
        for frame in frames
    ]
    place = {frame: number for number, frame in enumerate(frames)}
    seen = [(key, board) for key, board in corners.seen.items() if key in poses]
    rows = Rows(
        np.concatenate([np.full(len(board.corner), place[frame]) for (frame, _), board in seen]),
        np.concatenate([np.full(len(board.corner), view) for (_, view), board in seen]),
        np.concatenate([corners.points_in_board[board.corner] for _, board in seen]),
        np.concatenate([board.pixels for _, board in seen]),
    )
    core = corners.matrix[[0, 1, 0, 1], [0, 1, 2, 2]]
    return Bundle(np.concatenate([core, np.zeros(4)]), np.array(views), np.array(boards)), reference, rows


def _in_views(bundle: Bundle, rows: Rows) -> tuple[FloatArray, FloatArray]:
    """Points (n, 3) in the reference and in their views."""
    at, then = bundle.frames[rows.frame], bundle.views[rows.view]
    in_reference = np.einsum("nij,nj->ni", at[:, :3, :3], rows.points) + at[:, :3, 3]
    return in_reference, np.einsum("nij,nj->ni", then[:, :3, :3], in_reference) + then[:, :3, 3]


def _residuals(bundle: Bundle, rows: Rows) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Found minus projected pixels (n, 2), and derivatives of these by points (n, 2, 3) and by the lens (n, 2, 8)."""
    _, points = _in_views(bundle, rows)
    zero = np.zeros(3)
    shown, slopes = cv2.projectPoints(points, zero, zero, bundle.matrix, bundle.distortion)
    by_all: FloatArray = np.asarray(slopes, dtype=np.float64).reshape(len(points), 2, -1)
    return rows.pixels - np.reshape(shown, (-1, 2)), by_all[:, :, 3:6], by_all[:, :, 6 : 6 + len(LENS)]


def _cost(bundle: Bundle, rows: Rows) -> float:
    length = np.linalg.norm(_residuals(bundle, rows)[0], axis=1)
    return float(np.where(length < HUBER_PX, length**2, HUBER_PX * (2.0 * length - HUBER_PX)).sum())


def _weights(off: FloatArray) -> FloatArray:
    return np.minimum(1.0, HUBER_PX / np.maximum(np.linalg.norm(off, axis=1), 1e-12))


def _normal_equations(bundle: Bundle, rows: Rows, reference: int) -> tuple[FloatArray, FloatArray]:
    """The matrix and the right side of weighted least squares."""
    off, by_point, by_lens = _residuals(bundle, rows)
    weight = _weights(off)[:, None, None]
    in_reference, in_view = _in_views(bundle, rows)
    by_reference = by_point @ bundle.views[rows.view][:, :3, :3]
    by_view = np.concatenate([np.cross(in_view[:, None], by_point), by_point], axis=2)
    by_frame = np.concatenate([np.cross(in_reference[:, None], by_reference), by_reference], axis=2)
    count, others = len(LENS), len(bundle.views) - 1
    size = count + 6 * (others + len(bundle.frames))
    normal, right = np.zeros((size, size)), np.zeros(size)
    for view in range(len(bundle.views)):
        for frame in range(len(bundle.frames)):
            at = (rows.view == view) & (rows.frame == frame)
            if not at.any():
                continue
            places, columns = [np.arange(count)], [by_lens[at]]
            if view != reference:
                places.append(count + 6 * (view - (view > reference)) + np.arange(6))
                columns.append(by_view[at])
            places.append(count + 6 * (others + frame) + np.arange(6))
            columns.append(by_frame[at])
            place, column = np.concatenate(places), np.concatenate(columns, axis=2)
            normal[np.ix_(place, place)] += np.einsum("nki,nkj->ij", weight[at] * column, column)
            right[place] += np.einsum("nki,nk->i", weight[at] * column, off[at])
    return normal, right


def _covariance(
    bundle: Bundle, rows: Rows, reference: int, views: tuple[str, ...]
) -> tuple[tuple[str, ...], FloatArray]:
    """Names and covariance of the parameters of the cameras, from the scatter of the residuals."""
    normal, _ = _normal_equations(bundle, rows, reference)
    off = _residuals(bundle, rows)[0]
    weight = _weights(off)
    variance = float((weight[:, None] * off**2).sum() / (2.0 * weight.sum() - len(normal)))
    kept = len(LENS) + 6 * (len(views) - 1)
    others = [name for number, name in enumerate(views) if number != reference]
    names = [f"all {name}" for name in LENS] + [f"{view} {name}" for view in others for name in POSE]
    return tuple(names), np.asarray(variance * np.linalg.inv(normal)[:kept, :kept], dtype=np.float64)


def calibrate_set(folder: Path, out: Path, covariance_file: Path | None = None) -> None:
    """Calibrate a set from its frames, nominal layout and board; write the cameras and their covariance."""
    corners = corners_of_set(folder)
    cameras, names, covariance = calibrate_joint(corners)
    write_cameras(out, cameras, corners.size_px, corners.flip)
    stated = {"schema": "mirrorcam.covariance/1", "parameters": list(names), "covariance": covariance.tolist()}
    write_json(covariance_file or out.parent / "covariance" / f"{out.stem}.json", stated)


if __name__ == "__main__":
    sys.exit(
        run(
            __doc__,
            lambda given: calibrate_set(given.set, given.out, given.covariance),
            lambda parser: parser.add_argument("--covariance", type=Path),
        )
    )
