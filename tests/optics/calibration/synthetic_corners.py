"""Corners of a board in many frames, as an exact projection with Gaussian noise: calibration without pictures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation
from shapely import contains_xy
from shapely.geometry import Polygon

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.solver.observations import DIRECT, MIN_CORNERS, Observations
from mirrorcam.optics.geometry.boards import Charuco, Checkerboard
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.transforms import transform
from tests.optics.synthetic import posed

MARGIN = 0.95  # of an outline or sensor, about its middle, within which corners count as seen


@dataclass(frozen=True)
class Views:
    """Corners of frames with and without mirrors, and the poses of their boards."""

    mirrored: list[Observations]
    base: list[Observations]


def mirrored_corners(
    truth: Layout, board: Checkerboard | Charuco, pose: FloatArray, noise_px: float, random: np.random.Generator
) -> Observations:
    """Return the corners of a frame in every mirror that shows enough, with noise of `noise_px` per axis."""
    points = transform(pose, board.corners_in_board_mm)
    parts = []
    for index, mirror in enumerate(truth.mirrors):
        pixels = truth.camera.project(mirror.image_of(points))
        polygon = Polygon(truth.outline_px(index))
        middle = np.array(polygon.centroid.coords[0])
        shown = (pixels - middle) / MARGIN + middle
        ids = np.flatnonzero(contains_xy(polygon, shown[:, 0], shown[:, 1]))
        if len(ids) >= MIN_CORNERS:
            parts.append(Observations.of_view(0, index, ids, pixels[ids]))
    return noisy(Observations.join(parts), noise_px, random)


def direct_corners(
    truth: Layout, board: Checkerboard | Charuco, pose: FloatArray, noise_px: float, random: np.random.Generator
) -> Observations:
    """Return the corners of a frame of the bare camera, with noise of `noise_px` per axis."""
    pixels = truth.camera.project(transform(pose, board.corners_in_board_mm))
    size = np.array([truth.camera.width_px, truth.camera.height_px])
    ids = np.flatnonzero((np.abs(pixels - (size - 1) / 2.0) < MARGIN * size / 2.0).all(axis=1))
    if len(ids) < MIN_CORNERS:
        return Observations.empty()
    return noisy(Observations.of_view(0, DIRECT, ids, pixels[ids]), noise_px, random)


def noisy(observations: Observations, noise_px: float, random: np.random.Generator) -> Observations:
    noise = noise_px * random.standard_normal((len(observations), 2))
    return Observations(observations.frame, observations.view, observations.corner, observations.pixels + noise)


def mirrored_poses(board: Checkerboard | Charuco, count: int, *, tilt_deg: float, seed: int) -> list[FloatArray]:
    """Boards 300 to 450 mm before the mirrors of the default scale, tilted by up to `tilt_deg` about each axis."""
    random = np.random.default_rng(seed)
    centres = np.array([0.0, 370.0, 80.0]) + np.array([30.0, 70.0, 20.0]) * random.uniform(-1, 1, (count, 3))
    turns = tilt_deg * random.uniform(-1, 1, (count, 3))
    return [posed(board, centre, turn, direct=False) for centre, turn in zip(centres, turns, strict=True)]


def direct_poses(board: Checkerboard | Charuco, count: int, *, tilt_deg: float, seed: int) -> list[FloatArray]:
    """Boards 250 to 400 mm before the bare camera, tilted by up to `tilt_deg` about each axis."""
    random = np.random.default_rng(seed)
    centres = np.array([0.0, 0.0, 320.0]) + np.array([30.0, 15.0, 70.0]) * random.uniform(-1, 1, (count, 3))
    turns = tilt_deg * random.uniform(-1, 1, (count, 3))
    return [posed(board, centre, turn, direct=True) for centre, turn in zip(centres, turns, strict=True)]


def views_of(
    truth: Layout,
    board: Checkerboard | Charuco,
    mirrored: Sequence[FloatArray],
    direct: Sequence[FloatArray],
    *,
    noise_px: float = 0.05,
    seed: int = 0,
) -> Views:
    """The corners of frames with the board at `mirrored` poses, and of base frames at `direct` ones."""
    random = np.random.default_rng(seed)
    return Views(
        [mirrored_corners(truth, board, pose, noise_px, random) for pose in mirrored],
        [direct_corners(truth, board, pose, noise_px, random) for pose in direct],
    )


def as_built(nominal: Layout, *, tilt_deg: float = 0.3, offset_mm: float = 0.3, seed: int = 0) -> Layout:
    """Return the layout with every mirror slightly tilted and shifted, and another lens."""
    random = np.random.default_rng(seed)
    mirrors = tuple(
        mirror.moved(
            Rotation.from_rotvec(np.radians(tilt_deg) * random.standard_normal(3)).as_matrix(),
            offset_mm * random.standard_normal() * mirror.normal_in_rig,
        )
        for mirror in nominal.mirrors
    )
    camera = nominal.camera
    return nominal.replaced(
        kind="as-built",
        mirrors=mirrors,
        camera=camera.replaced(
            fx_px=1.004 * camera.fx_px,
            fy_px=1.005 * camera.fy_px,
            cx_px=camera.cx_px - 4.0,
            cy_px=camera.cy_px + 3.0,
            distortion=[0.04, -0.09, 4e-4, -3e-4, 0.0],
        ),
    )
