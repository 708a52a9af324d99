"""Scales and numbers of drawings are round and short."""

from __future__ import annotations

import pytest

from mirrorcam.core.html.inline_svg import Scale, coordinate, tick_text


@pytest.mark.parametrize(
    ("low", "high", "count", "expected"),
    [
        (0.0, 1.0, 5, [0.0, 0.2, 0.4, 0.6, 0.8, 1.0]),
        (200.0, 1000.0, 9, [200.0, 300.0, 400.0, 500.0, 600.0, 700.0, 800.0, 900.0, 1000.0]),
        (-3.2, 4.1, 4, [-2.0, 0.0, 2.0, 4.0]),
    ],
)
def test_ticks_are_round_and_within(low: float, high: float, count: int, expected: list[float]) -> None:
    assert Scale(low, high, 0.0, 1.0).ticks(count) == pytest.approx(expected)


def test_numbers_of_drawings_are_short() -> None:
    assert [coordinate(value) for value in (1.0, 1.25, 0.001, -0.5)] == ["1", "1.25", "0", "-0.5"]
    assert [tick_text(value) for value in (-0.0, 0.30000000000000004, -2.0)] == ["0", "0.3", "\N{MINUS SIGN}2"]
