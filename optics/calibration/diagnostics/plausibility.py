"""Plausibility of a finished fit: implausible results are refused, doubtful ones noted."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mirrorcam.core.values import FloatArray, InputError
from mirrorcam.optics.calibration.solver.levenberg_marquardt import Solution
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.layout import Layout

MAX_OUTLIERS = 0.1  # fraction of all corners
MAX_NORMAL_DEG, MAX_DISTANCE = 1.0, 0.05  # sigmas beyond which a linear error bound is meaningless
PARALLEL_DEG = 5.0
OTHER_FOCAL = 0.05  # relative


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
                f"the pictures determine mirror {mirrors[m]} only to {across:.2g} deg and {along:.2g} of its distance, "
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
        *pose_notes(estimate.rig_from_board[:mirrored_frames]),
        *camera_note(layout, estimate.camera),
    )
