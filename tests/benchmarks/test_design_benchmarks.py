"""What the benchmarks of the optimiser say is what is so: derivatives, shares, rolls, bounds, comparisons."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import Polygon
from shapely.affinity import translate

from benchmarks.design_account import (
    budget_of,
    densities,
    expected_rolls_deg,
    parallax_bound,
    prices,
    rolls_deg,
)
from benchmarks.design_front import Point, compared, efficiency_at, upper
from benchmarks.design_peers import HELD, Question, Trace, first_problem
from benchmarks.design_pupil import Point as PupilPoint
from benchmarks.design_pupil import gained
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.design.program.seeds import faceted_parabola
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.sub_images import pixel_efficiency

LAYOUT = Layout.load(Path(__file__).parents[1] / "data" / "default_layout.json")
DEPTHS_MM = (300.0, 500.0)
SMALL = DesignSpec(rows=1, cols=2)


@pytest.fixture(scope="module")
def question() -> Question:
    return Question(SMALL, first_problem(SMALL))


def _finite_differences(function: Callable[[FloatArray], Any], x: FloatArray, step: float = 1e-6) -> FloatArray:
    columns = [(function(x + d) - function(x - d)) / (2.0 * step) for d in step * np.eye(len(x))]
    return np.stack(columns, axis=-1)


def test_derivatives_handed_to_scipy_are_those_of_the_functions(question: Question) -> None:
    x = question.start + 0.003 * np.random.default_rng(0).standard_normal(len(question.start))
    np.testing.assert_allclose(question.gradient(x), _finite_differences(question.value, x), atol=1e-7)
    found = question.jacobian(x).toarray()
    np.testing.assert_allclose(found, _finite_differences(question.constraints, x), atol=1e-6)
    multipliers = np.random.default_rng(1).standard_normal(len(question.equal))

    def slope(at: FloatArray) -> FloatArray:
        return 0.7 * question.gradient(at) + question.jacobian(at).T @ multipliers

    expected = _finite_differences(slope, x)
    np.testing.assert_allclose(question.hessian(x, 0.7, multipliers).toarray(), expected, atol=1e-5)


def test_what_is_missed_counts_bounds_and_both_kinds_of_constraints(question: Question) -> None:
    optimum = first_problem(SMALL).solver.optimise().values[question.kept]
    assert question.missed(optimum) < 1e-6
    narrower = Question(SMALL, first_problem(SMALL))
    narrower.low = optimum - 0.1
    narrower.low[3] = optimum[3] + 0.25
    assert narrower.missed(optimum) == pytest.approx(0.25)
    narrower.low, narrower.high = optimum - 0.1, optimum - 0.2
    assert narrower.missed(optimum) == pytest.approx(0.2)
    g = question.constraints(question.start)
    assert question.equal.sum() == 3
    assert question.missed(question.start) >= np.abs(g[question.equal]).max()


def test_a_solver_is_near_only_when_it_also_holds_the_constraints() -> None:
    trace = Trace((1.0, 2.0, 3.0), (0.1, 0.2005, 0.2), (0.5, HELD, 0.0), "done")
    assert trace.reached_s(0.2) == 2.0
    assert trace.reached_s(0.19) is None


def test_shares_of_the_sensor_add_up_to_it_and_to_the_efficiencies() -> None:
    budget = budget_of(LAYOUT, DEPTHS_MM)
    assert min(budget.both, budget.one, budget.rest, budget.between) > 0.0
    assert budget.both + budget.one + budget.rest + budget.between == pytest.approx(1.0)
    mean = np.mean([pixel_efficiency(LAYOUT, depth) for depth in DEPTHS_MM])
    assert budget.both + budget.one / 2.0 == pytest.approx(mean, rel=1e-9)


@pytest.mark.parametrize("fold_deg", [75.0, 90.0, 120.0, 150.0])
def test_views_of_the_parabola_roll_by_u_cot_half_the_fold(fold_deg: float) -> None:
    """To first order in (u, v): with a lens so long that second order is a hundredth."""
    camera = DesignSpec().camera
    long = camera.replaced(fx_px=40.0 * camera.fx_px, fy_px=40.0 * camera.fy_px)
    layout = faceted_parabola(DesignSpec(camera=long, fold_deg=fold_deg, spacing_mm=0.0))
    expected = expected_rolls_deg(layout, fold_deg)
    np.testing.assert_allclose(rolls_deg(layout), expected, rtol=0.02, atol=1e-6)
    assert expected[2] > 0.1


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10_000), st.floats(0.001, 0.2))
def test_what_the_bound_from_parallax_says_of_convex_regions(seed: int, shift: float) -> None:
    random = np.random.default_rng(seed)
    first, second = (Polygon(shapely.MultiPoint(random.random((9, 2))).convex_hull.exterior.coords) for _ in range(2))
    across, upward = _longest_chord(first, 0), _longest_chord(first, 1)
    assert across * upward <= 2.0 * first.area * (1.0 + 1e-9)
    moved = first.symmetric_difference(translate(first, shift)).area
    assert moved >= 2.0 * first.area * min(1.0, shift / across) * (1.0 - 1e-9)
    apart = sum(first.symmetric_difference(translate(second, by * shift, by * 0.1)).area for by in (-1.0, 1.0))
    for region in (first, second):
        assert apart >= region.symmetric_difference(translate(region, 2.0 * shift, 0.2)).area - 1e-12


def _longest_chord(polygon: Polygon, axis: int) -> float:
    """A longest chord of a convex polygon along an axis passes through one of its corners."""
    chords = []
    for corner in shapely.get_coordinates(polygon):
        low, high = corner.copy(), corner.copy()
        low[axis], high[axis] = -9.0, 9.0
        chords.append(polygon.intersection(shapely.LineString([low, high])).length)
    return max(chords)


def test_the_bound_from_parallax_is_no_bound_at_one_depth_and_above_what_layouts_reach() -> None:
    assert parallax_bound(LAYOUT, (400.0, 400.0)) == 1.0
    mean = np.mean([pixel_efficiency(LAYOUT, depth) for depth in DEPTHS_MM])
    ideal = parallax_bound(LAYOUT, DEPTHS_MM)
    strict = parallax_bound(LAYOUT, DEPTHS_MM, densities(LAYOUT, DEPTHS_MM))
    assert mean < ideal < strict < 1.0
    assert parallax_bound(LAYOUT, (300.0, 2000.0)) < ideal


def test_densities_are_those_of_the_widest_angles() -> None:
    least, greatest = densities(LAYOUT, DEPTHS_MM)
    assert least == min(least, *(densities(LAYOUT, (depth,))[0] for depth in DEPTHS_MM))
    assert 0.5 < least < 1.0
    camera = LAYOUT.camera
    across = (camera.width_px / camera.fx_px / 2.0) ** 2 + (camera.height_px / camera.fy_px / 2.0) ** 2
    assert greatest == pytest.approx((1.0 + across) ** 1.5, rel=1e-3)


def test_the_bound_from_parallax_of_three_by_three_is_its_closed_form() -> None:
    """e + k sqrt(e) = 1 with k = 4 sqrt(2) sqrt(dx dy / (9 A)), from 8 steps along each axis."""
    bound = parallax_bound(LAYOUT, DEPTHS_MM)
    centres = LAYOUT.virtual_centres_in_view_mm
    x, y, z = (centres[..., k] for k in range(3))
    q = abs(np.subtract(*(1.0 / (np.array(DEPTHS_MM) - z.mean()))))
    steps = (x[:, 2] - x[:, 0]).mean() / 2.0 * (y[2] - y[0]).mean() / 2.0 * q**2
    camera = LAYOUT.camera
    sensor = camera.width_px * camera.height_px / (camera.fx_px * camera.fy_px)
    k = 4.0 * np.sqrt(2.0) * np.sqrt(steps / (9.0 * sensor))
    assert bound + k * np.sqrt(bound) == pytest.approx(1.0, rel=1e-9)


def test_prices_name_every_constraint_and_only_active_ones_cost() -> None:
    problem = first_problem(SMALL)
    found = prices(SMALL, problem, problem.solver.optimise().values)
    assert {"gap", "overlap", "light in", "light out", "cut: size", "sensor's borders"} <= set(found)
    assert found["overlap"].active > 0
    assert found["cut: depth"].price < 1e-4


def test_efficiencies_between_points_of_a_front() -> None:
    front = [
        Point(0.1, 0.2, (0.6, 0.5)),
        Point(0.5, 0.1, (0.4, 0.5)),
        Point(0.4, 0.15, (0.3, 0.3)),  # worse than its neighbour in both
    ]
    assert [point.grid_error for point in upper(front)] == [0.1, 0.2]
    np.testing.assert_allclose(efficiency_at(front, 0.15), [0.5, 0.5])
    assert np.isnan(efficiency_at(front, 0.3)).all()


def test_a_gain_counts_only_where_it_is_reached_at_every_depth() -> None:
    front = [Point(0.1, 0.01, (0.35, 0.5)), Point(0.5, 0.2, (0.8, 0.56))]
    lines = compared("any", front, DEPTHS_MM)
    assert "on average" in lines[0] or "no" in lines[0]
    better = [Point(0.1, 0.01, (0.9, 0.9)), Point(0.5, 0.2, (0.9, 0.91))]
    assert all(line.endswith("at every depth") for line in compared("any", better, DEPTHS_MM))


def test_optimising_for_the_pupil_gains_nothing_where_both_fronts_are_the_same() -> None:
    same = [PupilPoint(90.0, error, 0.0, 0.5 + error) for error in (0.2, 0.1, 0.05)]
    assert gained(same, same) == pytest.approx([0.0, 0.0])
    better = [PupilPoint(90.0, point.grid_error, 0.0, point.usable + 0.01) for point in same]
    assert gained(same, better) == pytest.approx([0.01, 0.01])
