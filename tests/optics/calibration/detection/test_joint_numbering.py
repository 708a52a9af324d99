"""Joint numbering of parts from all views, on corners projected by mirrors tilted by up to two degrees."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.detection.detections import FLIP, QUARTER_ROTATIONS, DetectedFrame, DetectedGrid
from mirrorcam.optics.calibration.detection.joint_numbering import number_jointly
from mirrorcam.optics.calibration.solver.observations import DIRECT, Corners, IntArray, Observations
from mirrorcam.optics.geometry.boards import Checkerboard
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.transforms import transform
from tests.optics.layouts import faceted_parabola
from tests.optics.synthetic import posed

CAMERA = Camera(width_px=1280, height_px=720, fx_px=900.0, fy_px=900.0, cx_px=639.5, cy_px=359.5)
NOMINAL = faceted_parabola(CAMERA, DesignSpec(camera=CAMERA, rows=2, cols=2), fill=0.92)
BUILT = NOMINAL.replaced(
    kind="as-built",
    mirrors=tuple(
        mirror.moved(Rotation.from_rotvec(np.radians(1.5) * np.array(axis)).as_matrix(), np.zeros(3))
        for mirror, axis in zip(NOMINAL.mirrors, ((1, 0, 0), (0, 0, 1), (-0.7, 0, 0.7), (0, 0, -1)), strict=True)
    ),
)
BOARD = Checkerboard(cols=13, rows=10, square_mm=14.0)
UNKNOWN = np.array([[-np.inf, -np.inf], [np.inf, np.inf]])


def seen_part(ids: IntArray, pixels: FloatArray, random: np.random.Generator) -> DetectedGrid:
    """Return a grid with its own coordinates, as seen in a picture through a mirror."""
    row, col = np.divmod(ids, BOARD.cols - 1)
    printed = np.stack([col, row], axis=1)
    turn = int(random.integers(4))
    by = random.integers(-9, 9, 2)
    # On a print, black is right of and below even corners; on a grid, white, in the handedness of the picture.
    by[0] += (by.sum() + turn) % 2 == 0
    return DetectedGrid(
        (printed @ QUARTER_ROTATIONS[turn].T + by - [1, 0]) @ FLIP, Corners(np.arange(len(ids)), pixels), UNKNOWN
    )


@lru_cache
def frames(count: int, *, cut: float) -> tuple[list[DetectedFrame], list[dict[int, IntArray]], list[DetectedFrame]]:
    """Return frames with the unnumbered corners well inside each sub-image, their ids, and other pictures."""
    random = np.random.default_rng(0)
    detected, truth = [], []
    for _ in range(count):
        middle = np.array([random.uniform(-20, 20), random.uniform(280, 420), random.uniform(70, 110)])
        pose = posed(BOARD, middle, np.array([*random.uniform(-25, 25, 2), random.uniform(-40, 40)]), direct=False)
        points = transform(pose, BOARD.corners_in_board_mm)
        grids: list[tuple[int, DetectedGrid]] = []
        ids: dict[int, IntArray] = {}
        for mirror in range(len(BUILT.mirrors)):
            pixels = BUILT.project(points, mirror) + random.normal(0.0, 0.02, (len(points), 2))
            outline = BUILT.outline_px(mirror)
            low, high = outline.min(axis=0), outline.max(axis=0)
            middle_px, half = (low + high) / 2.0, (high - low) / 2.0 * cut
            shown: IntArray = np.flatnonzero((np.abs(pixels - middle_px) < half).all(axis=1))
            if len(shown) >= 6:
                grids.append((mirror, seen_part(shown, pixels[shown], random)))
                ids[mirror] = shown
        detected.append(DetectedFrame(Observations.empty(), grids=tuple(grids)))
        truth.append(ids)
    base = []
    for turn in ([20.0, 0.0, 0.0], [-20.0, 10.0, 5.0], [0.0, 25.0, 50.0], [5.0, -25.0, 0.0]):
        pose = posed(BOARD, np.array([0.0, 0.0, 320.0]), np.array(turn), direct=True)
        pixels = CAMERA.project(transform(pose, BOARD.corners_in_board_mm))
        base.append(DetectedFrame(Observations.of_view(0, DIRECT, np.arange(len(pixels)), pixels)))
    return detected, truth, base


def test_parts_that_no_view_alone_can_number_are_numbered_jointly() -> None:
    detected, truth, base = frames(8, cut=0.7)
    alone = [len(grid.numberings(BOARD, mirrored=True)) == 1 for frame in detected for _, grid in frame.grids]
    assert sum(alone) < 0.35 * len(alone)
    found = number_jointly(detected, base, NOMINAL, BOARD)
    complete = 0
    for frame, ids in zip(found, truth, strict=True):
        for mirror in np.unique(frame.corners.view):
            np.testing.assert_array_equal(frame.corners.corner[frame.corners.view == mirror], ids[mirror])
        complete += set(frame.corners.view.tolist()) == set(ids)
    assert complete >= 5


def test_ambiguous_parts_are_left_out() -> None:
    """Small parts in the middle of the board fit anywhere on it."""
    detected, _, base = frames(8, cut=0.35)
    assert not any(len(frame.corners) for frame in number_jointly(detected, base, NOMINAL, BOARD))


def test_few_frames_number_nothing() -> None:
    detected, _, base = frames(8, cut=0.7)
    assert not any(len(frame.corners) for frame in number_jointly(detected[:3], base, NOMINAL, BOARD))


def test_a_frame_that_contradicts_itself_is_left_out() -> None:
    """Its views jointly cover more than the stated board."""
    detected, _, _ = frames(8, cut=0.7)
    smaller = BOARD.replaced(cols=11, rows=8)
    corners = Observations.of_view(0, 0, np.arange(6), np.arange(12.0).reshape(6, 2))
    frames_of = [DetectedFrame(corners, grids=frame.grids) for frame in detected]
    found = number_jointly(frames_of, [], NOMINAL, smaller)
    assert sum(len(frame.corners) == 0 for frame in found) >= 5


@pytest.mark.parametrize("grids", [(), None])
def test_frames_without_grids_are_returned_as_they_are(grids: tuple[()] | None) -> None:
    frame = DetectedFrame(Observations.of_view(0, 0, np.arange(6), np.arange(12.0).reshape(6, 2)))
    several = [frame] if grids is None else [frame, DetectedFrame(Observations.empty(), grids=grids)]
    assert number_jointly(several, [], NOMINAL, BOARD) == several
