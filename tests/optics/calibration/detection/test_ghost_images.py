"""Ghost images of corners in second-surface mirrors: their offsets and strengths follow from the plate."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.detection.checkerboard import Grey
from mirrorcam.optics.calibration.detection.detect_boards import detect_sub_images
from mirrorcam.optics.calibration.detection.ghost_images import (
    ghost_images_of,
    ghosted_view,
    linear_light,
    refine_with_ghosts,
)
from mirrorcam.optics.calibration.solver.observations import Corners, Observations
from mirrorcam.optics.geometry.layout import Layout
from tests.optics.calibration.detection.plate_frames import BOARD, FRONT, NOMINAL, PlateFrames


def corners_in(frames: PlateFrames, number: int) -> list[tuple[int, Corners]]:
    """Mirrors and corners of the views of a frame."""
    seen = detect_sub_images(frames.pictures[number], NOMINAL, BOARD).corners
    views = np.unique(seen.view).tolist()
    return [(view, Corners(seen.corner[seen.view == view], seen.pixels[seen.view == view])) for view in views]


def test_ghost_images_have_the_offset_and_strength_of_the_plate(plate_frames: PlateFrames) -> None:
    factors = []
    camera = plate_frames.layout.camera
    for number, (picture, pose) in enumerate(zip(plate_frames.pictures, plate_frames.rig_from_board, strict=True)):
        for view, corners in corners_in(plate_frames, number):
            mirror = plate_frames.layout.mirrors[view]
            ghosts = ghost_images_of(corners, pose, camera, mirror, BOARD)
            assert ghosts is not None
            assert 0.03 < ghosts.strengths[:, :2].min() < ghosts.strengths.max() < 0.12
            np.testing.assert_allclose(ghosts.strengths[:, 2], ghosts.strengths[:, 1] ** 2)
            # One on each side of the picture along the mirror's slope, at about the same distance.
            before, behind, further = np.moveaxis(ghosts.offsets_px, 1, 0)
            assert np.abs(further - 2.0 * behind).max() < 0.2
            assert np.abs(before + behind).max() < 0.1
            assert (before[:, 1] > 2.0).all()
            ghosted = ghosted_view(corners, pose, camera, mirror, BOARD)
            assert ghosted is not None
            light = picture.astype(np.float32)
            _, seen = ghosted.fitted(light, BOARD)[0].fitted(light, BOARD, fit_encoding=True)
            assert seen.ghost_strengths.shape == (len(ghosted), 3)
            factors.append(np.median(seen.ghost_strengths, axis=0))
    # Fresnel's strength, the same on white and on black, because this camera is linear.
    assert np.abs(np.median(factors, axis=0) - [1.0, 1.0, 0.0]).max() < 0.2


def test_corners_whose_ghost_image_may_end_at_the_mirrors_edge_are_left_out(plate_frames: PlateFrames) -> None:
    pose, camera = plate_frames.rig_from_board[0], plate_frames.layout.camera
    mirror, corners = corners_in(plate_frames, 0)[0]
    plate = plate_frames.layout.mirrors[mirror]
    complete = ghosted_view(corners, pose, camera, plate, BOARD)
    assert complete is not None
    outline = plate.outline_in_rig_mm
    middle = outline.mean(axis=0)
    smaller = ghosted_view(
        corners, pose, camera, plate.replaced(outline_in_rig_mm=middle + 0.7 * (outline - middle)), BOARD
    )
    assert smaller is not None
    assert set(smaller.ids) < set(complete.ids) <= set(corners.ids)
    tiny = plate.replaced(outline_in_rig_mm=middle + 0.01 * (outline - middle))
    assert ghosted_view(corners, pose, camera, tiny, BOARD) is None


def test_selected_corners_are_spread_over_the_view(plate_frames: PlateFrames) -> None:
    mirror, corners = corners_in(plate_frames, 0)[0]
    plate = plate_frames.layout.mirrors[mirror]
    view = ghosted_view(corners, plate_frames.rig_from_board[0], plate_frames.layout.camera, plate, BOARD)
    assert view is not None
    few = view.sample
    assert 40 <= len(few) < len(view)
    assert np.ptp(few.expected.print_xy, axis=0).min() > 0.7 * np.ptp(view.expected.print_xy, axis=0).min()


def mean_errors(seen: list[Observations], truth_px: FloatArray) -> FloatArray:
    """Mean error (mirrors, 2) of the corners of each mirror, in px."""
    off = np.concatenate([o.pixels - truth_px[frame][o.view, o.corner] for frame, o in enumerate(seen)])
    view = np.concatenate([o.view for o in seen])
    return np.array([off[view == index].mean(axis=0) for index in range(truth_px.shape[1])])


@pytest.fixture(scope="module")
def detected(plate_frames: PlateFrames) -> list[Observations]:
    return [detect_sub_images(picture, NOMINAL, BOARD).corners for picture in plate_frames.pictures]


def refined(
    frames: PlateFrames, detected: list[Observations], pictures: list[Grey], layout: Layout
) -> list[Observations]:
    poses = dict(enumerate(frames.rig_from_board))
    return refine_with_ghosts(detected, pictures, poses, layout, BOARD, workers=2)


def test_the_ghost_of_the_front_moves_no_corner(plate_frames: PlateFrames, detected: list[Observations]) -> None:
    seen = refined(plate_frames, detected, plate_frames.pictures, plate_frames.layout)
    assert np.abs(mean_errors(seen, plate_frames.corners_px)).max() < 0.004
    # Its effect would lie along the plane of incidence, in the same direction in all mirrors.
    assert (mean_errors(detected, plate_frames.corners_px)[:, 1] > 0.015).all()
    assert sum(map(len, seen)) > 0.7 * sum(map(len, detected))


@pytest.mark.parametrize("gamma", [1.8, 2.2])
def test_nor_with_a_camera_that_encodes_light(
    plate_frames: PlateFrames, detected: list[Observations], gamma: float
) -> None:
    encoded = [np.rint(linear_light(picture, 1.0 / gamma)).astype(np.uint8) for picture in plate_frames.pictures]
    seen = refined(plate_frames, detected, encoded, plate_frames.layout)
    assert np.abs(mean_errors(seen, plate_frames.corners_px)).max() < 0.006


def test_sharpened_pictures_keep_their_corners(plate_frames: PlateFrames, detected: list[Observations]) -> None:
    """Halos leave edges without blur: its estimate once fell to 0, and errors were twice as large."""
    light = [picture.astype(np.float32) for picture in plate_frames.pictures]
    sharpened = [image + 8.0 * (image - cv2.GaussianBlur(image, (0, 0), 1.5)) for image in light]
    pictures = [np.clip(np.rint(image), 0, 255).astype(np.uint8) for image in sharpened]
    seen = refined(plate_frames, detected, pictures, plate_frames.layout)
    errors = [o.pixels - plate_frames.corners_px[frame][o.view, o.corner] for frame, o in enumerate(seen)]
    assert np.sqrt(np.mean(np.concatenate(errors) ** 2)) < 0.035
    assert sum(map(len, seen)) > 0.7 * sum(map(len, detected))


def test_a_first_surface_mirror_has_no_ghost_image(plate_frames: PlateFrames, detected: list[Observations]) -> None:
    for before, after in zip(detected, refined(plate_frames, detected, plate_frames.pictures, FRONT), strict=True):
        for name in ("view", "corner", "pixels", "sigma_px"):
            np.testing.assert_array_equal(getattr(after, name), getattr(before, name))


def test_a_frame_that_is_not_at_hand_has_no_corners(plate_frames: PlateFrames, detected: list[Observations]) -> None:
    poses = dict(enumerate(plate_frames.rig_from_board))
    pictures = [None, *plate_frames.pictures[1:]]
    seen = refine_with_ghosts(detected, pictures, poses, plate_frames.layout, BOARD)
    assert not len(seen[0])
    assert len(seen[1])
    assert len(seen[2])
