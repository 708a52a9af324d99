"""Recordings of another renderer: nothing is told to have moved that did not, and a turn of .02 degrees always is."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchmarks.drift import TURNS_DEG, of_set, simulated

SOLVED_DEG = 0.01


@pytest.mark.slow
@pytest.mark.parametrize("name", ["a_ch", "s2_ch"])
def test_recordings_of_another_renderer(foreign_sets: Path, name: str) -> None:
    found = of_set(foreign_sets / name)
    assert not any(each.alarm for each in found if each.turn_deg == 0.0)
    moved = [each for each in found if each.turn_deg >= 0.02]
    assert all(each.only_right for each in moved)
    assert max(each.error_deg for each in moved) < SOLVED_DEG
    assert np.mean([each.nees for each in moved]) < 1.5


@pytest.mark.slow
def test_recordings_while_the_scene_moves_before_a_rolling_shutter() -> None:
    found = [each for seed in (1, 3, 5) for each in simulated([], TURNS_DEG, seed)]
    assert not any(each.alarm for each in found if each.turn_deg == 0.0)
    moved = [each for each in found if each.turn_deg >= 0.02]
    assert all(each.only_right for each in moved)
    assert max(each.error_deg for each in moved) < SOLVED_DEG
