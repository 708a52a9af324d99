"""Detection in complete frames: boards by mirror, by any number of threads, and from the cache."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.detection import detection_cache
from mirrorcam.optics.calibration.detection.checkerboard import Grey
from mirrorcam.optics.calibration.detection.detect_boards import detect_direct_view, detect_frames, detect_sub_images
from mirrorcam.optics.calibration.detection.detections import DetectedFrame
from mirrorcam.optics.calibration.solver.observations import Observations
from mirrorcam.optics.geometry.boards import Charuco, Checkerboard
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.transforms import transform
from tests.optics.layouts import faceted_parabola
from tests.optics.synthetic import posed, render

CAMERA = Camera(width_px=960, height_px=540, fx_px=680.0, fy_px=680.0, cx_px=479.5, cy_px=269.5)
NOMINAL = faceted_parabola(CAMERA, DesignSpec(camera=CAMERA, rows=2, cols=2), fill=0.92)
BOARD = Charuco(cols=16, rows=11, square_mm=14.0, marker_mm=8.75)
PLAIN = Checkerboard(cols=8, rows=6, square_mm=10.0)


def tilted(tilt_deg: float) -> Layout:
    """Return the nominal layout with each mirror tilted by this angle, in different directions."""
    mirrors = tuple(
        mirror.moved(
            Rotation.from_rotvec(
                np.radians(tilt_deg) * mirror.rig_from_plane[:3, :2] @ [np.cos(turn), np.sin(turn)]
            ).as_matrix(),
            np.zeros(3),
        )
        for mirror, turn in zip(NOMINAL.mirrors, (0.4, 2.1, 3.5, 5.2), strict=True)
    )
    return NOMINAL.replaced(kind="as-built", mirrors=mirrors)


TILTED = tilted(2.0)


def frame(
    board: Checkerboard | Charuco, turn_deg: tuple[float, float, float], middle: tuple[float, float, float]
) -> tuple[Grey, FloatArray]:
    """A picture via mirrors tilted by 2 degrees, and the pixels (mirrors, corners, 2) of the corners."""
    pose = posed(board, np.array(middle), np.array(turn_deg), direct=False)
    points = transform(pose, board.corners_in_board_mm)
    truth = np.array([TILTED.project(points, index) for index in range(len(TILTED.mirrors))])
    return render(CAMERA, TILTED, board, pose, noise_grey=2.0), truth


def errors(seen: Observations, truth: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.norm(seen.pixels - truth[seen.view, seen.corner], axis=1))


@pytest.fixture(scope="module")
def charuco_frame() -> tuple[Grey, FloatArray]:
    return frame(BOARD, (20.0, 15.0, 5.0), (0.0, 290.0, 85.0))


def test_mirrors_tilted_by_two_degrees_show_corners_exactly(charuco_frame: tuple[Grey, FloatArray]) -> None:
    grey, truth = charuco_frame
    moved = truth - [NOMINAL.project(_points(), i) for i in range(4)]
    assert np.nanmedian(np.linalg.norm(moved, axis=2)) > 30.0  # how far the tilt moves the picture
    seen = detect_sub_images(grey, NOMINAL, BOARD).corners
    assert (np.bincount(seen.view, minlength=4) > 60).all()
    assert errors(seen, truth).max() < 0.1


def _points() -> FloatArray:
    pose = posed(BOARD, np.array([0.0, 290.0, 85.0]), np.array([20.0, 15.0, 5.0]), direct=False)
    return transform(pose, BOARD.corners_in_board_mm)


def test_a_part_of_the_board_in_a_corner_of_a_mirror_is_assigned_to_that_mirror() -> None:
    grey, truth = frame(BOARD, (0.0, 10.0, 3.0), (-110.0, 300.0, 130.0))
    seen = detect_sub_images(grey, NOMINAL, BOARD).corners
    assert (np.bincount(seen.view, minlength=4) > 10).all()
    assert errors(seen, truth).max() < 0.15


def test_glare_and_an_occluder_hide_corners_and_do_not_move_others(charuco_frame: tuple[Grey, FloatArray]) -> None:
    grey, truth = charuco_frame
    complete = detect_sub_images(grey, NOMINAL, BOARD).corners
    spoilt = grey.astype(np.float32)
    y, x = np.mgrid[:540, :960]
    for u, v, size in ((200.0, 150.0, 25.0), (650.0, 400.0, 40.0)):
        spoilt += 400.0 * np.exp(-((x - u) ** 2 + (y - v) ** 2) / (2.0 * size**2))
    cv2.rectangle(spoilt, (100, 380), (260, 430), (90.0,), -1)
    seen = detect_sub_images(np.clip(spoilt, 0, 255).astype(np.uint8), NOMINAL, BOARD).corners
    assert 0.6 * len(complete) < len(seen) < 0.97 * len(complete)
    assert errors(seen, truth).max() < 0.3
    hidden = (seen.pixels > [104, 384]).all(axis=1) & (seen.pixels < [256, 426]).all(axis=1)
    assert not hidden.any()


def test_a_plain_board_has_the_same_corner_numbers_in_every_mirror() -> None:
    assert PLAIN.looks_same_upside_down
    grey, truth = frame(PLAIN, (10.0, 15.0, 5.0), (0.0, 300.0, 85.0))
    seen = detect_sub_images(grey, NOMINAL, PLAIN).corners
    assert len(set(seen.view.tolist())) == 4
    over = truth[:, ::-1]
    assert min(errors(seen, truth).max(), errors(seen, over).max()) < 0.15


def test_boards_of_mirrors_that_the_layout_lacks_are_counted(charuco_frame: tuple[Grey, FloatArray]) -> None:
    grey, truth = charuco_frame
    assert not len(detect_sub_images(grey, NOMINAL, BOARD).unassigned_px)
    lacking = NOMINAL.replaced(rows=1, cols=3, mirrors=NOMINAL.mirrors[:3])
    seen = detect_sub_images(grey, lacking, BOARD)
    assert set(seen.corners.view.tolist()) == {0, 1, 2}
    assert np.abs(seen.unassigned_px - np.nanmean(truth[3], axis=0)).max() < 40.0  # some of its corners are hidden


def test_without_a_board_no_corners_are_found() -> None:
    noise = np.random.default_rng(0).integers(0, 255, (540, 960), dtype=np.uint8)
    for picture in (noise, np.zeros((540, 960), np.uint8), np.full((540, 960), 255, np.uint8)):
        assert len(detect_sub_images(picture, NOMINAL, BOARD).corners) == 0
        assert len(detect_direct_view(picture, BOARD)) == 0


def test_frames_come_in_order_for_any_number_of_threads_and_from_the_cache(
    charuco_frame: tuple[Grey, FloatArray], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    blank = np.zeros((540, 960), np.uint8)
    frames = [charuco_frame[0], blank, charuco_frame[0][::-1, ::-1].copy()]
    heard: list[int] = []
    alone = detect_frames(iter(frames), NOMINAL, BOARD, mirrored=True, on_frame=lambda found: heard.append(len(found)))
    assert heard == [1, 2, 3]
    together = detect_frames(iter(frames), NOMINAL, BOARD, mirrored=True, folder=tmp_path, workers=2)

    def same(a: list[DetectedFrame], b: list[DetectedFrame]) -> None:
        for one, other in zip([frame.corners for frame in a], [frame.corners for frame in b], strict=True):
            assert one.pixels.tobytes() == other.pixels.tobytes()
            assert one.corner.tolist() == other.corner.tolist()
            assert one.view.tolist() == other.view.tolist()

    same(alone, together)
    assert len(list(tmp_path.iterdir())) == 3, "of each frame its boards, whatever the mirrors"

    def not_again(*_: object, **__: object) -> None:
        raise AssertionError("looked for what is kept")

    monkeypatch.setattr("mirrorcam.optics.calibration.detection.detect_boards.find_boards", not_again)
    same(alone, detect_frames(iter(frames), NOMINAL, BOARD, mirrored=True, folder=tmp_path))
    # Detections depend on the board, the device and the programs.
    other = BOARD.replaced(square_mm=15.0)
    with pytest.raises(AssertionError, match="looked for"):
        detect_frames(iter(frames), NOMINAL, other, mirrored=True, folder=tmp_path)
    tilted = detect_frames(iter(frames), TILTED, BOARD, mirrored=True, folder=tmp_path)  # the same boards
    assert len(tilted[0].corners) > 0
    monkeypatch.setattr(detection_cache, "program_of", lambda module: {"code": "another"})
    with pytest.raises(AssertionError, match="looked for"):
        detect_frames(iter(frames), NOMINAL, BOARD, mirrored=True, folder=tmp_path)


def test_a_picture_of_another_size_is_refused() -> None:
    frames = [np.zeros((540, 960), np.uint8), np.zeros((480, 640), np.uint8)]
    with pytest.raises(InputError, match="frame 1 is 640x480 px, the layout's camera 960x540"):
        detect_frames(iter(frames), NOMINAL, BOARD, mirrored=True)
