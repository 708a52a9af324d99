"""The benchmark of matching: its counts, and that a light field has more matches in little light than its pictures."""

from __future__ import annotations

import numpy as np

from benchmarks.light_field_matching import (
    PICTURE_DETECTORS,
    correct_at,
    in_light_field,
    in_picture,
    matched,
    pair_of,
)
from benchmarks.relief_scene import even_views


def test_correct_matches_are_counted_up_to_the_rate() -> None:
    ratios = np.array([0.9, 0.1, 0.2, 0.3, 0.4])
    correct = np.array([False, True, True, False, True])
    assert correct_at(ratios, correct, 0.0) == 2
    assert correct_at(ratios, correct, 0.25) == 3
    assert correct_at(ratios, np.zeros(5, dtype=bool), 0.1) == 0


def test_in_little_light_the_stack_has_more_correct_matches() -> None:
    views = even_views(3, 10.0, width_px=240, height_px=180, centre_px=np.array([119.5, 89.5]))
    pair = pair_of(views, 0, 8.0, 0.12, 3.0, (0.4, -0.3, -0.85))
    ours = correct_at(*matched(pair, in_light_field(pair.first, 300), in_light_field(pair.second, 300)), 0.05)
    others = [
        correct_at(*matched(pair, in_picture(pair.first, name, 300), in_picture(pair.second, name, 300)), 0.05)
        for name in PICTURE_DETECTORS
    ]
    assert ours > 60
    assert ours > 1.5 * max(others)
