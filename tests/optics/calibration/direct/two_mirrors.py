"""Two upright mirrors that meet before a camera, and boards that it sees directly and in both."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.detection.checkerboard import Grey
from mirrorcam.optics.calibration.solver.observations import DIRECT, Observations
from mirrorcam.optics.calibration.solver.residuals import Board, Estimate, residuals
from mirrorcam.optics.geometry.boards import Charuco, Checkerboard
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror import Mirror
from mirrorcam.optics.geometry.transforms import rigid, transform
from tests.optics.calibration.detection.aprilgrid_sheet import Sheet
from tests.optics.synthetic import render

BOARD = Checkerboard(cols=8, rows=7, square_mm=20.0)
CAMERA = Camera(
    width_px=1350,
    height_px=900,
    fx_px=1012.5,
    fy_px=1015.5,
    cx_px=663.0,
    cy_px=61.5,
    distortion=[-0.08, 0.05, 0, 0, 0],
)


def corner_of_two_mirrors(opening_deg: float) -> Layout:
    """Two upright mirrors that meet at z = 650 mm before the camera, the left half of the picture in one of them."""
    mirrors = []
    half = np.radians(opening_deg / 2)
    for side, low, high in ((-1, -0.65, -0.005), (1, 0.005, 0.65)):
        normal = np.array([-side * np.cos(half), 0.0, -np.sin(half)])
        plain = np.array([[low, -0.05], [high, -0.05], [high, 0.8], [low, 0.8]])
        rays = np.column_stack([plain, np.ones(4)])
        outline = rays * ((normal @ [0.0, 0.0, 650.0]) / (rays @ normal))[:, None]
        mirrors.append(Mirror.from_plane(np.array([0.0, 0.0, 650.0]), normal, outline_in_rig_mm=outline))
    return Layout(rows=1, cols=2, camera=CAMERA, mirrors=tuple(mirrors), view_from_rig=np.eye(3))


# Middle of the board in mm; then its slope towards the camera, rotation on that slope and sideways tilt, in degrees.
POSES = [
    ((10.0, 270.0, 450.0), (-84.0, 30.0, 0.0)),
    ((-15.0, 265.0, 440.0), (-78.0, -25.0, 6.0)),
    ((15.0, 280.0, 460.0), (-86.0, 75.0, -6.0)),
    ((0.0, 260.0, 440.0), (-75.0, 10.0, 4.0)),
    ((-10.0, 275.0, 450.0), (-90.0, 120.0, 0.0)),
]


def lying(centre: tuple[float, ...], turns_deg: tuple[float, ...]) -> FloatArray:
    """Return rig_from_board (4, 4) of a board before the mirrors, with its print towards camera and mirrors."""
    slope, spin, tilt = turns_deg
    turn = Rotation.from_euler("XYZ", [slope, tilt, spin], degrees=True).as_matrix()
    return rigid(turn, centre - turn @ BOARD.corners_in_board_mm.mean(axis=0))


def corners_of(
    layout: Layout, poses: FloatArray, *, turns: FloatArray | None = None, bows: FloatArray | None = None
) -> tuple[Estimate, Observations]:
    """Return the true model for boards (f, 4, 4) seen directly and in both mirrors, and their exact corners.

    In each frame the camera is rotated by `turns` (f, 3) and the board is bowed by `bows` (f, 3).
    """
    count, frames = len(BOARD.corners_in_board_mm), len(poses)
    parts = [
        Observations.of_view(frame, view, np.arange(count), np.zeros((count, 2)))
        for frame in range(frames)
        for view in (DIRECT, *range(len(layout.mirrors)))
    ]
    rows, none = Observations.join(parts), np.zeros((frames, 3))
    plain = Estimate.of(layout.camera, layout.mirrors, poses)
    truth = replace(plain, camera_rotation=none if turns is None else turns, bow_mm=none if bows is None else bows)
    return truth, replace(rows, pixels=residuals(truth, rows, Board.rigid(BOARD.corners_in_board_mm)))


def moved_by_hand(frames: int, seed: int = 0) -> FloatArray:
    """Poses (f, 4, 4) of a board that lies before the mirrors."""
    random = np.random.default_rng(seed)
    return np.array(
        [
            lying(
                (random.uniform(-20.0, 20.0), random.uniform(255.0, 285.0), random.uniform(430.0, 470.0)),
                (random.uniform(-100.0, -70.0), random.uniform(-180.0, 180.0), random.uniform(-8.0, 8.0)),
            )
            for _ in range(frames)
        ]
    )


def picture_of(layout: Layout, pose: FloatArray, seed: int, board: Checkerboard | Charuco | Sheet = BOARD) -> Grey:
    """The mirrors' picture with the board itself in front of it."""
    through = render(CAMERA, layout, board, pose, noise_grey=1.0, seed=seed)
    direct = render(CAMERA, None, board, pose, noise_grey=1.0, seed=seed)
    size = np.array(board.size_mm)
    outer = np.array([[0.0, 0, 0], [size[0], 0, 0], [*size, 0], [0, size[1], 0]])
    margin = 1.1 * (outer - outer.mean(axis=0)) + outer.mean(axis=0)
    polygon = CAMERA.project(transform(pose, margin))
    rows, cols = np.mgrid[: direct.shape[0], : direct.shape[1]]
    inside = np.ones(direct.shape, dtype=bool)
    for a, b in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
        inside &= (b[0] - a[0]) * (rows - a[1]) - (b[1] - a[1]) * (cols - a[0]) > 0
    return np.where(inside, direct, through).astype(np.uint8)
