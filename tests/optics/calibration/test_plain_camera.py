"""A camera without mirrors: its intrinsics and their covariance, lenses, boards that differ, and refusals."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.corner_calibration import calibrate_corners
from mirrorcam.optics.calibration.diagnostics.calibration_result import Calibration
from mirrorcam.optics.calibration.diagnostics.requested_model import AUTO, RequestedModel
from mirrorcam.optics.calibration.diagnostics.verdict import check_solution
from mirrorcam.optics.calibration.diagnostics.view_statistics import view_figures
from mirrorcam.optics.calibration.plain_camera import calibrate_camera, first_camera
from mirrorcam.optics.calibration.solver.observations import Observations
from mirrorcam.optics.calibration.solver.residuals import Board
from mirrorcam.optics.geometry.boards import Checkerboard
from mirrorcam.optics.geometry.calibrated_camera import CalibratedCamera
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.camera_library import read_camera
from mirrorcam.optics.geometry.layout import Layout
from tests.nightly import a_few
from tests.optics.calibration.synthetic_corners import direct_corners
from tests.optics.synthetic import posed

BOARD = Checkerboard(cols=10, rows=7, square_mm=25.0)
CORNERS_MM = BOARD.corners_in_board_mm
WEBCAM = Camera(
    width_px=1280,
    height_px=720,
    fx_px=930.0,
    fy_px=933.0,
    cx_px=652.0,
    cy_px=351.0,
    distortion=[-0.2, 0.06, 4e-4, -6e-4, 0.0],
)
FISHEYE = WEBCAM.replaced(
    fx_px=380.0, fy_px=380.0, lens_model="fisheye", distortion=np.array([0.02, -0.01, 0.003, -0.001])
)
NOISE_PX = 0.05


def pictures(
    truth: Camera, count: int = 12, *, tilt_deg: float = 30.0, seed: int = 0, board_mm: FloatArray = CORNERS_MM
) -> list[Observations]:
    """Corners of boards over the picture, as frame 0 each; `board_mm` are the corners as printed."""
    random = np.random.default_rng(seed)
    frames: list[Observations] = []
    half = np.array([truth.width_px, truth.height_px]) / truth.fx_px / 2.0
    board = _Printed(board_mm)
    while len(frames) < count:
        depth_mm = truth.fx_px * 250.0 / (truth.width_px * random.uniform(0.35, 0.75))
        x, y = 0.6 * half * random.uniform(-1.0, 1.0, 2) * depth_mm
        turn = tilt_deg * random.uniform(-1.0, 1.0, 3)
        pose = posed(BOARD, np.array([x, y, depth_mm]), turn, direct=True)
        rows = direct_corners(Layout.bare(truth), board, pose, NOISE_PX, random)
        if len(rows) >= 30:
            frames.append(rows)
    return frames


class _Printed(Checkerboard):
    """A board whose corners differ from the drawing."""

    def __init__(self, board_mm: FloatArray) -> None:
        super().__init__(cols=10, rows=7, square_mm=25.0)
        object.__setattr__(self, "_board_mm", board_mm)

    @property
    def corners_in_board_mm(self) -> FloatArray:
        return np.asarray(object.__getattribute__(self, "_board_mm"))


def calibrated(frames: list[Observations], truth: Camera, model: RequestedModel = AUTO) -> Calibration:
    """The calibration from corners, of which the program knows the size of the pictures alone."""
    camera = first_camera(frames, CORNERS_MM, truth.replaced(fx_px=1.0, fy_px=1.0), model)
    return calibrate_corners([], frames, Layout.bare(camera), CORNERS_MM, model=model)


def nees(calibration: Calibration, truth: Camera) -> float:
    """Squared error of the intrinsics over their covariance, per degree of freedom."""
    uncertainty = calibration.layout.uncertainty
    assert uncertainty is not None
    assert uncertainty.parameters == truth.intrinsic_names
    error = calibration.layout.camera.intrinsics - truth.intrinsics
    return float(error @ np.linalg.solve(uncertainty.covariance, error)) / len(error)


def test_intrinsics_are_found_within_their_stated_covariance() -> None:
    calibration = calibrated(pictures(WEBCAM), WEBCAM)
    assert calibration.diagnostics is not None
    assert calibration.diagnostics.model_name == "joint"
    assert calibration.layout.camera.fx_px == pytest.approx(930.0, abs=0.5)
    assert nees(calibration, WEBCAM) < 2.5  # of 9 degrees of freedom: p = .008
    assert calibration.metrics["sigma_px"].value == pytest.approx(NOISE_PX, rel=0.06)


@pytest.mark.slow
def test_stated_covariances_are_right_over_30_sets() -> None:
    squared = [nees(calibrated(pictures(WEBCAM, seed=seed), WEBCAM, RequestedModel()), WEBCAM) for seed in range(30)]
    assert np.mean(squared) == pytest.approx(1.0, abs=0.3)  # three standard errors of 270 degrees of freedom


def test_a_fisheye_is_recognised() -> None:
    calibration = calibrated(pictures(FISHEYE), FISHEYE)
    assert calibration.layout.camera.lens_model == "fisheye"
    assert calibration.layout.camera.fx_px == pytest.approx(380.0, abs=0.5)


def test_the_requested_lens_is_fitted() -> None:
    model = RequestedModel.parse("rational")
    calibration = calibrated(pictures(WEBCAM), WEBCAM, model)
    assert calibration.layout.camera.lens_model == "rational"
    points = np.array([[x, y, 1.0] for x in (-0.4, 0.0, 0.4) for y in (-0.2, 0.2)])
    np.testing.assert_allclose(calibration.layout.camera.project(points), WEBCAM.project(points), atol=0.5)


def test_an_irregular_print_is_fitted_with_the_camera() -> None:
    """A print whose corners are off by a quarter millimetre would bias the camera by many standard deviations."""
    print_mm = CORNERS_MM + 0.25 * np.random.default_rng(1).standard_normal(CORNERS_MM.shape)
    calibration = calibrated(pictures(WEBCAM, board_mm=print_mm), WEBCAM)
    assert calibration.diagnostics is not None
    assert "board" in calibration.diagnostics.model_name.split("+")
    assert nees(calibration, WEBCAM) < 2.5
    assert calibration.metrics["rms_x_px"].value < 1.1 * NOISE_PX


def test_a_camera_of_few_parallel_boards_is_uncertain_and_the_next_picture_is_recommended() -> None:
    calibration = calibrated(pictures(WEBCAM, 5, tilt_deg=12.0), WEBCAM, RequestedModel())
    diagnostics = calibration.diagnostics
    assert diagnostics is not None and diagnostics.next_picture is not None
    assert diagnostics.next_picture.predicted_px < 0.5 * diagnostics.next_picture.sigma_px
    verdict = check_solution(calibration, view_figures(calibration))
    assert verdict.state != "good"
    assert any("most useful further picture has the board" in advice for advice in verdict.advice)


def test_boards_that_all_face_the_camera_do_not_determine_it() -> None:
    with pytest.raises(InputError, match=r"the pictures (do not )?determine the (camera|focal length).* tilt"):
        calibrated(pictures(WEBCAM, 4, tilt_deg=0.0), WEBCAM)


def test_one_pose_does_not_determine_a_camera() -> None:
    pose = posed(BOARD, np.array([0.0, 0.0, 400.0]), np.zeros(3), direct=True)
    random = np.random.default_rng(0)
    frames = [direct_corners(Layout.bare(WEBCAM), BOARD, pose, NOISE_PX, random) for _ in range(4)]
    with pytest.raises(InputError, match=r"the pictures (do not )?determine the (camera|focal length).* tilt"):
        calibrated(frames, WEBCAM)


def test_two_pictures_are_too_few() -> None:
    with pytest.raises(InputError, match="seen in 2 different views, expected 3 or more"):
        calibrated(pictures(WEBCAM, 2), WEBCAM)


def test_a_picture_with_another_zoom_is_named() -> None:
    frames = pictures(WEBCAM)
    frames[4] = pictures(WEBCAM.replaced(fx_px=960.0, fy_px=963.0), 1, seed=9)[0]
    calibration = calibrated(frames, WEBCAM)
    assert calibration.diagnostics is not None
    assert calibration.diagnostics.causes[0].kind == "picture"
    assert calibration.diagnostics.causes[0].frame == 4


def with_own_errors(frames: list[Observations], size_px: float, seed: int) -> list[Observations]:
    """Each picture with a smooth field of errors of its own, as of a board that bends or a camera that moves."""
    random = np.random.default_rng([seed, 5])
    changed = []
    for rows in frames:
        x, y = (rows.pixels - rows.pixels.mean(axis=0)).T / 300.0
        field = np.column_stack([x * x, x * y, y * y]) @ random.standard_normal((3, 2))
        changed.append(replace(rows, pixels=rows.pixels + size_px * field))
    return changed


@pytest.mark.parametrize("seed", [2, 5])
def test_errors_of_six_single_pictures_are_not_called_a_change_of_focus(seed: int) -> None:
    calibration = calibrated(with_own_errors(pictures(WEBCAM, 6, seed=seed), 0.3, seed), WEBCAM)
    diagnostics = calibration.diagnostics
    assert diagnostics is not None
    assert not {"focus", "picture", "board changed", "size"} & {cause.kind for cause in diagnostics.causes}
    verdict = check_solution(calibration, view_figures(calibration))
    assert verdict.state == "stop"
    assert "6 pictures are too few to find the cause" in verdict.reasons


@pytest.mark.parametrize("first", a_few(1, [3, 2, 4]))
def test_a_change_of_focus_is_named_in_six_pictures(first: int) -> None:
    frames = pictures(WEBCAM, first) + pictures(WEBCAM.replaced(fx_px=940.0, fy_px=943.0), 6 - first, seed=9)
    calibration = calibrated(frames, WEBCAM)
    assert calibration.diagnostics is not None
    assert [(cause.kind, cause.frame) for cause in calibration.diagnostics.causes[:1]] == [("focus", first)]


def test_views_without_a_board_and_outliers_are_left_out() -> None:
    frames = [Observations.empty(), *pictures(WEBCAM)]
    pixels = frames[2].pixels.copy()
    pixels[7] += [3.0, -2.0]
    frames[2] = replace(frames[2], pixels=pixels)
    calibration = calibrated(frames, WEBCAM)
    assert calibration.notes[0] == "base frame 0: no board found, not used"
    assert calibration.metrics["outliers"].value == 1
    assert nees(calibration, WEBCAM) < 2.5


def test_words_that_need_mirrors_are_refused() -> None:
    with pytest.raises(InputError, match="model: bend needs mirrors, expected auto, joint or a lens with any of warp"):
        calibrated(pictures(WEBCAM, 3), WEBCAM, RequestedModel.parse("joint+bend"))


def test_pictures_without_a_board_are_refused() -> None:
    blank = np.full((72, 128), 128, dtype=np.uint8)
    with pytest.raises(InputError, match="no 10 x 7 checkerboard found in any of 2 pictures"):
        calibrate_camera([blank, blank], BOARD)
    with pytest.raises(InputError, match="no pictures given"):
        calibrate_camera([], BOARD)


def test_a_calibrated_camera_is_read_by_other_commands(tmp_path: Path) -> None:
    calibration = calibrated(pictures(WEBCAM), WEBCAM, RequestedModel())
    camera = CalibratedCamera.of(calibration.layout)
    camera.save(tmp_path / "camera.json")
    assert CalibratedCamera.load(tmp_path / "camera.json") == camera
    assert read_camera(str(tmp_path / "camera.json")) == calibration.layout.camera
    assert camera.layout.uncertainty == calibration.layout.uncertainty
    with pytest.raises(InputError, match="schema"):
        Layout.load(tmp_path / "camera.json")


def test_free_modes_of_a_large_board_are_smooth_and_leave_its_pose_and_size() -> None:
    x, y = np.meshgrid(12.0 * np.arange(19), 12.0 * np.arange(13))
    corners_mm = np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])
    modes = Board.free(corners_mm).modes.reshape(56, -1)
    np.testing.assert_allclose(modes @ modes.T, np.eye(56), atol=1e-12)
    centred = corners_mm - corners_mm.mean(axis=0)
    rigid = [np.tile(axis, (len(centred), 1)) for axis in np.eye(3)]
    rigid += [np.cross(axis, centred) for axis in np.eye(3)] + [centred]
    np.testing.assert_allclose(modes @ np.array(rigid).reshape(7, -1).T, 0.0, atol=1e-9)
