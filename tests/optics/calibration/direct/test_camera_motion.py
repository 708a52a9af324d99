"""A camera that turned between pictures is turned back by what stood still, whatever moved in front of it."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from scipy.ndimage import gaussian_filter
from scipy.spatial.transform import Rotation

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.detection.checkerboard import Grey
from mirrorcam.optics.calibration.direct.camera_motion import camera_rotations, stabilised
from mirrorcam.optics.calibration.solver.observations import DIRECT, Observations
from mirrorcam.optics.geometry.camera import Camera

CAMERA = Camera(width_px=640, height_px=400, fx_px=500.0, fy_px=502.0, cx_px=321.0, cy_px=197.0)
TURN_RAD = np.array([1.5e-3, -2.2e-3, 3.0e-3])


def texture(seed: int, shape: tuple[int, int]) -> FloatArray:
    drawn = gaussian_filter(np.random.default_rng(seed).standard_normal(shape), 2.0)
    return 128.0 + 40.0 * drawn / drawn.std()


def turned(scene: FloatArray, turn: FloatArray) -> FloatArray:
    """What the camera sees of a far scene once its rays are found turned by a rotation vector."""
    homography = CAMERA.matrix @ Rotation.from_rotvec(turn).as_matrix() @ np.linalg.inv(CAMERA.matrix)
    size = (CAMERA.width_px, CAMERA.height_px)
    return np.asarray(
        cv2.warpPerspective(scene, homography, size, flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT)
    )


def grey(image: FloatArray, seed: int) -> Grey:
    noisy = image + np.random.default_rng(seed).standard_normal(image.shape)
    return np.clip(np.rint(noisy), 0, 255).astype(np.uint8)


def pictures(moved_px: int) -> list[Grey]:
    """Two pictures; in the second, a board of two fifths of the picture moved, with more texture than all else."""
    scene, board = texture(1, (400, 640)), texture(2, (240, 380))
    first, second = scene.copy(), turned(scene, TURN_RAD)
    first[100:340, 60:440] = board
    second[100:340, 60 + moved_px : 440 + moved_px] = board
    return [grey(first, 3), grey(second, 4)]


def test_a_turn_is_found_though_much_of_the_picture_moved_otherwise() -> None:
    turns = camera_rotations(pictures(moved_px=3), CAMERA)
    assert turns is not None
    np.testing.assert_array_equal(turns[0], 0.0)
    np.testing.assert_allclose(turns[1], TURN_RAD, atol=0.05 / 500.0)


def test_pictures_with_nothing_in_common_tell_no_turn() -> None:
    assert camera_rotations([grey(texture(1, (400, 640)), 1), grey(texture(5, (400, 640)), 2)], CAMERA) is None
    assert camera_rotations([np.full((400, 640), 90, dtype=np.uint8)] * 2, CAMERA) is None


def test_corners_are_turned_back_frame_by_frame() -> None:
    rays = np.array([[0.1, 0.2, 1.0], [-0.3, 0.1, 1.0]])
    turns = np.array([np.zeros(3), TURN_RAD])
    seen = np.concatenate([CAMERA.project(rays @ Rotation.from_rotvec(turn).as_matrix().T) for turn in turns])
    rows = Observations(np.array([0, 0, 1, 1]), np.full(4, DIRECT), np.array([0, 1, 0, 1]), seen)
    still = stabilised(rows, CAMERA, turns)
    np.testing.assert_allclose(still.pixels[:2], still.pixels[2:], atol=1e-9)
    np.testing.assert_allclose(still.pixels[:2], seen[:2], atol=1e-9)
    assert np.abs(seen[2:] - seen[:2]).max() == pytest.approx(1.1, abs=0.5)
