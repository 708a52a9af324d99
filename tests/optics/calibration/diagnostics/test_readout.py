"""The readout time of a rolling shutter follows from motions, and none is given for pictures taken one by one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mirrorcam.optics.calibration.diagnostics.readout import readout
from mirrorcam.optics.calibration.solver.residuals import Estimate
from tests.optics.calibration.solver.four_mirrors import four_mirrors

FRAMES, SIZE_MM = 20, 200.0


def moving(periods: float, *, noise: float = 0.0) -> Estimate:
    """A board that swings, with the motion during each readout."""
    random = np.random.default_rng(0)
    turn = np.array([0.3, 0.2, -0.1])
    poses, motion = np.tile(np.eye(4), (FRAMES, 1, 1)), np.empty((FRAMES, 6))
    for frame in range(FRAMES):
        poses[frame, :3, :3] = Rotation.from_rotvec(turn * np.sin(0.2 * frame)).as_matrix()
        poses[frame, :3, 3] = [30.0 * np.sin(0.2 * frame), 10.0 * np.cos(0.2 * frame), 400.0]
        speed = 0.2 * np.array([np.cos(0.2 * frame), -np.sin(0.2 * frame)])
        motion[frame, :3] = periods * turn * speed[0]
        motion[frame, 3:] = periods * np.array([30.0 * speed[0], 10.0 * speed[1], 0.0])
    motion += noise * random.standard_normal(motion.shape) * [*[1.0 / SIZE_MM] * 3, *[1.0] * 3]
    return replace(four_mirrors().truth.with_poses(poses), motion=motion)


def test_the_readout_is_found_within_its_deviation() -> None:
    found = readout(moving(0.9, noise=0.1), range(FRAMES), SIZE_MM)
    assert found is not None
    assert found.periods == pytest.approx(0.9, abs=3.0 * found.sigma + 0.01)
    assert found.sigma < 0.02


@pytest.mark.parametrize("numbers", [range(0, 2 * FRAMES, 2), list(range(FRAMES))[:4]])
def test_frames_that_do_not_follow_each_other_have_none(numbers: range) -> None:
    assert readout(moving(0.9), numbers, SIZE_MM) is None


def test_motions_without_a_relation_to_the_poses_have_none() -> None:
    assert readout(moving(0.0, noise=3.0), range(FRAMES), SIZE_MM) is None


def test_a_board_at_rest_has_none() -> None:
    assert readout(four_mirrors().truth, range(len(four_mirrors().truth.rig_from_board)), SIZE_MM) is None
