"""The request for a set: streams of random numbers, and the poses of the board in its frames."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.boards import Charuco
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.render_scenes.sets.set_request import SetRequest, Stream, planned_frames
from mirrorcam.render_scenes.settings import SENSORS, RenderSettings


@pytest.fixture
def still(small_layout: Layout, small_board: Charuco) -> SetRequest:
    settings = RenderSettings(sensor=SENSORS["ideal"])
    return SetRequest(layout=small_layout, board=small_board, frames=3, base_frames=2, seed=7, settings=settings)


@pytest.fixture
def poses(still: SetRequest) -> FloatArray:
    """Three planned poses (3, 4, 4)."""
    return planned_frames(still)[0].poses


def given(poses: FloatArray) -> tuple[tuple[tuple[float, ...], ...], ...]:
    """Poses in the form of a request."""
    return tuple(tuple(map(tuple, pose.tolist())) for pose in poses)


def test_every_stream_and_seed_has_random_numbers_of_its_own(still: SetRequest) -> None:
    drawn = [request.random(stream).random() for request in (still, still.replaced(seed=8)) for stream in Stream]
    assert len(set(drawn)) == 2 * len(Stream)
    assert still.random(Stream.FINISH).random() == drawn[Stream.FINISH]


def test_frames_that_stand_still_have_one_pose_each(still: SetRequest, poses: FloatArray) -> None:
    plan, moments = planned_frames(still.replaced(poses=given(poses)))
    assert moments.shape == (3, 1, 4, 4)
    np.testing.assert_array_equal(moments[:, 0], poses)
    np.testing.assert_array_equal(plan.poses, poses)


def test_a_motion_passes_the_given_poses_at_their_rate(still: SetRequest, poses: FloatArray) -> None:
    """Two poses a second and eight frames a second: the poses are those of every fourth frame."""
    _, moments = planned_frames(still.replaced(poses=given(poses), poses_hz=2.0, rate_hz=8.0))
    assert moments.shape == (9, 1, 4, 4)
    np.testing.assert_allclose(moments[::4, 0], poses, atol=1e-9)


def test_a_rolling_shutter_has_the_poses_of_the_begin_middle_and_end_of_its_readout(
    still: SetRequest, poses: FloatArray
) -> None:
    moving = still.replaced(poses=given(poses), rate_hz=8.0)
    # Half a readout is as long as a frame.
    sensor = SENSORS["ideal"].replaced(readout_ms=250.0)
    plan, moments = planned_frames(moving.replaced(settings=RenderSettings(sensor=sensor)))
    assert moments.shape == (17, 3, 4, 4)
    np.testing.assert_array_equal(plan.poses, moments[:, 1])
    np.testing.assert_allclose(moments[1:-1, 0], moments[:-2, 1], atol=1e-9)
    np.testing.assert_allclose(moments[1:-1, 2], moments[2:, 1], atol=1e-9)


@pytest.mark.parametrize("poses_given", [0, 1])
def test_one_frame_is_no_motion(still: SetRequest, poses: FloatArray, poses_given: int) -> None:
    request = still.replaced(frames=1 + poses_given, poses=given(poses[:poses_given]), rate_hz=30.0)
    with pytest.raises(InputError, match="rate_hz: one pose is not a motion"):
        planned_frames(request)
