"""Images seen in two mirrors in sequence: rays traced face by face meet the corners."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.solver.residuals import Board, Estimate
from mirrorcam.optics.geometry.mirror import reflect
from mirrorcam.optics.geometry.plate import tangent_in_glass
from mirrorcam.optics.geometry.transforms import transform
from tests.optics.calibration.direct.twice_reflected import on_first_mirror, twice_reflected
from tests.optics.calibration.direct.two_mirrors import BOARD, CAMERA, POSES, corner_of_two_mirrors, lying

CORNERS = BOARD.corners_in_board_mm
DRAWN = Board.rigid(CORNERS)


def estimate_of(thickness_mm: float) -> Estimate:
    mirrors = corner_of_two_mirrors(80.0).mirrors
    if thickness_mm > 0.0:
        mirrors = tuple(m.replaced(surface="second", thickness_mm=thickness_mm, refractive_index=1.52) for m in mirrors)
    return Estimate.of(CAMERA, mirrors, np.array([lying(*pose) for pose in POSES]))


def traced(estimate: Estimate, pixels: FloatArray, path: tuple[int, int]) -> tuple[FloatArray, FloatArray]:
    """Return points and directions (n, 3) of rays after both mirrors, traced face by face through their plates."""
    points, rays = np.zeros((len(pixels), 3)), CAMERA.unproject(pixels)
    for mirror in path:
        centre = estimate.virtual_centres_in_rig_mm[mirror]
        normal = -centre / np.linalg.norm(centre)
        rays = rays / np.linalg.norm(rays, axis=1, keepdims=True)
        thickness = estimate.thickness_mm[mirror]
        height = points @ normal + np.linalg.norm(centre) / 2.0 - thickness
        along = -(rays @ normal)
        points = points + (height / along)[:, None] * rays  # on the front
        across = rays + along[:, None] * normal
        size = np.linalg.norm(across, axis=1)
        inner = tangent_in_glass(size / along, estimate.refractive_index[mirror])
        points = points + (2.0 * thickness * inner / size)[:, None] * across  # down to the coating and up again
        rays = rays + 2.0 * along[:, None] * normal
    return points, rays


@pytest.mark.parametrize("thickness_mm", [0.0, 5.0])
@pytest.mark.parametrize("path", [(0, 1), (1, 0)])
def test_the_light_of_two_mirrors_meets_the_corners(thickness_mm: float, path: tuple[int, int]) -> None:
    estimate = estimate_of(thickness_mm)
    pixels = twice_reflected(estimate, DRAWN, 0, path)
    points, rays = traced(estimate, pixels, path)
    corners = transform(estimate.rig_from_board[0], CORNERS)
    off = np.cross(corners - points, rays)
    assert np.linalg.norm(off, axis=1).max() < 1e-6


def test_without_plates_it_is_two_reflections() -> None:
    estimate = estimate_of(0.0)
    a, b = estimate.virtual_centres_in_rig_mm
    points = transform(estimate.rig_from_board[1], CORNERS)
    expected = CAMERA.project(reflect(reflect(points, b), a))
    np.testing.assert_allclose(twice_reflected(estimate, DRAWN, 1, (0, 1)), expected, atol=1e-9)


def test_the_left_mirror_is_met_first_on_the_left() -> None:
    estimate = estimate_of(0.0)
    pixels = np.array([[CAMERA.cx_px - 100.0, 400.0], [CAMERA.cx_px + 100.0, 400.0]])
    assert on_first_mirror(estimate, pixels, (0, 1)).tolist() == [True, False]
    assert on_first_mirror(estimate, pixels, (1, 0)).tolist() == [False, True]
