"""The single-stroke font: glyphs of the stated height and width, no two alike."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from mirrorcam.cad.plan.stroke_font import STROKES


@pytest.mark.parametrize("sign", sorted(STROKES))
def test_glyphs_have_their_corners_on_a_grid(sign: str) -> None:
    corners = np.vstack([np.array(stroke) for stroke in STROKES[sign]])
    assert set(corners[:, 1]) <= {0, 1, 2}
    assert np.ptp(corners[:, 0]) == {"1": 0, "M": 2}.get(sign, 1)
    assert np.ptp(corners[:, 1]) == (0 if sign == "-" else 2)
    # Strokes are parallel to an axis, so that all grooves meet at right angles.
    for stroke in STROKES[sign]:
        assert all((a == b) != (c == d) for (a, c), (b, d) in pairwise(stroke))


def test_no_two_glyphs_are_equal() -> None:
    drawn = {
        sign: frozenset(
            frozenset(edge)
            for stroke in strokes
            for (x0, y0), (x1, y1) in pairwise(stroke)
            for edge in _units((x0, y0), (x1, y1))
        )
        for sign, strokes in STROKES.items()
    }
    assert len(set(drawn.values())) == len(STROKES)


def _units(start: tuple[float, float], end: tuple[float, float]) -> list[tuple[tuple[float, float], ...]]:
    """A stroke divided into pieces of length 1."""
    steps = int(max(abs(end[0] - start[0]), abs(end[1] - start[1])))
    points = [
        (start[0] + (end[0] - start[0]) * k / steps, start[1] + (end[1] - start[1]) * k / steps)
        for k in range(steps + 1)
    ]
    return list(pairwise(points))
