"""What mrcal makes of corners: `PYTHON mrcal_solver.py IN.json OUT.json`.

Part of `benchmarks.calibration_mrcal`, and of `benchmarks.calibrators.mrcal_joint`, whose task has no calibrations.

Runs in any interpreter that has mrcal, and needs nothing of this project.

All views are one camera, at one place for each mirror: in a world that is mirrored, too, a reflection before a camera
is a rigid motion, and a flat board that is seen in a mirror is one that is seen from behind. The first mirror's place
is the reference. Boards without mirrors are frames of their own, at that place. Lengths are metres, as mrcal scales its
numbers.
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

SMALL = 1e-6  # lens numbers to start from
FEWEST = 4  # corners of a board that fix its pose
FAR = 1e6  # px: a radius that takes the whole picture


def boards(task: dict[str, Any], weighted: bool) -> tuple[Any, Any]:
    """Boards (n, rows, cols, 3) of x, y and weight, and for each its frame and camera (n, 2)."""
    rows, cols = task["board"]["rows"], task["board"]["cols"]
    sigma = np.array([corner[5] for corner in task["corners"]])
    weights = np.median(sigma) / sigma if weighted else np.ones(len(sigma))
    made: dict[tuple[int, int], Any] = {}
    for (frame, camera, corner, x, y, _), weight in zip(task["corners"], weights.tolist(), strict=True):
        empty = np.full((rows, cols, 3), -1.0)
        made.setdefault((frame, camera), empty)[corner // cols, corner % cols] = x, y, weight
    keys = sorted(made)
    return np.array([made[key] for key in keys]), np.array(keys, dtype=np.int32)


def solved(task: dict[str, Any], weighted: bool) -> dict[str, Any]:
    """The inputs of mrcal's optimisation, with its result in them, as `mrcal-calibrate-cameras` gets there."""
    seen, keys = boards(task, weighted)
    cameras, size = int(keys[:, 1].max()) + 1, [task["width_px"], task["height_px"]]
    if start := task.get("start"):
        model, core = "LENSMODEL_PINHOLE", [np.array(start["core"])]
        places, poses = (
            np.array([mrcal.rt_from_Rt(_rows(each)) for each in start[name]]) for name in ("places", "poses")
        )
    else:
        model = "LENSMODEL_STEREOGRAPHIC"
        core, places, poses = mrcal.seed_stereographic(
            imagersizes=[size] * cameras,
            focal_estimate=task["focal_px"],
            indices_frame_camera=keys,
            observations=seen,
            object_spacing=task["board"]["spacing_m"],
        )
    inputs = {
        "intrinsics": np.array(core[:1]),
        "extrinsics_rt_fromref": places,
        "frames_rt_toref": poses,
        "points": None,
        "observations_board": seen,
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
    inputs["lensmodel"] = task["lens"]
    more = mrcal.lensmodel_num_params(task["lens"]) - 4
    inputs["intrinsics"] = np.hstack([inputs["intrinsics"], np.full((1, more), SMALL)])
    inputs["do_optimize_intrinsics_distortions"] = True
    mrcal.optimize(**inputs)
    inputs["do_apply_outlier_rejection"] = True
    mrcal.optimize(**inputs)
    if leave_out_lost(inputs):
        inputs["do_apply_outlier_rejection"] = False
        mrcal.optimize(**inputs)
    return inputs


def leave_out_lost(inputs: dict[str, Any]) -> bool:
    """Take out boards of which too few corners are left to tell a pose; whether there are any."""
    left = inputs["observations_board"][..., 2] > 0.0
    kept = left.sum(axis=(1, 2)) >= FEWEST
    indices = inputs["indices_frame_camintrinsics_camextrinsics"][kept]
    frames, indices[:, 0] = np.unique(indices[:, 0], return_inverse=True)
    inputs["observations_board"] = np.ascontiguousarray(inputs["observations_board"][kept])
    inputs["indices_frame_camintrinsics_camextrinsics"] = np.ascontiguousarray(indices)
    inputs["frames_rt_toref"] = np.ascontiguousarray(inputs["frames_rt_toref"][frames])
    return not bool(kept.all())


def figures(inputs: dict[str, Any]) -> dict[str, Any]:
    """Lens with its standard deviations, places of the cameras, covariance of both, residuals.

    The covariance is that of the lens, and of turn (a Rodrigues vector) and shift (m) of every camera but the first.
    """
    _, residuals, _, factorization = mrcal.optimizer_callback(**inputs)
    seen = inputs["observations_board"]
    weight = seen[..., 2].ravel()
    used = weight > 0.0
    scaled = np.reshape(residuals[: 2 * len(weight)], (-1, 2))[used]
    states = mrcal.num_states(**inputs)
    scale = np.sqrt(np.sum(scaled**2) / (scaled.size - states))
    lens = inputs["intrinsics"][0]
    kept = len(lens) + inputs["extrinsics_rt_fromref"].size  # these are the first of the state
    packed = factorization.solve_xt_JtJ_bt(np.eye(kept, states))[:, :kept]
    sizes = np.ones(states)
    mrcal.unpack_state(sizes, **inputs)
    covariance = scale**2 * packed * np.outer(sizes[:kept], sizes[:kept])
    rigid = [np.eye(4), *(_matrix(mrcal.Rt_from_rt(place)) for place in inputs["extrinsics_rt_fromref"])]
    distances = [np.linalg.norm(pose[3:]) for pose in inputs["frames_rt_toref"]]
    return {
        "lens": lens.tolist(),
        "sigma": np.sqrt(np.diag(covariance)[: len(lens)]).tolist(),
        "covariance": covariance.tolist(),
        "cameras": [place.tolist() for place in rigid],
        "rms_px": np.sqrt(np.mean((scaled / weight[used, None]) ** 2, axis=0)).tolist(),
        "corners": int(used.sum()),
        "distance_m": float(np.median(distances)),
    }


def _rows(pose: Any) -> Any:
    """A pose (4, 4) as mrcal has it: a rotation above a shift (4, 3)."""
    return np.vstack([np.array(pose)[:3, :3], np.array(pose)[:3, 3]])


def _matrix(rt: Any) -> Any:
    return np.vstack([np.column_stack([rt[:3], rt[3]]), [0.0, 0.0, 0.0, 1.0]])


def lens_difference_px(task: dict[str, Any], a: list[float], b: list[float], distance_m: float) -> float:
    """Root mean square of mrcal's projection difference over the picture, with the implied motion."""
    models = [
        mrcal.cameramodel(
            intrinsics=(task["lens"], np.array(lens)), imagersize=np.array([task["width_px"], task["height_px"]])
        )
        for lens in (a, b)
    ]
    lengths = mrcal.projection_diff(models, distance=distance_m, use_uncertainties=False, focus_radius=FAR)[0]
    return float(np.sqrt(np.nanmean(lengths**2)))


def device_difference_px(task: dict[str, Any], a: dict[str, Any], b: dict[str, Any], distance_m: float) -> float:
    """Root mean square over the corners' places in all mirrors, with the rigid motion that makes them agree best."""
    views = [(camera, np.array(pixels)) for camera, pixels in enumerate(task["places"])]
    points = []
    for camera, pixels in views:
        rays = mrcal.unproject(pixels, task["lens"], np.array(a["lens"]), normalize=True)
        back = np.linalg.inv(np.array(a["cameras"][camera]))
        points.append(distance_m * rays @ back[:3, :3].T + back[:3, 3])
    middle = np.concatenate(points).mean(axis=0)

    def off(motion: Any) -> Any:
        turn, parts = mrcal.R_from_r(motion[:3]), []
        for (camera, pixels), at in zip(views, points, strict=True):
            place = np.array(b["cameras"][camera])
            moved = ((at - middle) @ turn.T + middle + motion[3:]) @ place[:3, :3].T + place[:3, 3]
            parts.append(mrcal.project(moved, task["lens"], np.array(b["lens"])) - pixels)
        return np.concatenate(parts).ravel()

    best = least_squares(off, np.zeros(6), x_scale="jac", xtol=1e-15, ftol=1e-15, gtol=1e-15)
    return float(np.sqrt(2.0 * np.mean(best.fun**2)))


def solutions(task: dict[str, Any]) -> dict[str, Any]:
    """What mrcal finds, and how all calibrations differ, those of the task included."""
    found = {}
    for name, weighted in (("mrcal", False), ("mrcal, corners weighted", True)):
        started = time.perf_counter()
        found[name] = figures(solved(task, weighted))
        found[name]["seconds"] = time.perf_counter() - started
    everyone = {**task["calibrations"], **found}
    distance_m = found["mrcal"]["distance_m"]
    names = list(everyone)
    pairs = [(a, b) for place, a in enumerate(names) for b in names[place + 1 :]]
    return {
        "found": found,
        "differences": [
            {
                "of": [a, b],
                "lens_px": lens_difference_px(task, everyone[a]["lens"], everyone[b]["lens"], distance_m),
                "device_px": (
                    device_difference_px(task, everyone[a], everyone[b], distance_m)
                    if "cameras" in everyone[a] and "cameras" in everyone[b]
                    else None
                ),
            }
            for a, b in pairs
        ],
    }


if __name__ == "__main__":
    read, written = (Path(name) for name in sys.argv[1:])
    task = json.loads(read.read_text())
    alone = "calibrations" not in task
    answer = {"found": {"mrcal": figures(solved(task, weighted=False))}} if alone else solutions(task)
    written.write_text(json.dumps(answer))
