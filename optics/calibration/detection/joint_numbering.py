"""Numbering of checkerboards of which each mirror shows only a part, from all views of all frames jointly.

One view gives the pose of its part of the board up to a shift by squares and quarter turns. The rigid motion from a
board's image in one mirror to its image in another is the same in every frame. So some frames propose motions for their
possible shifts, and all frames vote. Given the motions, the parts in all mirrors of a frame join to a larger part,
which can often be numbered.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.detection.detections import QUARTER_ROTATIONS, DetectedFrame, DetectedGrid
from mirrorcam.optics.calibration.solver import initial_estimates
from mirrorcam.optics.calibration.solver.observations import DIRECT, IntArray, Observations
from mirrorcam.optics.geometry.boards import Checkerboard
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror import Mirror
from mirrorcam.optics.geometry.transforms import inverse, transform

MIN_CORNERS = 20  # of a part whose pose is used
MIN_FRAMES = 4  # frames that must agree on a motion
MIN_AGREEING = 0.8  # fraction of the frames that show the board in both mirrors
MAX_RIVAL = 0.5  # number of frames that agree on another motion, relative to those that agree on the best
MAX_DISTANCE = 0.2  # between two mirrors' images of one board, in squares
MAX_SHIFT = 8  # apparent shift of a board caused by deviations of the mirrors from the layout, in squares
MAX_ROTATION = np.deg2rad(20.0)  # apparent rotation caused by the same deviations
SAME_MOTION = 0.5  # between the board's positions under motions that count as equal, in squares
CAMERA_VIEWS = 24  # parts, and other pictures, used to estimate the camera
PROPOSING_FRAMES = 3  # frames that propose motions
SAMPLED_CORNERS = 20  # corners of a part that vote


@dataclass(frozen=True)
class _Part:
    """The part of the board that a mirror shows in a frame: a grid as on the print, and the pose (4, 4) of its image.

    Lengths are in squares. `rays` (n, 3) and `grid_xy` (n, 2) are those of sampled corners.
    """

    grid: DetectedGrid
    camera_from_image: FloatArray
    rays: FloatArray
    grid_xy: IntArray

    @classmethod
    def of(cls, detected: DetectedGrid, camera: Camera) -> _Part | None:
        """Return the part, or None if no pose fits the corners."""
        grid = detected.as_printed
        points = np.column_stack([grid.grid_xy, np.zeros(len(grid))]).astype(np.float64)
        pose = initial_estimates.camera_from_flat_board(camera, grid.corners, points)
        if pose is None:
            return None
        sampled = np.linspace(0, len(grid) - 1, min(SAMPLED_CORNERS, len(grid))).astype(np.int64)
        return cls(grid, pose, camera.unproject(grid.corners.pixels[sampled]), grid.grid_xy[sampled])

    def __len__(self) -> int:
        return len(self.grid)

    def intersect(self, camera_from_board: FloatArray) -> FloatArray:
        """Intersect the rays with boards at poses (..., 4, 4): points (..., n, 2) on the boards."""
        board_from_camera = inverse(camera_from_board)
        directions = self.rays @ board_from_camera[..., :3, :3].swapaxes(-1, -2)
        origin = board_from_camera[..., None, :3, 3]
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(origin[..., :2] - directions[..., :2] * (origin[..., 2:] / directions[..., 2:]))


@dataclass(frozen=True)
class _Fit:
    """How parts continue another view's part: quarter turns (...), shifts (..., 2) and errors (...), in squares."""

    turn: IntArray
    shift: IntArray
    error: FloatArray

    @classmethod
    def of(cls, part: _Part, camera_from_board: FloatArray) -> _Fit:
        """Fit the grid of a part to the board, for poses (..., 4, 4) of the board's image."""
        grid_xy = part.intersect(camera_from_board)
        finite = np.asarray(np.isfinite(grid_xy).all(axis=(-2, -1)))
        grid_xy = np.where(finite[..., None, None], grid_xy, 0.0)
        rotated_xy = part.grid_xy @ _TRANSPOSED_ROTATIONS  # (4, n, 2)
        differences = grid_xy[..., None, :, :] - rotated_xy
        shifts = np.median(differences, axis=-2)
        turn = np.linalg.norm(differences - shifts[..., None, :], axis=-1).mean(axis=-1).argmin(axis=-1)
        shift = np.rint(np.take_along_axis(shifts, turn[..., None, None], axis=-2)[..., 0, :]).astype(np.int64)
        error = np.linalg.norm(grid_xy - rotated_xy[turn] - shift[..., None, :], axis=-1).max(axis=-1)
        return cls(turn, shift, np.where(finite & ((shift.sum(axis=-1) + turn) % 2 == 0), error, np.inf))


_TRANSPOSED_ROTATIONS = np.array([rotation.T for rotation in QUARTER_ROTATIONS])


def number_jointly(
    frames: Sequence[DetectedFrame], base: Sequence[DetectedFrame], layout: Layout, board: Checkerboard
) -> list[DetectedFrame]:
    """Number the boards of frames from all views of each frame jointly.

    Parameters
    ----------
    frames, base
        Detections in pictures via the mirrors, and without them.
    layout
        The nominal layout.
    board
        The board.

    Returns
    -------
    list of DetectedFrame
        The frames, with more corners where several views can be numbered jointly. Ambiguous views are left out, and so
        are frames whose views contradict each other.
    """
    if not any(frame.grids for frame in frames):
        return list(frames)
    camera = _camera(frames, base, layout.camera, board)
    parts = [_parts(frame, camera) for frame in frames]
    motions = _motions(parts, layout, board.square_mm)
    return [
        _numbered(frame, in_frame, motions, board) if frame.grids else frame
        for frame, in_frame in zip(frames, parts, strict=True)
    ]


def _camera(
    frames: Sequence[DetectedFrame], base: Sequence[DetectedFrame], nominal: Camera, board: Checkerboard
) -> Camera:
    """Estimate the camera from the largest parts in the mirrors, which reach the picture's edges, and other pictures.

    Each part is a view of a flat board; its numbering does not matter.
    """
    largest = sorted((grid for frame in frames for _, grid in frame.grids), key=len, reverse=True)[:CAMERA_VIEWS]
    views = [(grid.grid_xy, grid.corners.pixels) for grid in largest]
    for corners in [frame.corners for frame in base if len(frame.corners)][:CAMERA_VIEWS]:
        row, col = np.divmod(corners.corner, board.cols - 1)
        views.append((np.stack([col, row], axis=1), corners.pixels))
    grid_xy = np.concatenate([xy for xy, _ in views])
    lattice, ids = np.unique(grid_xy, axis=0, return_inverse=True)
    frame = np.repeat(np.arange(len(views)), [len(xy) for xy, _ in views])
    pixels = np.concatenate([view_pixels for _, view_pixels in views])
    corners = Observations(frame, np.full(len(frame), DIRECT), ids.ravel(), pixels)
    try:
        return initial_estimates.base_camera(corners, nominal, lattice @ np.eye(2, 3))
    except InputError:
        return nominal


def _parts(frame: DetectedFrame, camera: Camera) -> dict[int, _Part]:
    """Return the largest part with a known pose in each mirror."""
    parts: dict[int, _Part] = {}
    for mirror, grid in sorted(frame.grids, key=lambda pair: -len(pair[1])):
        part = None if mirror in parts else _Part.of(grid, camera)
        if part is not None:
            parts[mirror] = part
    return parts


def _motions(parts: list[dict[int, _Part]], layout: Layout, square_mm: float) -> dict[int, FloatArray]:
    """Return the motions (4, 4), agreed by the frames, from images in one mirror to images in each other mirror."""
    part_counts = [sum(len(p[m]) >= MIN_CORNERS for p in parts if m in p) for m in range(len(layout.mirrors))]
    order = np.argsort(part_counts)[::-1].tolist()
    reflections = [_reflection(mirror, square_mm) for mirror in layout.mirrors]
    motions = {order[0]: np.eye(4)}
    found_more = True
    while found_more:
        found_more = False
        for mirror in order:
            if mirror not in motions:
                motion = _agreed_motion(parts, mirror, motions, reflections[mirror] @ reflections[order[0]])
                if motion is not None:
                    motions[mirror] = motion
                    found_more = True
    return motions


def _reflection(mirror: Mirror, square_mm: float) -> FloatArray:
    """Return the reflection (4, 4) in a mirror, in squares."""
    plane = mirror.apparent
    normal = plane.normal_in_rig
    matrix = np.eye(4)
    matrix[:3, :3] -= 2.0 * np.outer(normal, normal)
    matrix[:3, 3] = plane.virtual_centre_in_rig_mm / square_mm
    return matrix


def _agreed_motion(
    parts: list[dict[int, _Part]], mirror: int, motions: dict[int, FloatArray], nominal: FloatArray
) -> FloatArray | None:
    """Return the motion (4, 4) by which a mirror's parts continue the other views in most frames, or None."""
    pairs = [
        (pose, in_frame[mirror])
        for in_frame in parts
        if mirror in in_frame and len(in_frame[mirror]) >= MIN_CORNERS
        if (pose := _first_mirror_pose(in_frame, motions)) is not None
    ]
    if len(pairs) < MIN_FRAMES:
        return None
    largest = sorted(pairs, key=lambda pair: -len(pair[1]))[:PROPOSING_FRAMES]
    proposed = np.array([motion for pose, part in largest for motion in _propose(pose, part, nominal)])
    if not len(proposed):
        return None
    errors = np.array([_Fit.of(part, proposed @ pose).error for pose, part in pairs])
    votes = (errors < MAX_DISTANCE).sum(axis=0)
    best = int(np.lexsort((np.minimum(errors, MAX_DISTANCE).sum(axis=0), -votes))[0])
    rival = votes[~_same_motion(proposed, proposed[best], pairs)].max(initial=0)
    enough = votes[best] >= max(MIN_FRAMES, MIN_AGREEING * len(pairs))
    return proposed[best] if enough and rival <= MAX_RIVAL * votes[best] else None


def _same_motion(
    motions: FloatArray, other: FloatArray, pairs: Sequence[tuple[FloatArray, _Part]]
) -> NDArray[np.bool_]:
    """Mask of the motions (m, 4, 4) that move the boards' centroids to about the same points as `other`."""
    centroids = np.array([transform(pose, part.grid_xy.mean(axis=0) @ np.eye(2, 3)) for pose, part in pairs])
    positions = centroids @ motions[:, :3, :3].swapaxes(1, 2) + motions[:, None, :3, 3]
    distances = np.linalg.norm(positions - transform(other, centroids), axis=2)
    return np.asarray(np.median(distances, axis=1) < SAME_MOTION)


def _first_mirror_pose(in_frame: dict[int, _Part], motions: dict[int, FloatArray]) -> FloatArray | None:
    """Return the pose (4, 4) of the board's image in the first mirror, from the largest part with a known motion."""
    located = [m for m in in_frame if m in motions and len(in_frame[m]) >= MIN_CORNERS]
    if not located:
        return None
    mirror = max(located, key=lambda m: len(in_frame[m]))
    return inverse(motions[mirror]) @ in_frame[mirror].camera_from_image


def _propose(pose: FloatArray, part: _Part, nominal: FloatArray) -> list[FloatArray]:
    """Propose motions by which a part becomes an image of the board at a pose, for all shifts near the nominal one."""
    motions: list[FloatArray] = []
    grid_xy = part.intersect(nominal @ pose)
    if not np.isfinite(grid_xy).all():
        return motions
    steps = np.arange(-MAX_SHIFT, MAX_SHIFT + 1)
    shifts = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    shifts = shifts[np.linalg.norm(shifts, axis=1) <= MAX_SHIFT]
    for turn, matrix in enumerate(QUARTER_ROTATIONS):
        board_from_part = np.eye(4)
        board_from_part[:2, :2] = matrix
        rotation = (part.camera_from_image @ inverse(board_from_part) @ inverse(pose))[:3, :3] @ nominal[:3, :3].T
        if np.arccos(np.clip((np.trace(rotation) - 1.0) / 2.0, -1.0, 1.0)) > MAX_ROTATION:
            continue
        nominal_shift = np.rint(np.median(grid_xy - part.grid_xy @ matrix.T, axis=0)).astype(np.int64)
        for shift in nominal_shift + shifts:
            if (shift.sum() + turn) % 2 == 0:
                board_from_part[:2, 3] = shift
                motions.append(part.camera_from_image @ inverse(board_from_part) @ inverse(pose))
    return motions


def _numbered(
    frame: DetectedFrame, in_frame: dict[int, _Part], motions: dict[int, FloatArray], board: Checkerboard
) -> DetectedFrame:
    pose = _first_mirror_pose(in_frame, motions)
    if pose is None:
        return frame
    fits = {m: _Fit.of(part, motions[m] @ pose) for m, part in in_frame.items() if m in motions}
    views = [m for m in sorted(fits) if fits[m].error < MAX_DISTANCE]
    if len(views) < 2:
        return frame
    grids = [in_frame[m].grid.transformed(int(fits[m].turn), fits[m].shift) for m in views]
    joined = DetectedGrid.join(grids)
    view = np.repeat(views, [len(grid) for grid in grids])
    numberings = [
        Observations(np.zeros(len(view), dtype=np.int64), view, corners.ids, corners.pixels, corners.sigma_px)
        for corners in joined.numberings(board, mirrored=False)
    ]
    if not numberings:
        return replace(frame, corners=Observations.empty())
    if len(numberings) > 1 + board.looks_same_upside_down:
        return frame
    best = max(numberings, key=lambda numbering: _agreement(numbering, frame.corners))
    unjoined = frame.corners.where(~np.isin(frame.corners.view, views))
    contradicted = len(unjoined) < len(frame.corners) and _agreement(best, frame.corners) == 0
    return replace(frame, corners=best if contradicted else Observations.join([best, unjoined]))


def _agreement(numbering: Observations, other: Observations) -> int:
    """Number of corners on which two numberings of a frame agree."""
    common = 0
    for view in np.unique(numbering.view):
        found_rows, other_rows = numbering.where(numbering.view == view), other.where(other.view == view)
        _, first, second = np.intersect1d(found_rows.corner, other_rows.corner, return_indices=True)
        common += int((np.abs(found_rows.pixels[first] - other_rows.pixels[second]) < 1.0).all(axis=1).sum())
    return common
