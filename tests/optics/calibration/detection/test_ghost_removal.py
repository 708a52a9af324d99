"""Corners in second-surface mirrors: the ghost images that the front adds must not move them."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.detection.checkerboard import Grey
from mirrorcam.optics.calibration.detection.detect_boards import sub_images
from mirrorcam.optics.calibration.detection.ghost_removal import in_light, without_ghost_images
from mirrorcam.optics.calibration.solver.observations import Observations
from mirrorcam.optics.geometry.layout import Layout
from tests.optics.calibration.detection.plate_frames import BOARD, FRONT, NOMINAL, PlateFrames


def mean_errors(seen: list[Observations], truth_px: FloatArray) -> FloatArray:
    """Mean error (mirrors, 2) of the corners of each mirror, in px."""
    off = np.concatenate([o.pixels - truth_px[frame][o.view, o.corner] for frame, o in enumerate(seen)])
    view = np.concatenate([o.view for o in seen])
    return np.array([off[view == index].mean(axis=0) for index in range(truth_px.shape[1])])


@pytest.fixture(scope="module")
def detected(plate_frames: PlateFrames) -> list[Observations]:
    return [sub_images(picture, NOMINAL, BOARD).corners for picture in plate_frames.pictures]


def refined(
    frames: PlateFrames, detected: list[Observations], pictures: list[Grey], layout: Layout
) -> list[Observations]:
    poses = dict(enumerate(frames.rig_from_board))
    return without_ghost_images(detected, pictures, poses, layout, BOARD, workers=2)


def test_the_ghost_of_the_front_moves_no_corner(plate_frames: PlateFrames, detected: list[Observations]) -> None:
    seen = refined(plate_frames, detected, plate_frames.pictures, plate_frames.layout)
    assert np.abs(mean_errors(seen, plate_frames.corners_px)).max() < 0.004
    # What it would do to them: along the plane of incidence, in all mirrors the same way.
    assert (mean_errors(detected, plate_frames.corners_px)[:, 1] > 0.015).all()
    assert sum(map(len, seen)) > 0.7 * sum(map(len, detected))


@pytest.mark.parametrize("gamma", [1.8, 2.2])
def test_a_camera_that_encodes_light_moves_none_either(
    plate_frames: PlateFrames, detected: list[Observations], gamma: float
) -> None:
    encoded = [np.rint(in_light(picture, 1.0 / gamma)).astype(np.uint8) for picture in plate_frames.pictures]
    seen = refined(plate_frames, detected, encoded, plate_frames.layout)
    assert np.abs(mean_errors(seen, plate_frames.corners_px)).max() < 0.006


def test_a_first_surface_mirror_has_no_ghost_image(plate_frames: PlateFrames, detected: list[Observations]) -> None:
    for before, after in zip(detected, refined(plate_frames, detected, plate_frames.pictures, FRONT), strict=True):
        for name in ("view", "corner", "pixels", "sigma_px"):
            np.testing.assert_array_equal(getattr(after, name), getattr(before, name))


def test_a_frame_that_is_not_at_hand_has_no_corners(plate_frames: PlateFrames, detected: list[Observations]) -> None:
    poses = dict(enumerate(plate_frames.rig_from_board))
    pictures = [None, *plate_frames.pictures[1:]]
    seen = without_ghost_images(detected, pictures, poses, plate_frames.layout, BOARD)
    assert not len(seen[0])
    assert len(seen[1])
    assert len(seen[2])
