"""Plausibility of a finished fit: implausible results are refused, doubtful ones noted."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mirrorcam.optics.base.values import FloatArray, InputError
from mirrorcam.optics.calibration.solver.levenberg_marquardt import Solution
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.layout import Layout

MAX_OUTLIERS = 0.1  # fraction of all corners
# Standard deviations of a device from its layout, as a prior.
PLACED_MM, TILTED_DEG, CAMERA_MM, CAMERA_DEG = 0.5, 0.5, 1.0, 1.0
SCALE_SIGMAS, SCALE_REFUSED, SCALE_NOTED = 4.0, 0.03, 0.01
MAX_NORMAL_DEG, MAX_DISTANCE = 1.0, 0.05  # sigmas beyond which a linear error bound is meaningless
PARALLEL_DEG = 5.0
OTHER_FOCAL = 0.05  # relative


def common_scale(layout: Layout, virtual_centres: FloatArray) -> tuple[float, float]:
    """The common scale of all lengths against the nominal layout, and its standard deviation.

    Least squares on the virtual centres (m, 3) over one factor, a shift and rotation of the camera, and a shift and
    tilt of each mirror, with the tolerances of a device as a prior. Where the device deviates more than these, the
    standard deviation grows accordingly.
    """
    nominal = layout.virtual_centres_in_rig_mm
    count = len(nominal)
    normals = -nominal / np.linalg.norm(nominal, axis=1, keepdims=True)
    lengths = np.linalg.norm(nominal, axis=1)
    factor = nominal.reshape(-1, 1)
    # A pupil that sits t away from where it should sees each plane n.t nearer, so its virtual centre moves 2 (n.t) n.
    camera_shift = (2.0 * normals[:, :, None] * normals[:, None, :]).reshape(-1, 3)
    camera_turn = np.array([np.cross(axis, nominal).ravel() for axis in np.eye(3)]).T
    design = np.concatenate([factor, camera_shift, camera_turn], axis=1)
    spread = np.zeros((count, 3, 3))
    for m, (normal, length) in enumerate(zip(normals, lengths, strict=True)):
        along = np.outer(normal, normal)
        spread[m] = (2.0 * PLACED_MM) ** 2 * along + (np.radians(TILTED_DEG) * length) ** 2 * (np.eye(3) - along)
    whiten = np.linalg.inv(np.linalg.cholesky(spread))
    rows = np.einsum("mij,mjk->mik", whiten, design.reshape(count, 3, -1)).reshape(3 * count, -1)
    seen = np.einsum("mij,mj->mi", whiten, virtual_centres - nominal).ravel()
    prior = np.concatenate([[0.0], np.full(3, 1.0 / CAMERA_MM), np.full(3, 1.0 / np.radians(CAMERA_DEG))])
    rows, seen = np.concatenate([rows, np.diag(prior)[1:]]), np.concatenate([seen, np.zeros(6)])
    solution = np.linalg.lstsq(rows, seen, rcond=None)[0]
    misfit = rows @ solution - seen
    excess = max(1.0, float(np.sqrt(misfit @ misfit / max(3 * count - 1, 1))))
    sigma = excess * float(np.sqrt(np.linalg.inv(rows.T @ rows)[0, 0]))
    return 1.0 + float(solution[0]), sigma


def scale_note(layout: Layout, virtual_centres: FloatArray) -> tuple[str, ...]:
    """A note where all lengths seem to be scaled; raises InputError where the board's square size must be wrong."""
    factor, sigma = common_scale(layout, virtual_centres)
    off = abs(factor - 1.0)
    message = (
        f"all lengths come out {factor:.3f} (+-{sigma:.3f}) times those of the nominal layout: measure the board, "
        f"square_mm may have to be {1.0 / factor:.3f} times its value in board.toml"
    )
    if off > max(SCALE_REFUSED, SCALE_SIGMAS * sigma):
        raise InputError(message)
    return (message,) if off > max(SCALE_NOTED, 2.0 * sigma) else ()


def pose_notes(rig_from_board: FloatArray) -> tuple[str, ...]:
    """Notes on poses (f, 4, 4) of the board that make the error bounds wider than necessary."""
    if len(rig_from_board) == 1:
        return ("one picture through the mirrors: it cannot be checked against another, take more",)
    normals = rig_from_board[:, :3, 2]
    along = normals @ np.linalg.svd(normals)[2][0]
    widest = float(np.degrees(np.arccos(np.clip(np.abs(along).min(), 0.0, 1.0))))
    if widest < PARALLEL_DEG:
        return (f"all boards are parallel to {widest:.1f} deg: tilt some by 20 deg or more for tighter bounds",)
    return ()


def camera_note(layout: Layout, camera: Camera) -> tuple[str, ...]:
    """A note where the camera's focal length is not that of the layout."""
    ratio = camera.fx_px / layout.camera.fx_px
    if abs(ratio - 1.0) < OTHER_FOCAL:
        return ()
    return (
        f"focal length {camera.fx_px:.1f} px, {ratio - 1.0:+.0%} from the layout's {layout.camera.fx_px:.1f}: "
        "another camera, zoom or crop than the layout was designed for",
    )


def refuse_implausible(solution: Solution, mirrors: Sequence[str]) -> None:
    """Raise InputError where too many corners misfit, or a named mirror is too uncertain for a linear error bound."""
    misfits = float((~solution.inliers).mean())
    if misfits > MAX_OUTLIERS:
        raise InputError(
            f"{misfits:.0%} of the corners fit neither mirrors nor camera, expected under {MAX_OUTLIERS:.0%}: are "
            "all pictures of one device, one camera and one board?"
        )
    for m, centre in enumerate(solution.estimate.virtual_centres_in_rig_mm):
        rows = [
            place for place, name in enumerate(solution.parameters) if name in {f"mirror {m} {a}_mm" for a in "xyz"}
        ]
        length = float(np.linalg.norm(centre))
        unit, block = centre / length, solution.covariance[np.ix_(rows, rows)]
        along = np.sqrt(max(float(unit @ block @ unit), 0.0)) / length
        across = np.degrees(np.sqrt(max(float(np.trace(block)) - (along * length) ** 2, 0.0) / 2.0) / length)
        if not (across < MAX_NORMAL_DEG and along < MAX_DISTANCE):
            raise InputError(
                f"the pictures leave mirror {mirrors[m]} open by {across:.2g} deg and {along:.2g} of its distance, "
                f"expected under {MAX_NORMAL_DEG:g} deg and {MAX_DISTANCE:g}: show it the board tilted and nearer"
            )


def check_solution(solution: Solution, layout: Layout, *, mirrored_frames: int) -> tuple[str, ...]:
    """Check a finished fit against its layout.

    Parameters
    ----------
    solution
        The fit, whose first frames are those with mirrors.
    layout
        The nominal layout.
    mirrored_frames
        Number of frames with mirrors.

    Returns
    -------
    notes
        What is doubtful, one sentence each.

    Raises
    ------
    InputError
        Where the fit is implausible.
    """
    refuse_implausible(solution, layout.mirror_names)
    estimate = solution.estimate
    return (
        *scale_note(layout, estimate.virtual_centres_in_rig_mm),
        *pose_notes(estimate.rig_from_board[:mirrored_frames]),
        *camera_note(layout, estimate.camera),
    )
