"""The readout time of a rolling shutter follows from motions, and none is given for pictures taken one by one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from mirrorcam.optics.calibration.diagnostics.model_selection import ModelSelection
from mirrorcam.optics.calibration.diagnostics.nested_models import Fitted, fit_with
from mirrorcam.optics.calibration.diagnostics.readout import Readout, readout
from mirrorcam.optics.calibration.solver.observations import Observations
from tests.nightly import a_few
from tests.optics.calibration.diagnostics.moving_boards import MovingBoards


@cache
def moving(seed: int, periods: float = 0.9) -> tuple[MovingBoards, Observations, Fitted]:
    boards = MovingBoards.of(seed, readout=periods)
    observations = boards.noisy(seed + 1000)
    return boards, observations, fit_with("motion", boards.joint(observations), observations)


def readout_of(observations: Observations, fitted: Fitted, numbers: Sequence[int]) -> Readout | None:
    return readout(ModelSelection(fitted.name, fitted.model, fitted.solution, (), None, (), ()), observations, numbers)


@pytest.mark.parametrize("sets", a_few(1, [4, 14]))
def test_errors_of_readout_and_mirrors_are_as_large_as_stated(sets: int) -> None:
    """Normalised squared errors are chi squared, of the readout with one degree of freedom in each set."""
    squared, mirrors = [], []
    for seed in range(sets):
        boards, observations, fitted = moving(seed)
        found = readout_of(observations, fitted, range(boards.mirrored))
        assert found is not None
        assert found.sigma < 1e-3
        squared.append(((found.periods - boards.readout) / found.sigma) ** 2)
        mirrors.append(boards.nees(fitted))
    assert np.mean(squared) < 1.0 + 3.0 * np.sqrt(2.0 / sets)
    # Over 15 to 36 parameters: a standard error of sqrt(2 / 20) for each set.
    assert np.mean(mirrors) == pytest.approx(1.0, abs=3.0 * np.sqrt(0.1 / sets))


def test_a_short_readout_is_found() -> None:
    boards, observations, fitted = moving(2, 0.3)
    found = readout_of(observations, fitted, range(boards.mirrored))
    assert found is not None
    assert found.periods == pytest.approx(0.3, abs=4.0 * found.sigma)


@pytest.mark.parametrize("numbers", [range(0, 80, 2), range(8), np.random.default_rng(0).permutation(40).tolist()])
def test_frames_that_do_not_follow_each_other_have_none(numbers: Sequence[int]) -> None:
    _, observations, fitted = moving(2)
    assert readout_of(observations, fitted, numbers) is None


def test_motions_without_a_relation_to_the_poses_have_none() -> None:
    """The frames in another order, numbered as if they followed each other."""
    boards = MovingBoards.of(2)
    frames = len(boards.truth.rig_from_board)
    order = np.concatenate([np.random.default_rng(1).permutation(boards.mirrored), np.arange(boards.mirrored, frames)])
    parts = [boards.clean.where(boards.clean.frame == frame) for frame in order]
    rows = Observations.join([replace(part, frame=np.full(len(part), number)) for number, part in enumerate(parts)])
    mixed = replace(boards, truth=boards.truth.of_frames(order), clean=rows)
    observations = mixed.noisy(0)
    fitted = fit_with("motion", mixed.joint(observations), observations)
    assert readout_of(observations, fitted, range(boards.mirrored)) is None


def test_a_board_at_rest_has_none() -> None:
    boards, observations, _ = moving(2)
    joint = boards.joint(observations)
    assert readout_of(observations, joint, range(boards.mirrored)) is None
