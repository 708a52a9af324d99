"""What the next picture should show: the pose of the board that fills most of what the pictures so far left empty."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from optics.calibration import bootstrap
from optics.calibration.detection.corners import MIN_CORNERS, Corners
from optics.calibration.observations import Observations
from optics.layout import Layout
from optics.targets import Charuco, Checkerboard
from optics.transforms import transform
from optics.values import FloatArray, InputError

BoolArray = NDArray[np.bool_]

CELLS = 6  # along each side of a sub-image, in which corners are counted
TILT_DEG = 30.0
TILTS = ((0.0, 0.0), (TILT_DEG, 0.0), (-TILT_DEG, 0.0), (0.0, TILT_DEG), (0.0, -TILT_DEG))
SHIFTS = (-0.6, 0.0, 0.6)  # of half the board's size
NEW_ATTITUDE = 0.15  # of all cells: what a depth and tilt that no picture has is worth
SAME_TILT_DEG, SAME_DEPTH = 15.0, 0.12  # pictures that differ by less tell the same
ENOUGH = 0.9  # part of the cells of every mirror


@dataclass(frozen=True)
class Hint:
    """What to show next.

    `rig_from_board` (4, 4), mm, is the pose; `mirror` the one that gains most; `covered` (mirrors,) the part of each
    sub-image in which corners were seen so far.
    """

    sentence: str
    rig_from_board: FloatArray
    depth_mm: float
    tilt_deg: tuple[float, float]
    mirror: int
    covered: FloatArray

    @property
    def enough(self) -> bool:
        """Whether the pictures so far have filled every mirror, so that another one adds little."""
        return bool((self.covered >= ENOUGH).all())


def next_picture(seen: Sequence[Observations], layout: Layout, target: Charuco | Checkerboard) -> Hint:
    """The hint after pictures in which these corners were seen, each as frame 0 of its own.

    Of poses at three depths, five tilts and nine places, the one whose corners fall into most empty cells of the
    sub-images, those of the emptiest mirrors before others; a depth and tilt that no picture had yet counts in its
    favour, for what is seen from one side alone tells little. `layout` need not be exact: the nominal one will do.
    """
    grids = _grids(layout)
    filled = [np.zeros((CELLS, CELLS), dtype=bool) for _ in grids]
    for picture in seen:
        for mirror, grid in enumerate(grids):
            filled[mirror] |= grid.hit(picture.pixels[picture.view == mirror])
    covered = np.array([hit[grid.inside].mean() for hit, grid in zip(filled, grids, strict=True)])
    held = [attitude for picture in seen if (attitude := _attitude(picture, layout, target)) is not None]

    best: tuple[float, FloatArray, float, tuple[float, float], FloatArray] | None = None
    for pose, depth_mm, tilt in _candidates(layout, target):
        points = transform(pose, target.corners_in_board_mm)
        gains = np.zeros(len(grids))
        for mirror, grid in enumerate(grids):
            pixels = grid.shown(layout.project(points, mirror))
            if len(pixels) >= MIN_CORNERS:
                gains[mirror] = (grid.hit(pixels) & ~filled[mirror]).sum() / grid.inside.sum()
        new = all(
            abs(np.log(depth_mm / depth)) > SAME_DEPTH or np.hypot(*np.subtract(tilt, other)) > SAME_TILT_DEG
            for depth, other in held
        )
        worth = float((gains * (1.5 - covered)).sum()) + NEW_ATTITUDE * len(grids) * new
        if best is None or worth > best[0]:
            best = worth, pose, depth_mm, tilt, gains * (1.5 - covered)
    assert best is not None  # there are always candidates
    _, pose, depth_mm, tilt, gains = best
    mirror = int(np.argmax(gains)) if gains.any() else int(np.argmin(covered))
    sentence = (
        f"next: the board at about {round(depth_mm, -1):.0f} mm, {_tilt_in_words(tilt)}, so that mirror {mirror} "
        f"({_place_in_words(layout, mirror)} of the picture, {covered[mirror]:.0%} filled) is filled"
    )
    return Hint(sentence, pose, depth_mm, tilt, mirror, covered)


@dataclass(frozen=True)
class _Grid:
    """The cells of a sub-image: a grid over its bounds, of which those with their middle inside count."""

    region: shapely.Polygon
    low: FloatArray
    step: FloatArray
    inside: BoolArray

    def shown(self, pixels: FloatArray) -> FloatArray:
        """Those of pixels (n, 2) that lie in the sub-image."""
        return pixels[shapely.contains_xy(self.region, *np.nan_to_num(pixels, nan=-1e9).T)]

    def hit(self, pixels: FloatArray) -> BoolArray:
        """Which cells (CELLS, CELLS) hold one of the pixels (n, 2)."""
        at = np.clip(np.floor((pixels - self.low) / self.step).astype(int), 0, CELLS - 1)
        found = np.zeros((CELLS, CELLS), dtype=bool)
        found[at[:, 1], at[:, 0]] = True
        return found & self.inside


@lru_cache(maxsize=2)
def _grids_of(layout_json: str) -> tuple[_Grid, ...]:
    layout = Layout.model_validate_json(layout_json)
    sensor = shapely.box(0.0, 0.0, layout.camera.width_px - 1.0, layout.camera.height_px - 1.0)
    grids = []
    for index in range(len(layout.mirrors)):
        outline = layout.outline_px(index)
        region = shapely.Polygon(outline[np.isfinite(outline).all(axis=1)]).intersection(sensor)
        if region.is_empty:
            raise InputError(f"mirror {index} of the layout lies outside the sensor, expected all mirrors on it")
        low_x, low_y, high_x, high_y = region.bounds
        low, step = np.array([low_x, low_y]), np.array([high_x - low_x, high_y - low_y]) / CELLS
        y, x = np.mgrid[:CELLS, :CELLS] + 0.5
        inside = shapely.contains_xy(region, low[0] + x * step[0], low[1] + y * step[1])
        grids.append(_Grid(region, low, step, np.asarray(inside)))
    return tuple(grids)


def _grids(layout: Layout) -> tuple[_Grid, ...]:
    return _grids_of(layout.model_dump_json(by_alias=True))


def _attitude(
    picture: Observations, layout: Layout, target: Charuco | Checkerboard
) -> tuple[float, tuple[float, float]] | None:
    """Depth of the board's middle in mm and tilts about view x and y in degrees, as the layout has them."""
    views = []
    for mirror in np.unique(picture.view).tolist():
        of_view = picture.view == mirror
        if of_view.sum() >= MIN_CORNERS:
            corners = Corners(picture.corner[of_view], picture.pixels[of_view])
            views.append((layout.mirrors[mirror].apparent, corners))
    if not views:
        return None
    pose = bootstrap.best_pose(layout.camera, views, target.corners_in_board_mm)
    turn = layout.view_from_rig @ pose[:3, :3]
    depth = float(layout.view_from_rig[2] @ transform(pose, target.corners_in_board_mm.mean(axis=0, keepdims=True))[0])
    # Where the board's own axis into the paper points: how it is rolled does not matter.
    about_x, about_y = np.degrees(np.arctan2([-turn[1, 2], turn[0, 2]], turn[2, 2])).tolist()
    return max(depth, 1.0), (about_x, about_y)


def _candidates(
    layout: Layout, target: Charuco | Checkerboard
) -> Iterator[tuple[FloatArray, float, tuple[float, float]]]:
    """Poses, rig_from_board (4, 4), with the depth of their middle in mm and their tilts in degrees."""
    depths = (300.0, 500.0) if layout.spec is None else (min(layout.spec.depths_mm), max(layout.spec.depths_mm))
    half = np.array([*target.size_mm, 0.0]) / 2.0
    middle = layout.virtual_centres_in_view_mm.reshape(-1, 3).mean(axis=0)
    for depth_mm in np.geomspace(0.95 * depths[0], 1.1 * depths[1], 3).tolist():
        for tilt in TILTS:
            turn = Rotation.from_euler("xy", tilt, degrees=True).as_matrix()
            for x in SHIFTS:
                for y in SHIFTS:
                    centre = np.array([middle[0] + x * half[0], middle[1] + y * half[1], depth_mm])
                    pose = np.eye(4)
                    pose[:3, :3] = layout.view_from_rig.T @ turn
                    pose[:3, 3] = layout.view_from_rig.T @ (centre - turn @ half)
                    yield pose, depth_mm, tilt


def _tilt_in_words(tilt_deg: tuple[float, float]) -> str:
    about_x, about_y = tilt_deg
    if about_x == about_y == 0.0:
        return "facing the mirrors"
    edges = ("upper", "lower") if about_x else ("right", "left")
    edge = edges[0 if about_x + about_y > 0 else 1]
    return f"its {edge} edge (as the camera sees it) tilted {max(abs(about_x), abs(about_y)):.0f}° towards the mirrors"


def _place_in_words(layout: Layout, mirror: int) -> str:
    middles = np.array([np.nanmean(layout.outline_px(i), axis=0) for i in range(len(layout.mirrors))])
    size = np.array([layout.camera.width_px, layout.camera.height_px])
    x, y = middles[mirror] / size
    row = "upper" if y < 0.38 else "lower" if y > 0.62 else ""
    column = "left" if x < 0.38 else "right" if x > 0.62 else ""
    return f"{row} {column}".strip() or "middle"
