"""A camera's rotation between pictures is found from the static scene, despite moving objects."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from scipy.ndimage import gaussian_filter
from scipy.spatial.transform import Rotation

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.detection.checkerboard import Grey
from mirrorcam.optics.calibration.diagnostics.model_selection import ModelSelection, select_model
from mirrorcam.optics.calibration.diagnostics.requested_model import RequestedModel
from mirrorcam.optics.calibration.direct.motion import (
    camera_rotations,
    corner_velocities,
    corrected_to_middle_row,
    rolling_shutter,
    stabilised,
)
from mirrorcam.optics.calibration.solver.observations import DIRECT, Observations
from mirrorcam.optics.calibration.solver.residuals import Board, Estimate, residuals
from mirrorcam.optics.geometry.camera import Camera
from tests.optics.calibration.direct.two_mirrors import (
    BOARD,
    CAMERA,
    corner_of_two_mirrors,
    corners_of,
    moved_by_hand,
)

TRIPOD_CAMERA = Camera(width_px=640, height_px=400, fx_px=500.0, fy_px=502.0, cx_px=321.0, cy_px=197.0)
TURN_RAD = np.array([1.5e-3, -2.2e-3, 3.0e-3])
FRAMES, NOISE_PX = 9, 0.05
DRAWN = Board.rigid(BOARD.corners_in_board_mm)


def texture(seed: int, shape: tuple[int, int]) -> FloatArray:
    drawn = gaussian_filter(np.random.default_rng(seed).standard_normal(shape), 2.0)
    return 128.0 + 40.0 * drawn / drawn.std()


def turned(scene: FloatArray, turn: FloatArray) -> FloatArray:
    """Return the picture of a far scene after a rotation of the camera's rays by a rotation vector."""
    homography = TRIPOD_CAMERA.matrix @ Rotation.from_rotvec(turn).as_matrix() @ np.linalg.inv(TRIPOD_CAMERA.matrix)
    size = (TRIPOD_CAMERA.width_px, TRIPOD_CAMERA.height_px)
    return np.asarray(
        cv2.warpPerspective(scene, homography, size, flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT)
    )


def grey(image: FloatArray, seed: int) -> Grey:
    noisy = image + np.random.default_rng(seed).standard_normal(image.shape)
    return np.clip(np.rint(noisy), 0, 255).astype(np.uint8)


def pictures(moved_px: int) -> list[Grey]:
    """Return two pictures; a board on two fifths of the second moved, with more texture than the scene."""
    scene, board = texture(1, (400, 640)), texture(2, (240, 380))
    first, second = scene.copy(), turned(scene, TURN_RAD)
    first[100:340, 60:440] = board
    second[100:340, 60 + moved_px : 440 + moved_px] = board
    return [grey(first, 3), grey(second, 4)]


def test_a_rotation_is_found_though_much_of_the_picture_moved_otherwise() -> None:
    turns = camera_rotations(pictures(moved_px=3), TRIPOD_CAMERA)
    assert turns is not None
    np.testing.assert_array_equal(turns[0], 0.0)
    np.testing.assert_allclose(turns[1], TURN_RAD, atol=0.05 / 500.0)


def test_pictures_with_nothing_in_common_give_no_rotation() -> None:
    assert camera_rotations([grey(texture(1, (400, 640)), 1), grey(texture(5, (400, 640)), 2)], TRIPOD_CAMERA) is None
    assert camera_rotations([np.full((400, 640), 90, dtype=np.uint8)] * 2, TRIPOD_CAMERA) is None


def test_corners_are_corrected_frame_by_frame() -> None:
    rays = np.array([[0.1, 0.2, 1.0], [-0.3, 0.1, 1.0]])
    turns = np.array([np.zeros(3), TURN_RAD])
    seen = np.concatenate([TRIPOD_CAMERA.project(rays @ Rotation.from_rotvec(turn).as_matrix().T) for turn in turns])
    rows = Observations(np.array([0, 0, 1, 1]), np.full(4, DIRECT), np.array([0, 1, 0, 1]), seen)
    still = stabilised(rows, TRIPOD_CAMERA, turns)
    np.testing.assert_allclose(still.pixels[:2], still.pixels[2:], atol=1e-9)
    np.testing.assert_allclose(still.pixels[:2], seen[:2], atol=1e-9)
    assert np.abs(seen[2:] - seen[:2]).max() == pytest.approx(1.1, abs=0.5)


@pytest.fixture(scope="module")
def moving() -> tuple[Estimate, Observations, FloatArray]:
    """Return boards moved by hand, up to 4 mm and 1 degree per frame, with corners at one moment, and velocities."""
    truth, clean = corners_of(corner_of_two_mirrors(90.0), moved_by_hand(FRAMES))
    twists = np.random.default_rng(3).normal(0.0, 1.0, (FRAMES, 6)) * [*[0.01] * 3, *[2.0] * 3]
    none = np.zeros(9 + 6 * 2 + 1)
    ahead, back = (residuals(truth.moved(none, sign * twists / 2), clean, DRAWN) for sign in (1, -1))
    return truth, clean, ahead - back


def selected(truth: Estimate, seen: Observations) -> ModelSelection:
    return select_model(truth, seen, BOARD.corners_in_board_mm, model=RequestedModel(), surface_known=False)


def seen_by(readout: float, moving: tuple[Estimate, Observations, FloatArray]) -> tuple[Estimate, Observations]:
    """Return corners under a rolling shutter, moved exactly along their velocities, with noise."""
    truth, clean, velocity = moving
    row = clean.pixels[:, 1]
    for _ in range(20):  # a corner is seen in the row that contains it when that row is read
        row = clean.pixels[:, 1] + readout * ((row + 0.5) / CAMERA.height_px - 0.5) * velocity[:, 1]
    late = readout * ((row + 0.5) / CAMERA.height_px - 0.5)
    noise = np.random.default_rng(4).normal(0.0, NOISE_PX, clean.pixels.shape)
    return truth, replace(clean, pixels=clean.pixels + late[:, None] * velocity + noise)


@pytest.mark.parametrize("readout", [0.6, -0.3])
def test_the_readout_comes_out_within_its_uncertainty(
    readout: float, moving: tuple[Estimate, Observations, FloatArray]
) -> None:
    truth, seen = seen_by(readout, moving)
    found = rolling_shutter(selected(truth, seen), seen, moving[2], CAMERA.height_px)
    assert found is not None
    assert found.supported
    assert abs(found.readout - readout) < 4.0 * found.sigma < 0.1
    shifted = corrected_to_middle_row(seen, moving[2], found.readout, CAMERA.height_px)
    off = residuals(truth, shifted, DRAWN)
    assert np.sqrt(np.mean(off**2)) == pytest.approx(NOISE_PX, rel=0.05)


def test_a_global_shutter_has_no_readout(moving: tuple[Estimate, Observations, FloatArray]) -> None:
    truth, seen = seen_by(0.0, moving)
    found = rolling_shutter(selected(truth, seen), seen, moving[2], CAMERA.height_px)
    assert found is not None
    assert not found.supported
    assert abs(found.readout) < 4.0 * found.sigma


def test_static_boards_determine_no_readout(moving: tuple[Estimate, Observations, FloatArray]) -> None:
    truth, seen = seen_by(0.0, moving)
    assert rolling_shutter(selected(truth, seen), seen, np.zeros_like(moving[2]), CAMERA.height_px) is None


def test_velocities_are_differences_of_adjacent_frames() -> None:
    texture = 128.0 + 400.0 * gaussian_filter(np.random.default_rng(0).standard_normal((120, 160)), 2.0)

    def frame(step: float) -> Grey:
        matrix = np.array([[1.0, 0.004 * step, 1.5 * step], [0.0, 1.0, -0.7 * step]])
        moved = cv2.warpAffine(texture, matrix, (160, 120), flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT)
        return np.clip(moved, 0, 255).astype(np.uint8)

    pixels = np.stack(np.meshgrid(np.linspace(40, 120, 5), np.linspace(30, 90, 4)), axis=-1).reshape(-1, 2)
    rows = Observations.join([Observations.of_view(f, DIRECT, np.arange(20), pixels) for f in (0, 1)])
    velocity = corner_velocities(rows, [(frame(-1), frame(0), frame(1)), None])
    np.testing.assert_allclose(velocity[:20, 0], 1.5 + 0.004 * pixels[:, 1], atol=0.06)
    np.testing.assert_allclose(velocity[:20, 1], -0.7, atol=0.06)
    np.testing.assert_array_equal(velocity[20:], 0.0)
