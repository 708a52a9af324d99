"""Hidden lines: visible and hidden edges, each once."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from mirrorcam.cad.guide.part_views import (
    FRONT,
    ISOMETRIC,
    OVERLAP_MM,
    RIGHT,
    TOP,
    PartView,
    on_paper,
    project,
)
from mirrorcam.cad.plan.part_plan import PartPlan


def length(lines: list[np.ndarray]) -> float:
    return float(sum(np.linalg.norm(np.diff(line, axis=0), axis=1).sum() for line in lines))


def test_view_axes_are_right_handed_and_third_angle() -> None:
    for axes in (TOP, FRONT, RIGHT, ISOMETRIC):
        np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(axes) == pytest.approx(1.0)
    # From above, the front view's upper edge is the near one; from the right, its depth runs to the right.
    assert FRONT[2] @ TOP[1] == -1.0
    assert RIGHT[0] @ TOP[1] == 1.0


def test_lengths_of_visible_and_hidden_edges_of_a_block(block: Callable[..., PartPlan]) -> None:
    part = block()
    solid = part.make(part.plan)
    visible, hidden = on_paper(project(solid, TOP), 1.0)
    # Its outline and two circles; all hidden lines are below visible ones.
    assert length(visible) == pytest.approx(2 * (60 + 30) + 2 * np.pi * 6.0, rel=2e-3)
    assert hidden == []
    visible, hidden = on_paper(project(solid, FRONT), 1.0)
    assert length(visible) == pytest.approx(2 * (60 + 10), rel=1e-6)
    # The sides of two holes, clear of the edges at their ends.
    assert length(hidden) == pytest.approx(4 * (10.0 - 2 * OVERLAP_MM), rel=1e-3)
    np.testing.assert_allclose(project(solid, RIGHT).box, [[-15, -5], [15, 5]], atol=1e-6)


def test_hidden_lines_that_no_one_could_read_are_left_out() -> None:
    edge = np.array([[0.0, 0.0], [10.0, 0.0]])
    few = tuple(edge + np.array([0.0, 1.0 + row]) for row in range(2))
    many = tuple(edge + np.array([0.0, 1.0 + row]) for row in range(3))
    assert len(on_paper(PartView(np.eye(3), (edge,), few), 1.0)[1]) == 2
    assert on_paper(PartView(np.eye(3), (edge,), many), 1.0)[1] == []


def test_hidden_lines_along_visible_ones_and_specks_are_left_out() -> None:
    edge = np.array([[0.0, 0.0], [10.0, 0.0]])
    speck = np.array([[3.0, 3.0], [3.5, 3.0]])
    halves = (np.array([[0.0, 5.0], [5.0, 5.0]]), np.array([[5.0, 5.0], [10.0, 5.0]]))
    view = PartView(np.eye(3), (edge, edge + np.array([0.0, 9.0])), (edge + np.array([0.0, 0.05]), speck, *halves))
    _, hidden = on_paper(view, 1.0)
    # The two halves are one line, so that its dashes do not restart.
    assert len(hidden) == 1
    assert length(hidden) == pytest.approx(10.0, abs=1e-3)
    _, enlarged = on_paper(view, 5.0)
    assert len(enlarged) == 3
