"""Next best board pose with a direct view and without a layout: visibility is predicted from the previous pictures.

The candidate poses are those of previous pictures, tilted, shifted, nearer and farther. A mirror is assumed to extend
somewhat beyond the corners observed in it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import product

import numpy as np
import shapely
from scipy.spatial.transform import Rotation

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.detection.checkerboard import non_collinear
from mirrorcam.optics.calibration.detection.next_pose import (
    INTRINSIC_SIGMAS,
    SHIFTS,
    TILTS,
    NextPose,
    NextPosePlanner,
    Placement,
    indices_inside,
    planning_model,
    position_in_words,
    shift_in_words,
    tilt_in_words,
)
from mirrorcam.optics.calibration.solver.initial_estimates import camera_from_flat_board
from mirrorcam.optics.calibration.solver.observations import DIRECT, Corners, Observations
from mirrorcam.optics.calibration.solver.residuals import Board, Estimate, residuals
from mirrorcam.optics.geometry.boards import CalibrationBoard
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.transforms import inverse, rigid, transform

DEPTHS = {0.8: "nearer by a fifth", 1.0: "", 1.25: "farther by a quarter"}
MAX_EXAMPLES = 3
"""Number of pictures whose poses are varied: those with the most corners."""
MIRROR_MARGIN = 0.25
"""Assumed extent of a mirror beyond its observed corners, relative to the square root of their hull's area."""
MIN_FACING = 0.25
"""Minimum cosine between a board's normal and the line of sight for which the print can be read."""
CENTRE_SIGMA = 0.3
"""Prior standard deviation of a virtual centre, relative to its distance."""


def next_direct_pose(
    start: Estimate,
    observations: Observations,
    board: CalibrationBoard,
    *,
    intrinsics: Sequence[str],
    pictures: Sequence[str],
    base: Sequence[Observations] = (),
) -> NextPose | None:
    """Return the recommendation after some pictures that show a board directly and in mirrors.

    Parameters
    ----------
    start
        First estimate of camera, mirrors and poses.
    observations
        The corners of all frames.
    board
        The board.
    intrinsics
        Names of the estimated camera parameters.
    pictures
        Names of the frames.
    base
        Corners of pictures without mirrors, each as frame 0.

    Returns
    -------
    NextPose or None
        None if no candidate pose shows the board, for example when the estimate fits none of its pictures.
    """
    camera, centres = start.camera, start.virtual_centres_in_rig_mm
    focal, centre, distortion = INTRINSIC_SIGMAS
    prior_sigmas = {"f": focal * camera.fx_px, "c": centre * camera.width_px}
    intrinsic_sigmas = [
        prior_sigmas.get(name[0], distortion) if name.endswith("_px") else distortion for name in intrinsics
    ]
    start_poses = start.with_poses(start.rig_from_board)
    placements = list(_placements(start_poses, observations, board, pictures))
    if not placements:
        return None
    planner = NextPosePlanner(
        start_poses,
        planning_model(intrinsics, board),
        [*intrinsic_sigmas, *np.repeat(CENTRE_SIGMA * np.linalg.norm(centres, axis=1), 3)],
        [_name(camera, observations, mirror) for mirror in range(len(centres))],
        placements,
    )
    for frame, pose in enumerate(start_poses.rig_from_board):
        rows = _frame_rows(observations, frame)
        if len(rows):
            planner.add(pose, rows)
    for rows in base:
        corners = Corners(rows.corner, rows.pixels)
        pose = camera_from_flat_board(camera, corners, board.corners_in_board_mm)
        if pose is not None:
            planner.add(pose, rows)
    return planner.next()


def _frame_rows(observations: Observations, frame: int) -> Observations:
    frame_rows = observations.where(observations.frame == frame)
    return frame_rows.with_frame_offset(-frame)


def _name(camera: Camera, observations: Observations, mirror: int) -> str:
    centroid = observations.pixels[observations.view == mirror].mean(axis=0)
    return f"mirror 0-{mirror} ({position_in_words(camera, centroid)})"


def _placements(
    start: Estimate, observations: Observations, board: CalibrationBoard, pictures: Sequence[str]
) -> Iterator[Placement]:
    """Yield variations of the poses of the pictures with the most corners."""
    counts = np.bincount(observations.frame, minlength=len(pictures))
    regions = _regions(start, observations)
    for frame in np.argsort(-counts, kind="stable")[:MAX_EXAMPLES].tolist():
        for factor, tilt, x, y in product(DEPTHS, TILTS, SHIFTS, SHIFTS):
            pose, depth_mm = _varied_pose(start.rig_from_board[frame], board, factor, tilt, (x, y))
            corners = _visible_corners(start, pose, regions, board)
            if len(corners):
                changes = [DEPTHS[factor], tilt_in_words(tilt, "the camera"), shift_in_words(x, y)]
                change_text = ", ".join(change for change in changes if change)
                description = (
                    f"the board as in {pictures[frame]}, {'but ' + change_text if change_text else 'once more'}"
                )
                yield Placement(pose, depth_mm, tilt, description, corners)


def _varied_pose(
    pose: FloatArray, board: CalibrationBoard, factor: float, tilt_deg: tuple[float, float], shift: tuple[float, float]
) -> tuple[FloatArray, float]:
    """Return a pose at `factor` times its distance, tilted, and shifted in halves of the board's size; its depth."""
    half = np.array([*board.size_mm, 0.0]) / 2.0
    rotation = Rotation.from_euler("xy", tilt_deg, degrees=True).as_matrix() @ pose[:3, :3]
    centre = factor * transform(pose, half) + half.max() * np.array([*shift, 0.0])
    return rigid(rotation, centre - rotation @ half), float(centre[2])


def _regions(start: Estimate, observations: Observations) -> dict[int, shapely.Geometry]:
    """Regions where views can show corners: the entire sensor directly, slightly beyond the corners in mirrors."""
    camera = start.camera
    sensor = shapely.box(0.0, 0.0, camera.width_px - 1.0, camera.height_px - 1.0)
    regions = {DIRECT: sensor}
    for mirror in range(len(start.virtual_centres_in_rig_mm)):
        hull = shapely.MultiPoint(observations.pixels[observations.view == mirror]).convex_hull
        regions[mirror] = hull.buffer(MIRROR_MARGIN * np.sqrt(hull.area)).intersection(sensor)
    return regions


def _visible_corners(
    start: Estimate, pose: FloatArray, regions: dict[int, shapely.Geometry], board: CalibrationBoard
) -> Observations:
    """Return the corners at a pose, as frame 0, in all views that show enough; none if the direct view does not."""
    flat = Board.rigid(board.corners_in_board_mm)
    estimate, ids = start.with_poses(pose[None]), np.arange(len(flat.corners_in_board_mm))
    parts = []
    for view, region in regions.items():
        pupil = np.zeros(3) if view == DIRECT else start.virtual_centres_in_rig_mm[view]
        pupil_from_centre = transform(inverse(pose), pupil) - np.array([*board.size_mm, 0.0]) / 2.0
        pixels = residuals(estimate, Observations.of_view(0, view, ids, np.zeros((len(ids), 2))), flat)
        visible = indices_inside(region, pixels)
        facing = -pupil_from_centre[2] > MIN_FACING * np.linalg.norm(pupil_from_centre)
        if facing and len(non_collinear(Corners(visible, pixels[visible]))):
            parts.append(Observations.of_view(0, view, visible, pixels[visible]))
        elif view == DIRECT:
            break
    return Observations.join(parts)
