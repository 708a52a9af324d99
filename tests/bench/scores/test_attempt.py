"""An attempt is per set that was tried, and the figures of its score."""

from __future__ import annotations

import pytest

from mirrorcam.bench.scores.leaderboard import Attempt, TriedSet
from mirrorcam.core.values import InvalidValue, Metric


def test_an_attempt_is_a_tried_set_with_figures() -> None:
    tried = TriedSet(name="a", why="few mirrors", dataset_sha256="0" * 64, seconds=1.5)
    attempt = Attempt(**tried.model_dump(), figures={"rms_px": Metric(value=0.1, unit="px")})
    assert attempt.model_dump(exclude={"figures"}) == tried.model_dump()
    assert attempt.failure == ""


def test_texts_of_a_set_are_single_lines() -> None:
    with pytest.raises(InvalidValue):
        TriedSet(name="a\nb", why="", dataset_sha256="0" * 64, seconds=1.0)
