"""Grids and patterns of views: positions, order, and the fit to virtual centres."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray, InvalidValue
from mirrorcam.optics.geometry.arrangement import Arrangement, Pattern
from mirrorcam.optics.geometry.layout import Layout


def arranged(pattern: Pattern) -> Arrangement:
    return Arrangement(1, len(pattern.positions), pattern)


def nearest(places: FloatArray) -> FloatArray:
    apart = np.linalg.norm(places[:, None] - places, axis=-1)
    np.fill_diagonal(apart, np.inf)
    return np.asarray(apart.min(axis=1))


@pytest.mark.parametrize(("rings", "count"), [(1, 7), (2, 19), (3, 37)])
def test_a_hexagonal_pattern_has_equal_steps_and_a_middle(rings: int, count: int) -> None:
    pattern = Pattern.hexagonal(rings)
    assert (pattern.name, len(pattern.positions)) == (f"hex{count}", count)
    assert np.allclose(nearest(pattern.positions), 1.0)
    assert np.allclose(np.hypot(*pattern.positions.T).max(), rings)
    arrangement = arranged(pattern)
    assert arrangement.central_index == count // 2
    assert arrangement.inner == [count // 2]
    # Six neighbours, except on the border.
    touches = np.bincount(np.ravel(arrangement.neighbours), minlength=count)
    assert touches.max() == touches[count // 2] == 6
    assert (np.diff(arrangement.steps[:, 1]) > -1e-12).all()


@pytest.mark.parametrize("count", [3, 8, 13])
def test_a_ring_begins_at_the_top_and_turns_to_the_right(count: int) -> None:
    pattern = Pattern.ring(count)
    assert np.allclose(np.hypot(*pattern.positions.T), 1.0)
    assert np.allclose(pattern.positions[0], [0.0, -1.0])
    assert pattern.positions[1, 0] > 0
    arrangement = arranged(pattern)
    assert np.allclose(nearest(arrangement.steps), 1.0)
    assert (arrangement.central_index, arrangement.inner) == (0, list(range(count)))


def test_names_stand_for_patterns() -> None:
    assert Pattern.named("hex7") == Pattern.hexagonal(1)
    assert Pattern.named("ring8") == Pattern.ring(8)
    assert Pattern.named("mine.toml") is None
    with pytest.raises(InputError, match=r"pattern hex8: expected hex with one of 7, 19, 37, 61, 91, 127 views"):
        Pattern.named("hex8")
    with pytest.raises(InputError, match="pattern ring2: expected a ring of 3 to 144 views"):
        Pattern.named("ring2")


@pytest.mark.parametrize(
    ("positions", "complaint"),
    [
        ([[0, 0]], "has 1 positions, expected 2 to 144"),
        (np.zeros((145, 2)) + np.arange(145)[:, None], "has 145 positions"),
        ([[0, 0], [1, 0], [1, 1e-9]], "coincident positions 1 and 2"),
        ([[0, 0], [0, 0]], "coincident positions 0 and 1"),
        ([[0, 0, 1], [1, 0, 1]], r"shape \(2, 3\), expected \(n, 2\)"),
        ([[0, 0], [0, np.nan]], "NaN"),
    ],
)
def test_positions_that_are_no_pattern_are_refused(positions: FloatArray, complaint: str) -> None:
    with pytest.raises(InvalidValue, match=complaint):
        Pattern(name="mine", positions=positions)


@pytest.mark.parametrize(
    ("rows", "cols", "central", "inner"),
    [(3, 3, 4, [4]), (2, 3, 4, [1, 4]), (4, 4, 10, [5, 6, 9, 10]), (1, 2, 1, [0, 1]), (5, 1, 2, [2])],
)
def test_a_grid_has_steps_of_one(rows: int, cols: int, central: int, inner: list[int]) -> None:
    grid = Arrangement(rows, cols)
    steps = grid.steps.reshape(rows, cols, 2)
    assert (np.diff(steps, axis=0) == [0.0, 1.0]).all()
    assert (np.diff(steps, axis=1) == [1.0, 0.0]).all()
    assert (grid.central_index, grid.inner) == (central, inner)
    assert (grid.extent == [cols - 1, rows - 1]).all()
    assert grid.names[:1] + grid.names[-1:] == ("0-0", f"{rows - 1}-{cols - 1}")
    assert len(grid.neighbours) == rows * (cols - 1) + cols * (rows - 1)
    assert grid.text == f"{rows} x {cols}"


def test_a_pattern_of_a_grid_is_that_grid() -> None:
    grid = Arrangement(3, 4)
    same = arranged(Pattern(name="mine", positions=7.0 * grid.steps + [3.0, -2.0]))
    assert np.allclose(same.steps, grid.steps)
    assert same.inner == grid.inner
    assert same.names == tuple(str(number) for number in range(12))
    centres = np.random.default_rng(4).normal(size=(12, 3))
    for one, other in zip(same.fitted(centres), grid.fitted(centres), strict=True):
        assert np.allclose(one, other)


def test_an_unbalanced_pattern_is_centred_by_the_mean_of_all_views() -> None:
    corner = arranged(Pattern(name="corner", positions=[[0, 0], [1, 0], [2, 0], [0, 1], [0, 2]]))
    assert corner.central_index == 1
    assert corner.inner == [0, 1, 2, 3, 4]


@given(st.integers(0, 2**32 - 1), st.integers(3, 9))
def test_the_fitted_places_are_the_nearest_of_their_kind(seed: int, count: int) -> None:
    random = np.random.default_rng(seed)
    arrangement = arranged(Pattern(positions=random.uniform(-1, 1, (count, 2))))
    centres = random.normal(size=(2, count, 3))
    places, spacings = arrangement.fitted(centres)
    for device in range(2):
        # Least squares over origin and two spacings, by an independent solver.
        ones, zeros = np.ones((count, 1)), np.zeros((count, 1))
        x, y = arrangement.steps[:, :1], arrangement.steps[:, 1:]
        design = np.block(
            [[ones, zeros, zeros, x, zeros], [zeros, ones, zeros, zeros, y], [zeros, zeros, ones, zeros, zeros]]
        )
        found = np.linalg.lstsq(design, centres[device].T.ravel(), rcond=None)[0]
        assert np.allclose(spacings[device], found[3:])
        assert np.allclose(places[device].T.ravel(), design @ found)


def test_a_layout_of_a_pattern_survives_its_file(parabola_layout: Layout) -> None:
    hexagon = Pattern.hexagonal(1)
    layout = parabola_layout.replaced(
        rows=1, cols=7, pattern=hexagon, mirrors=parabola_layout.mirrors[:7], spec=None, metrics={}, verdict={}
    )
    again = Layout.model_validate_json(layout.model_dump_json(by_alias=True, exclude_none=True))
    assert again == layout
    assert (again.identity, again.arrangement.text) == (layout.identity, "hex7")
    assert layout.mirror_names == ("0", "1", "2", "3", "4", "5", "6")
    with pytest.raises(InvalidValue, match="3 x 3 mirrors, expected 1 x 7 of pattern hex7"):
        parabola_layout.replaced(pattern=hexagon)
    # The file of a grid does not mention patterns.
    assert "pattern" not in parabola_layout.model_dump_json()
