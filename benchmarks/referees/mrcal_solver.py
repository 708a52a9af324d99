"""Calibration of corners by mrcal: `PYTHON mrcal_solver.py IN.json OUT.json`.

Part of `benchmarks.calibration_mrcal`, and of `benchmarks.calibrators.mrcal_joint`, whose task has no calibrations.

Runs in any interpreter that has mrcal, and needs nothing of this project.

All views are one camera, in a different pose for each mirror: if the world is mirrored too, a reflection in front of a
camera is a rigid motion, and a flat board seen in a mirror is one seen from behind. The pose of the first mirror is the
reference. Boards without mirrors are separate frames, in that pose. Lengths are in metres, which suits mrcal's scaling.
"""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path
from typing import Any

import mrcal
import numpy as np
from scipy.optimize import least_squares

INITIAL_DISTORTION = 1e-6
RAYS = 20  # along each side of a view
MIN_CORNERS = 4  # of a board, to determine its pose
COMPLETE_RADIUS_PX = 1e6  # a radius that includes the complete picture


def boards(task: dict[str, Any], weighted: bool) -> tuple[Any, Any]:
    """Return boards (n, rows, cols, 3) of x, y and weight, and the frame and camera (n, 2) of each."""
    rows, cols = task["board"]["rows"], task["board"]["cols"]
    sigma = np.array([corner[5] for corner in task["corners"]])
    weights = np.median(sigma) / sigma if weighted else np.ones(len(sigma))
    by_key: dict[tuple[int, int], Any] = {}
    for (frame, camera, corner, x, y, _), weight in zip(task["corners"], weights.tolist(), strict=True):
        empty = np.full((rows, cols, 3), -1.0)
        by_key.setdefault((frame, camera), empty)[corner // cols, corner % cols] = x, y, weight
    keys = sorted(by_key)
    return np.array([by_key[key] for key in keys]), np.array(keys, dtype=np.int32)


def solve(task: dict[str, Any], weighted: bool) -> dict[str, Any]:
    """Optimise in the steps of `mrcal-calibrate-cameras`; return mrcal's inputs, which hold the result."""
    observations, keys = boards(task, weighted)
    cameras, size = int(keys[:, 1].max()) + 1, [task["width_px"], task["height_px"]]
    if start := task.get("start"):
        model, core = "LENSMODEL_PINHOLE", [np.array(start["core"])]
        cameras_rt, poses = (
            np.array([mrcal.rt_from_Rt(_rows(pose)) for pose in start[name]]) for name in ("cameras", "poses")
        )
    else:
        model = "LENSMODEL_STEREOGRAPHIC"
        core, cameras_rt, poses = mrcal.seed_stereographic(
            imagersizes=[size] * cameras,
            focal_estimate=task["focal_px"],
            indices_frame_camera=keys,
            observations=observations,
            object_spacing=task["board"]["spacing_m"],
        )
    inputs = {
        "intrinsics": np.array(core[:1]),
        "extrinsics_rt_fromref": cameras_rt,
        "frames_rt_toref": poses,
        "points": None,
        "observations_board": observations,
        "indices_frame_camintrinsics_camextrinsics": np.array(
            [(frame, 0, camera - 1) for frame, camera in keys], dtype=np.int32
        ),
        "observations_point": None,
        "indices_point_camintrinsics_camextrinsics": None,
        "lensmodel": model,
        "imagersizes": np.array([size], dtype=np.int32),
        "calibration_object_spacing": task["board"]["spacing_m"],
        "do_optimize_calobject_warp": False,
        "do_apply_outlier_rejection": False,
        "do_optimize_intrinsics_core": False,
        "do_optimize_intrinsics_distortions": False,
    }
    mrcal.optimize(**inputs)
    inputs["do_optimize_intrinsics_core"] = True
    mrcal.optimize(**inputs)
    spline = "SPLINED" in task["lens"]
    inputs["lensmodel"] = "LENSMODEL_OPENCV8" if spline else task["lens"]
    distortions = mrcal.lensmodel_num_params(inputs["lensmodel"]) - 4
    inputs["intrinsics"] = np.hstack([inputs["intrinsics"], np.full((1, distortions), INITIAL_DISTORTION)])
    inputs["do_optimize_intrinsics_distortions"] = True
    mrcal.optimize(**inputs)
    inputs["do_apply_outlier_rejection"] = True
    mrcal.optimize(**inputs)
    if drop_undetermined(inputs):
        inputs["do_apply_outlier_rejection"] = False
        mrcal.optimize(**inputs)
    if spline:
        optimize_spline(inputs, task["lens"])
    return inputs


def optimize_spline(inputs: dict[str, Any], model: str) -> None:
    """Replace the lens by a splined one: first with all poses fixed, then with everything free but its core."""
    controls = mrcal.lensmodel_num_params(model) - 4
    inputs["lensmodel"] = model
    inputs["intrinsics"] = np.hstack([inputs["intrinsics"][:, :4], np.zeros((1, controls))])
    inputs["do_apply_outlier_rejection"] = inputs["do_optimize_intrinsics_core"] = False
    for free in (False, True):
        mrcal.optimize(**inputs, do_optimize_extrinsics=free, do_optimize_frames=free)


def drop_undetermined(inputs: dict[str, Any]) -> bool:
    """Remove boards with too few remaining corners to determine a pose; return whether there were any."""
    is_inlier = inputs["observations_board"][..., 2] > 0.0
    kept = is_inlier.sum(axis=(1, 2)) >= MIN_CORNERS
    indices = inputs["indices_frame_camintrinsics_camextrinsics"][kept]
    frames, indices[:, 0] = np.unique(indices[:, 0], return_inverse=True)
    inputs["observations_board"] = np.ascontiguousarray(inputs["observations_board"][kept])
    inputs["indices_frame_camintrinsics_camextrinsics"] = np.ascontiguousarray(indices)
    inputs["frames_rt_toref"] = np.ascontiguousarray(inputs["frames_rt_toref"][frames])
    return not bool(kept.all())


def figures(inputs: dict[str, Any]) -> dict[str, Any]:
    """Return the lens with its standard deviations, the poses of the cameras, the covariance of both, and residuals.

    The covariance is of the lens, and of the rotation vector and the translation (m) of every camera but the first.
    """
    _, residuals, _, factorization = mrcal.optimizer_callback(**inputs)
    observations = inputs["observations_board"]
    weight = observations[..., 2].ravel()
    used = weight > 0.0
    scaled = np.reshape(residuals[: 2 * len(weight)], (-1, 2))[used]
    states = mrcal.num_states(**inputs)
    scale = np.sqrt(np.sum(scaled**2) / (scaled.size - states))
    lens = inputs["intrinsics"][0]
    free = mrcal.num_intrinsics_optimization_params(**inputs)
    count = free + inputs["extrinsics_rt_fromref"].size  # the first elements of the state
    packed = factorization.solve_xt_JtJ_bt(np.eye(count, states))[:, :count]
    scales = np.ones(states)
    mrcal.unpack_state(scales, **inputs)
    covariance = scale**2 * packed * np.outer(scales[:count], scales[:count])
    rigid = [np.eye(4), *(_matrix(mrcal.Rt_from_rt(pose)) for pose in inputs["extrinsics_rt_fromref"])]
    distances = [np.linalg.norm(pose[3:]) for pose in inputs["frames_rt_toref"]]
    return {
        "lens": lens.tolist(),
        "rays": rays(inputs) if "SPLINED" in inputs["lensmodel"] else [],
        "sigma": np.sqrt(np.diag(covariance)[:free]).tolist(),
        "covariance": covariance.tolist(),
        "cameras": [pose.tolist() for pose in rigid],
        "rms_px": np.sqrt(np.mean((scaled / weight[used, None]) ** 2, axis=0)).tolist(),
        "corners": int(used.sum()),
        "distance_m": float(np.median(distances)),
    }


def rays(inputs: dict[str, Any]) -> Any:
    """Return pixels and x / z and y / z of their rays, (n, 4), over the corners of each camera."""
    lens, observations = inputs["intrinsics"][0], inputs["observations_board"]
    camera = inputs["indices_frame_camintrinsics_camextrinsics"][:, 2] + 1
    found = []
    for number in range(camera.max() + 1):
        corners = observations[camera == number].reshape(-1, 3)
        pixels = corners[corners[:, 2] > 0.0, :2]
        sides = np.linspace(pixels.min(axis=0), pixels.max(axis=0), RAYS).T
        grid = np.stack(np.meshgrid(*sides), axis=-1).reshape(-1, 2)
        directions = mrcal.unproject(grid, inputs["lensmodel"], lens)
        found.append(np.hstack([grid, directions[:, :2] / directions[:, 2:]]).tolist())
    return found


def _rows(pose: Any) -> Any:
    """Convert a pose (4, 4) to mrcal's form: a rotation above a translation (4, 3)."""
    return np.vstack([np.array(pose)[:3, :3], np.array(pose)[:3, 3]])


def _matrix(rt: Any) -> Any:
    return np.vstack([np.column_stack([rt[:3], rt[3]]), [0.0, 0.0, 0.0, 1.0]])


def lens_difference_px(task: dict[str, Any], a: list[float], b: list[float], distance_m: float) -> float:
    """Return the RMS of mrcal's projection difference over the picture, with the implied motion."""
    models = [
        mrcal.cameramodel(
            intrinsics=(task["lens"], np.array(lens)), imagersize=np.array([task["width_px"], task["height_px"]])
        )
        for lens in (a, b)
    ]
    lengths = mrcal.projection_diff(
        models, distance=distance_m, use_uncertainties=False, focus_radius=COMPLETE_RADIUS_PX
    )[0]
    return float(np.sqrt(np.nanmean(lengths**2)))


def device_difference_px(task: dict[str, Any], a: dict[str, Any], b: dict[str, Any], distance_m: float) -> float:
    """Return the RMS difference at sample pixels in all mirrors, after the rigid motion that minimises it."""
    views = [(camera, np.array(pixels)) for camera, pixels in enumerate(task["samples"])]
    points = []
    for camera, pixels in views:
        rays = mrcal.unproject(pixels, task["lens"], np.array(a["lens"]), normalize=True)
        rig_from_camera = np.linalg.inv(np.array(a["cameras"][camera]))
        points.append(distance_m * rays @ rig_from_camera[:3, :3].T + rig_from_camera[:3, 3])
    centroid = np.concatenate(points).mean(axis=0)

    def residuals(motion: Any) -> Any:
        rotation, parts = mrcal.R_from_r(motion[:3]), []
        for (camera, pixels), points_a in zip(views, points, strict=True):
            pose = np.array(b["cameras"][camera])
            moved = (points_a - centroid) @ rotation.T + centroid + motion[3:]
            parts.append(
                mrcal.project(moved @ pose[:3, :3].T + pose[:3, 3], task["lens"], np.array(b["lens"])) - pixels
            )
        return np.concatenate(parts).ravel()

    best = least_squares(residuals, np.zeros(6), x_scale="jac", xtol=1e-15, ftol=1e-15, gtol=1e-15)
    return float(np.sqrt(2.0 * np.mean(best.fun**2)))


def solutions(task: dict[str, Any]) -> dict[str, Any]:
    """Return mrcal's solutions, and the differences of all calibrations, including those of the task."""
    solved = {}
    for name, weighted in (("mrcal", False), ("mrcal, corners weighted", True)):
        start_s = time.perf_counter()
        solved[name] = figures(solve(task, weighted))
        solved[name]["seconds"] = time.perf_counter() - start_s
    calibrations = {**task["calibrations"], **solved}
    distance_m = solved["mrcal"]["distance_m"]
    names = list(calibrations)
    pairs = [(a, b) for index, a in enumerate(names) for b in names[index + 1 :]]
    return {
        "found": solved,
        "differences": [
            {
                "of": [a, b],
                "lens_px": lens_difference_px(task, calibrations[a]["lens"], calibrations[b]["lens"], distance_m),
                "device_px": (
                    device_difference_px(task, calibrations[a], calibrations[b], distance_m)
                    if "cameras" in calibrations[a] and "cameras" in calibrations[b]
                    else None
                ),
            }
            for a, b in pairs
        ],
    }


if __name__ == "__main__":
    source, target = (Path(name) for name in sys.argv[1:])
    task = json.loads(source.read_text())
    alone = "calibrations" not in task
    answer = {"found": {"mrcal": figures(solve(task, weighted=False))}} if alone else solutions(task)
    target.write_text(json.dumps(answer))
