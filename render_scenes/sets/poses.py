"""Planning of board poses: coverage of every sub-image at near and far depths, with tilts.

The plan uses only the design, as a person does who holds the board by hand.
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
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.targets import Target
from mirrorcam.optics.geometry.transforms import rigid
from mirrorcam.render_scenes.fields_of_view import common_bounds
from mirrorcam.render_scenes.sets.dataset import Reach
from mirrorcam.render_scenes.truth.corners import BoolArray, Oracle

MOST_TILT_DEG = 38.0
MOST_ROLL_DEG = 25.0
CANDIDATES = 8  # poses tried per frame; large sets, which cover the picture anyway, try fewer
MOST_TRIED = 800
FEWEST_CANDIDATES = 2
CELLS = 10  # coverage is counted on a grid of this many cells along each side of a sub-image
FEWEST_CORNERS = 6  # visible in a view, to determine the pose of the board
SMALLEST_SQUARE_PX = 8.0
ROOM_MM = 20.0  # between mirrors and board
_ROOT = 1.1127756842787055  # the positive root of x^7 = x + 1


@dataclass(frozen=True)
class PosePlan:
    """Board poses, rig_from_board (n, 4, 4) in mm, and their visibility in views: the mirrors, or the bare camera.

    `coverage` (views,) is the fraction of each view's picture where some pose shows a corner; `corners` (n, views) is
    the number of visible corners of each pose.
    """

    poses: FloatArray
    coverage: FloatArray
    corners: NDArray[np.int64]


def reaches(plan: PosePlan, target: Target, forward: FloatArray) -> tuple[Reach, ...]:
    """Return the range of depths and the largest tilt at which each view shows `FEWEST_CORNERS` corners or more.

    Depth is measured to the board's centre along the unit vector `forward` (3,) in rig; tilt is the angle between the
    board's normal and this vector. Both are rounded to mm and degrees, the precision of a board held by hand.
    """
    middle = np.array([*target.size_mm, 0.0, 2.0]) / 2.0
    depths = (plan.poses @ middle)[:, :3] @ forward
    tilts = np.degrees(np.arccos(np.clip(plan.poses[:, :3, 2] @ forward, -1.0, 1.0)))
    found = []
    for corners in plan.corners.T:
        shown = corners >= FEWEST_CORNERS
        if not shown.any():
            found.append(Reach(nearest_mm=0, farthest_mm=0, tilt_deg=0))
            continue
        near, far, tilt = (round(float(v)) for v in (depths[shown].min(), depths[shown].max(), tilts[shown].max()))
        found.append(Reach(nearest_mm=near, farthest_mm=far, tilt_deg=tilt))
    return tuple(found)


def plan_frames(layout: Layout, target: Target, count: int, random: np.random.Generator) -> PosePlan:
    """Plan poses in front of the mirrors, around the depths of the spec, with the printed side toward the mirrors.

    Raises InputError if the board is too small or too large.
    """
    depths = _depths(layout)
    nearest = max(float((m.outline_in_rig_mm @ layout.view_from_rig[2]).max()) for m in layout.mirrors) + ROOM_MM
    oracle = Oracle(layout, target)
    half = np.array(target.size_mm) / 2.0

    def pose(numbers: FloatArray) -> FloatArray | None:
        # Equal steps of 1 / depth are equal steps in the size of the image.
        depth = 1.0 / np.interp(numbers[0], [0.0, 1.0], [1.0 / depths[0], 1.0 / depths[1]])
        field = common_bounds(layout, depth)
        play = np.maximum(np.abs(np.diff(field, axis=0)[0] / 2.0 - half), 0.25 * half)
        centre = np.array([*(field.mean(axis=0) + play * (2.0 * numbers[1:3] - 1.0)), depth])
        found = _rig_from_board(layout.view_from_rig, target, centre, numbers[3:])
        outline = np.array([[x, y, 0.0, 1.0] for x in (0.0, 2 * half[0]) for y in (0.0, 2 * half[1])])
        return found if (outline @ found[:3].T @ layout.view_from_rig[2]).min() > nearest else None

    views = [layout.outline_px(index) for index in range(len(layout.mirrors))]
    plan = _choose(pose, oracle.via_mirrors, views, count, random)
    _check_visible(target, plan, oracle.via_mirrors, views, "mirror")
    return plan


def plan_of(layout: Layout, target: Target, poses: FloatArray) -> PosePlan:
    """Evaluate given poses, rig_from_board (n, 4, 4) in mm; raise InputError if no corner is ever visible."""
    oracle = Oracle(layout, target)
    cells = [_Cells(layout.outline_px(index)) for index in range(len(layout.mirrors))]
    covered = np.zeros((len(cells), CELLS, CELLS), dtype=np.bool_)
    corners = np.zeros((len(poses), len(cells)), dtype=np.int64)
    for number, pose in enumerate(poses):
        px, visible = oracle.via_mirrors(pose)
        corners[number] = visible.sum(axis=1)
        covered |= [cell.hit(px[index][visible[index]]) for index, cell in enumerate(cells)]
    if not covered.any():
        raise InputError(f"none of {len(poses)} poses shows a corner of the board to a mirror")
    return PosePlan(poses, _shares(cells, covered), corners)


def plan_base_frames(layout: Layout, target: Target, count: int, random: np.random.Generator) -> PosePlan:
    """Plan poses in front of the bare camera with corners all over its sensor, at several distances and tilts.

    Raises InputError if the board is too small or too large.
    """
    camera = layout.camera
    oracle = Oracle(layout, target)
    size = np.array([camera.width_px, camera.height_px])
    focal = np.array([camera.fx_px, camera.fy_px])
    filling_mm = float(np.max(np.array(target.size_mm) * focal / size))  # distance at which the board fills the picture

    def pose(numbers: FloatArray) -> FloatArray | None:
        distance = filling_mm / (0.45 + 0.5 * numbers[0])
        shift = size / focal * distance / 2.0 - 0.35 * np.array(target.size_mm)
        centre = np.array([*(np.maximum(shift, 0.0) * (2.0 * numbers[1:3] - 1.0)), distance])
        return _rig_from_board(np.eye(3), target, centre, numbers[3:])

    def seen(rig_from_board: FloatArray) -> tuple[FloatArray, BoolArray]:
        px, visible = oracle.direct(rig_from_board)
        return px[None], visible[None]

    far_x, far_y = size - 1.0
    views = [np.array([[0.0, 0.0], [far_x, 0.0], [far_x, far_y], [0.0, far_y]])]
    plan = _choose(pose, seen, views, count, random)
    _check_visible(target, plan, seen, views, "camera")
    return plan


def _depths(layout: Layout) -> tuple[float, float]:
    """Return the nearest and farthest depth of the board's centre: slightly beyond the range of the spec."""
    if layout.spec is not None:
        return 0.92 * min(layout.spec.depths_mm), 1.15 * max(layout.spec.depths_mm)
    scale = layout.mirrors[layout.central_index].distance_mm * np.sqrt(2.0)
    return 3.5 * scale, 7.0 * scale


def _rig_from_board(
    view_from_rig: FloatArray, target: Target, centre_in_view: FloatArray, numbers: FloatArray
) -> FloatArray:
    """Return the pose of a board centred at a point, with tilts and roll given by three numbers in [0, 1]."""
    tilts = (2.0 * numbers - 1.0) * [MOST_TILT_DEG, MOST_TILT_DEG, MOST_ROLL_DEG]
    view_from_board = Rotation.from_euler("xyz", tilts, degrees=True).as_matrix()
    rotation = view_from_rig.T @ view_from_board
    middle = np.array([*target.size_mm, 0.0]) / 2.0
    return rigid(rotation, view_from_rig.T @ centre_in_view - rotation @ middle)


class _Cells:
    """Coverage cells of a view's picture: a grid over its bounds; cells with their centre inside the outline count."""

    def __init__(self, outline_px: FloatArray) -> None:
        self.low, high = outline_px.min(axis=0), outline_px.max(axis=0)
        self.step = (high - self.low) / CELLS
        y, x = np.mgrid[:CELLS, :CELLS]
        middles = self.low + (np.stack([x, y], axis=-1) + 0.5) * self.step
        self.inside: BoolArray = shapely.contains_xy(shapely.Polygon(outline_px), middles[..., 0], middles[..., 1])

    def hit(self, px: FloatArray) -> BoolArray:
        """Return the mask (CELLS, CELLS) of the cells that contain one of the points `px` (n, 2)."""
        at = np.floor((px - self.low) / self.step).astype(int)
        at = at[((at >= 0) & (at < CELLS)).all(axis=1)]
        found = np.zeros((CELLS, CELLS), dtype=np.bool_)
        found[at[:, 1], at[:, 0]] = True
        return found & self.inside


def _choose(
    pose: Callable[[FloatArray], FloatArray | None],
    seen: Callable[[FloatArray], tuple[FloatArray, BoolArray]],
    outlines_px: list[FloatArray],
    count: int,
    random: np.random.Generator,
) -> PosePlan:
    """Choose, for each frame, the candidate pose that shows corners where previous frames showed none.

    A pose has six numbers in [0, 1]: depth, position (2), tilt (2), roll. The depths of the frames are spread evenly.
    """
    cells = [_Cells(outline) for outline in outlines_px]
    covered = np.zeros((len(cells), CELLS, CELLS), dtype=np.bool_)
    # A shifted R6 sequence (Roberts): a low-discrepancy sequence for any number of points.
    steps = _ROOT ** -np.arange(1.0, 7.0)
    candidates = int(np.clip(MOST_TRIED // max(count, 1), FEWEST_CANDIDATES, CANDIDATES))
    numbers = (random.random(6) + np.arange(candidates * count)[:, None] * steps) % 1.0
    numbers = numbers.reshape(candidates, count, 6)
    numbers[..., 0] = (random.permutation(count) + numbers[..., 0]) / max(count, 1)
    poses: list[FloatArray] = []
    corners = np.zeros((count, len(cells)), dtype=np.int64)
    for frame in range(count):
        best, best_gain = None, (-1, -1.0)
        for candidate in numbers[:, frame]:
            rig_from_board = pose(candidate)
            if rig_from_board is None:
                continue
            px, visible = seen(rig_from_board)
            hits = np.array([cell.hit(px[i][visible[i]]) for i, cell in enumerate(cells)])
            # Prefer enough corners in every view, then new cells.
            poorest = int(np.minimum(visible.sum(axis=1), FEWEST_CORNERS).sum())
            gain = (poorest, float((hits & ~covered).sum() + 0.05 * hits.sum()))
            if gain > best_gain:
                best, best_gain, best_hits = rig_from_board, gain, hits
                corners[frame] = visible.sum(axis=1)
        if best is None:
            raise InputError("board: too large to fit in front of the mirrors without touching them")
        poses.append(best)
        covered |= best_hits
    return PosePlan(np.array(poses).reshape(count, 4, 4), _shares(cells, covered), corners)


def _shares(cells: list[_Cells], covered: BoolArray) -> FloatArray:
    """Return the covered fraction (views,) of the cells of each view's picture."""
    return np.array([float(hits[cell.inside].mean()) for hits, cell in zip(covered, cells, strict=True)])


def _check_visible(
    target: Target,
    plan: PosePlan,
    seen: Callable[[FloatArray], tuple[FloatArray, BoolArray]],
    outlines_px: list[FloatArray],
    what: str,
) -> None:
    """Raise InputError if the board's squares are not resolved, or a view shows too few corners in most frames."""
    if not len(plan.poses):
        return
    enough: list[NDArray[np.bool_]] = []
    squares_px = []
    for pose in plan.poses:
        px, visible = seen(pose)
        enough.append(visible.sum(axis=1) >= min(FEWEST_CORNERS, px.shape[1]))
        cols, rows = target.corner_counts
        across = px.reshape(len(px), rows, cols, 2)
        sides = np.linalg.norm(np.diff(across, axis=2), axis=-1).reshape(len(px), -1)
        squares_px.append(np.nanmedian(np.where(np.isfinite(sides), sides, np.nan)))
    square_px = float(np.median(squares_px))
    board = f"board of {target.layout_text}"
    if square_px < SMALLEST_SQUARE_PX:
        raise InputError(
            f"{board}: too small to be seen, a square spans {square_px:.1f} px, expected {SMALLEST_SQUARE_PX:g} or more"
        )
    poorest = int(np.argmin(np.mean(enough, axis=0)))
    if np.mean(enough, axis=0)[poorest] < 0.25:
        span = np.ptp(outlines_px[poorest], axis=0).min()
        size = "large" if square_px > span / 4.0 else "small"
        raise InputError(
            f"{board}: too {size} to be seen, {what} {poorest} shows {FEWEST_CORNERS} corners in too few frames"
        )
