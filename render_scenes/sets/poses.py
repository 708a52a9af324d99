"""Plans of board poses that cover every sub-image at near and far depths, with tilts.

A plan uses only the design, like a person who holds the board by hand.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.boards import CalibrationBoard
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.transforms import rigid
from mirrorcam.render_scenes.fields_of_view import common_bounds
from mirrorcam.render_scenes.sets.dataset import DepthRange
from mirrorcam.render_scenes.truth.corners import BoolArray, CornerProjector

MAX_TILT_DEG = 38.0
MAX_ROLL_DEG = 25.0
MAX_CANDIDATES = 8  # poses per frame; large sets, which cover the picture anyway, have fewer
TOTAL_CANDIDATES = 800  # per set, but at least `MIN_CANDIDATES` per frame
MIN_CANDIDATES = 2
CELLS = 10  # coverage is counted on a grid of this many cells along each side of a sub-image
MIN_CORNERS = 6  # that a view must show to determine the pose of the board
MIN_SQUARE_PX = 8.0
CLEARANCE_MM = 20.0  # between mirrors and board
_ROOT = 1.1127756842787055  # the positive root of x^7 = x + 1


@dataclass(frozen=True)
class PosePlan:
    """Board poses (n, 4, 4) in the rig frame, mm, and their visibility in views: the mirrors, or the bare camera.

    `coverage` (views,) is the fraction of each view's picture in which some pose shows a corner; `corners` (n, views)
        is the number of visible corners of each pose.
    """

    poses: FloatArray
    coverage: FloatArray
    corners: NDArray[np.int64]


def depth_ranges(plan: PosePlan, board: CalibrationBoard, forward: FloatArray) -> tuple[DepthRange, ...]:
    """Return the range of depths and the maximum tilt at which each view shows `MIN_CORNERS` corners or more.

    Depth is measured to the board's centre along the unit vector `forward` (3,) of the rig frame; tilt is the angle
    between the board's normal and this vector. Both are rounded, to mm and degrees: the board is held by hand.
    """
    centre = np.array([*board.size_mm, 0.0, 2.0]) / 2.0
    depths = (plan.poses @ centre)[:, :3] @ forward
    tilts = np.degrees(np.arccos(np.clip(plan.poses[:, :3, 2] @ forward, -1.0, 1.0)))
    ranges = []
    for corners in plan.corners.T:
        used = corners >= MIN_CORNERS
        if not used.any():
            ranges.append(DepthRange(nearest_mm=0, farthest_mm=0, tilt_deg=0))
            continue
        near, far, tilt = (round(float(v)) for v in (depths[used].min(), depths[used].max(), tilts[used].max()))
        ranges.append(DepthRange(nearest_mm=near, farthest_mm=far, tilt_deg=tilt))
    return tuple(ranges)


def plan_frames(layout: Layout, board: CalibrationBoard, count: int, random: np.random.Generator) -> PosePlan:
    """Plan poses in front of the mirrors, around the depths of the spec, with the printed side towards the mirrors.

    Raises InputError if the board is too small or too large.
    """
    depths = _depths(layout)
    nearest = max(float((m.outline_in_rig_mm @ layout.view_from_rig[2]).max()) for m in layout.mirrors) + CLEARANCE_MM
    projector = CornerProjector(layout, board)
    half = np.array(board.size_mm) / 2.0

    def pose(numbers: FloatArray) -> FloatArray | None:
        # Equal steps of 1 / depth are equal steps in the size of the image.
        depth = 1.0 / np.interp(numbers[0], [0.0, 1.0], [1.0 / depths[0], 1.0 / depths[1]])
        field = common_bounds(layout, depth)
        half_range = np.maximum(np.abs(np.diff(field, axis=0)[0] / 2.0 - half), 0.25 * half)
        centre = np.array([*(field.mean(axis=0) + half_range * (2.0 * numbers[1:3] - 1.0)), depth])
        rig_from_board = _rig_from_board(layout.view_from_rig, board, centre, numbers[3:])
        outline = np.array([[x, y, 0.0, 1.0] for x in (0.0, 2 * half[0]) for y in (0.0, 2 * half[1])])
        return rig_from_board if (outline @ rig_from_board[:3].T @ layout.view_from_rig[2]).min() > nearest else None

    views = [layout.outline_px(index) for index in range(len(layout.mirrors))]
    plan = _choose(pose, projector.via_mirrors, views, count, random)
    _check_visible(board, plan, projector.via_mirrors, views, "mirror")
    return plan


def evaluate_plan(layout: Layout, board: CalibrationBoard, poses: FloatArray) -> PosePlan:
    """Return the plan of given poses (n, 4, 4) in the rig frame, mm; raise InputError if no corner is ever visible."""
    projector = CornerProjector(layout, board)
    grids = [_CellGrid(layout.outline_px(index)) for index in range(len(layout.mirrors))]
    covered = np.zeros((len(grids), CELLS, CELLS), dtype=np.bool_)
    corners = np.zeros((len(poses), len(grids)), dtype=np.int64)
    for number, pose in enumerate(poses):
        px, visible = projector.via_mirrors(pose)
        corners[number] = visible.sum(axis=1)
        covered |= [grid.hit(px[index][visible[index]]) for index, grid in enumerate(grids)]
    if not covered.any():
        raise InputError(f"none of {len(poses)} poses shows a corner of the board in a mirror")
    return PosePlan(poses, _coverage(grids, covered), corners)


def plan_base_frames(layout: Layout, board: CalibrationBoard, count: int, random: np.random.Generator) -> PosePlan:
    """Plan poses in front of the bare camera with corners all over its sensor, at several distances and tilts.

    Raises InputError if the board is too small or too large.
    """
    camera = layout.camera
    projector = CornerProjector(layout, board)
    size = np.array([camera.width_px, camera.height_px])
    focal = np.array([camera.fx_px, camera.fy_px])
    # Distance at which the board fills the picture.
    fill_distance_mm = float(np.max(np.array(board.size_mm) * focal / size))

    def pose(numbers: FloatArray) -> FloatArray | None:
        distance = fill_distance_mm / (0.45 + 0.5 * numbers[0])
        shift = size / focal * distance / 2.0 - 0.35 * np.array(board.size_mm)
        centre = np.array([*(np.maximum(shift, 0.0) * (2.0 * numbers[1:3] - 1.0)), distance])
        return _rig_from_board(np.eye(3), board, centre, numbers[3:])

    def visible_corners(rig_from_board: FloatArray) -> tuple[FloatArray, BoolArray]:
        px, visible = projector.direct(rig_from_board)
        return px[None], visible[None]

    far_x, far_y = size - 1.0
    views = [np.array([[0.0, 0.0], [far_x, 0.0], [far_x, far_y], [0.0, far_y]])]
    plan = _choose(pose, visible_corners, views, count, random)
    _check_visible(board, plan, visible_corners, views, "camera")
    return plan


def _depths(layout: Layout) -> tuple[float, float]:
    """Return the nearest and farthest depth of the board's centre: a slightly wider range than the spec's."""
    if layout.spec is not None:
        return 0.92 * min(layout.spec.depths_mm), 1.15 * max(layout.spec.depths_mm)
    scale = layout.mirrors[layout.central_index].distance_mm * np.sqrt(2.0)
    return 3.5 * scale, 7.0 * scale


def _rig_from_board(
    view_from_rig: FloatArray, board: CalibrationBoard, centre_in_view: FloatArray, numbers: FloatArray
) -> FloatArray:
    """Return the pose of a board centred at a point, with two tilts and a roll from three numbers in [0, 1]."""
    tilts = (2.0 * numbers - 1.0) * [MAX_TILT_DEG, MAX_TILT_DEG, MAX_ROLL_DEG]
    view_from_board = Rotation.from_euler("xyz", tilts, degrees=True).as_matrix()
    rotation = view_from_rig.T @ view_from_board
    centre = np.array([*board.size_mm, 0.0]) / 2.0
    return rigid(rotation, view_from_rig.T @ centre_in_view - rotation @ centre)


class _CellGrid:
    """Coverage cells of a view's picture: a grid over its bounds, of which cells centred inside the outline count."""

    def __init__(self, outline_px: FloatArray) -> None:
        self.low, high = outline_px.min(axis=0), outline_px.max(axis=0)
        self.step = (high - self.low) / CELLS
        y, x = np.mgrid[:CELLS, :CELLS]
        centres = self.low + (np.stack([x, y], axis=-1) + 0.5) * self.step
        self.inside: BoolArray = shapely.contains_xy(shapely.Polygon(outline_px), centres[..., 0], centres[..., 1])

    def hit(self, px: FloatArray) -> BoolArray:
        """Return the mask (CELLS, CELLS) of the cells that contain one of the points `px` (n, 2)."""
        index = np.floor((px - self.low) / self.step).astype(int)
        index = index[((index >= 0) & (index < CELLS)).all(axis=1)]
        mask = np.zeros((CELLS, CELLS), dtype=np.bool_)
        mask[index[:, 1], index[:, 0]] = True
        return mask & self.inside


def _choose(
    pose: Callable[[FloatArray], FloatArray | None],
    visible_corners: Callable[[FloatArray], tuple[FloatArray, BoolArray]],
    outlines_px: list[FloatArray],
    count: int,
    random: np.random.Generator,
) -> PosePlan:
    """Choose, for each frame, the candidate pose that shows most corners where previous frames showed none.

    A pose has six numbers in [0, 1]: depth, position (2), tilt (2), roll. The depths of the frames are spread evenly.
    """
    grids = [_CellGrid(outline) for outline in outlines_px]
    covered = np.zeros((len(grids), CELLS, CELLS), dtype=np.bool_)
    # A shifted R6 sequence (Roberts): a low-discrepancy sequence for any number of points.
    steps = _ROOT ** -np.arange(1.0, 7.0)
    candidates = int(np.clip(TOTAL_CANDIDATES // max(count, 1), MIN_CANDIDATES, MAX_CANDIDATES))
    numbers = (random.random(6) + np.arange(candidates * count)[:, None] * steps) % 1.0
    numbers = numbers.reshape(candidates, count, 6)
    numbers[..., 0] = (random.permutation(count) + numbers[..., 0]) / max(count, 1)
    poses: list[FloatArray] = []
    corners = np.zeros((count, len(grids)), dtype=np.int64)
    for frame in range(count):
        best, best_gain = None, (-1, -1.0)
        for candidate in numbers[:, frame]:
            rig_from_board = pose(candidate)
            if rig_from_board is None:
                continue
            px, visible = visible_corners(rig_from_board)
            hits = np.array([grid.hit(px[i][visible[i]]) for i, grid in enumerate(grids)])
            # Prefer enough corners in every view, then new cells.
            usable = int(np.minimum(visible.sum(axis=1), MIN_CORNERS).sum())
            gain = (usable, float((hits & ~covered).sum() + 0.05 * hits.sum()))
            if gain > best_gain:
                best, best_gain, best_hits = rig_from_board, gain, hits
                corners[frame] = visible.sum(axis=1)
        if best is None:
            raise InputError("board: too large to fit in front of the mirrors without touching them")
        poses.append(best)
        covered |= best_hits
    return PosePlan(np.array(poses).reshape(count, 4, 4), _coverage(grids, covered), corners)


def _coverage(grids: list[_CellGrid], covered: BoolArray) -> FloatArray:
    """Return the covered fraction (views,) of the cells of each view's picture."""
    return np.array([float(hits[grid.inside].mean()) for hits, grid in zip(covered, grids, strict=True)])


def _check_visible(
    board: CalibrationBoard,
    plan: PosePlan,
    visible_corners: Callable[[FloatArray], tuple[FloatArray, BoolArray]],
    outlines_px: list[FloatArray],
    view_name: str,
) -> None:
    """Raise InputError if the board's squares are not resolved, or a view shows too few corners in most frames."""
    if not len(plan.poses):
        return
    is_usable: list[NDArray[np.bool_]] = []
    squares_px = []
    for pose in plan.poses:
        px, visible = visible_corners(pose)
        is_usable.append(visible.sum(axis=1) >= min(MIN_CORNERS, px.shape[1]))
        cols, rows = board.corner_counts
        grid_px = px.reshape(len(px), rows, cols, 2)
        lengths_px = np.linalg.norm(np.diff(grid_px, axis=2), axis=-1).reshape(len(px), -1)
        squares_px.append(np.nanmedian(np.where(np.isfinite(lengths_px), lengths_px, np.nan)))
    square_px = float(np.median(squares_px))
    subject = f"board of {board.layout_text}"
    if square_px < MIN_SQUARE_PX:
        raise InputError(
            f"{subject}: too small to be resolved, "
            f"a square spans {square_px:.1f} px, expected {MIN_SQUARE_PX:g} or more"
        )
    poorest = int(np.argmin(np.mean(is_usable, axis=0)))
    if np.mean(is_usable, axis=0)[poorest] < 0.25:
        span = np.ptp(outlines_px[poorest], axis=0).min()
        size = "large" if square_px > span / 4.0 else "small"
        raise InputError(
            f"{subject}: too {size} to be seen, {view_name} {poorest} shows {MIN_CORNERS} corners in too few frames"
        )
