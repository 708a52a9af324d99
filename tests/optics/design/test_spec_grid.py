"""The grid of a sweep, the outcomes of specs, and the figures that compare designs."""

from __future__ import annotations

import subprocess
import sys
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mirrorcam.core.errors import InputError
from mirrorcam.core.values import Metric
from mirrorcam.optics.design import optimise
from mirrorcam.optics.design.spec_grid import Outcome, grid, pareto_front, rows_of, solve, structure, summary_figures
from mirrorcam.optics.geometry.design_spec import DesignSpec, InfeasibleDesign
from mirrorcam.optics.geometry.layout import Layout

AXES: dict[str, Any] = {
    "counts": [(1, 2), (3, 5)],
    "depth_sets_mm": [(300.0, 500.0), (400.0,)],
    "scales_mm": [60.0, 80.0],
    "tradeoffs": [0.1, 0.5],
}


def test_the_grid_is_every_combination_in_order() -> None:
    specs = grid(DesignSpec(spacing_mm=2.0), **AXES)
    assert len(specs) == len(set(specs)) == 16
    assert {spec.spacing_mm for spec in specs} == {2.0}
    assert specs[0] == DesignSpec(rows=1, cols=2, scale_mm=60.0, tradeoff=0.1, spacing_mm=2.0)
    assert [spec.tradeoff for spec in specs[:3]] == [0.1, 0.5, 0.1]
    assert [spec.scale_mm for spec in specs[:5]] == [60.0, 60.0, 80.0, 80.0, 60.0]
    assert [spec.depths_mm for spec in specs[:8]] == [(300.0, 500.0)] * 4 + [(400.0,)] * 4
    assert [(spec.rows, spec.cols) for spec in specs] == [(1, 2)] * 8 + [(3, 5)] * 8


def test_a_grid_holds_specs_and_nothing_derived_from_them() -> None:
    class Wider(DesignSpec):
        note: str = ""

    assert {type(spec) for spec in grid(Wider(note="x"), **AXES)} == {DesignSpec}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"counts": []}, "^counts: no value"),
        ({"counts": [(0, 3)]}, "^counts: 0x3: rows: Input should be greater than or equal to 1"),
        ({"counts": [(1, 1)]}, "^counts: 1x1: rows x cols is 1, expected at least two mirrors"),
        ({"counts": [(2, 2), (3, 3), (2, 2)]}, "^counts: 2x2 is given twice"),
        ({"scales_mm": [80.0, -1.0]}, "^scales_mm: -1.0: scale_mm: Input should be greater than or equal to 0.001"),
        ({"tradeoffs": [2.0]}, "^tradeoffs: 2.0: tradeoff: Input should be less than or equal to 1"),
        ({"depth_sets_mm": [(300.0, 300.0)]}, r"^depth_sets_mm: \(300.0, 300.0\): depths_mm .* a depth twice"),
        ({"depth_sets_mm": [()]}, r"^depth_sets_mm: \(\): depths_mm"),
    ],
)
def test_what_no_spec_takes_is_refused_by_its_axis(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        grid(DesignSpec(), **(AXES | changes))


def test_a_structure_ignores_numbers() -> None:
    spec = DesignSpec(shape="free")
    assert structure(spec) == structure(spec.replaced(scale_mm=50.0, tradeoff=0.9, depths_mm=(200.0, 900.0)))
    for other in ({"rows": 2}, {"cols": 2}, {"depths_mm": (300.0,)}, {"sides": 5}, {"surface": "second"}):
        assert structure(spec) != structure(spec.replaced(**other))


def test_a_solved_spec_brings_its_layout() -> None:
    spec = DesignSpec(rows=1, cols=2)
    outcome, layout = solve(spec)
    assert isinstance(layout, Layout)
    assert (outcome.status, outcome.spec, outcome.constraint, outcome.finding) == ("solved", spec, "", "")
    assert outcome.metrics == layout.metrics
    assert layout.spec == spec


@pytest.mark.parametrize(
    ("error", "status", "constraint", "finding"),
    [
        (InfeasibleDesign("spacing", "2 mm too close"), "infeasible", "spacing", "2 mm too close"),
        (InfeasibleDesign("every", "IPOPT gave up"), "failed", "every", "IPOPT gave up"),
        (RuntimeError("evaluation\nfailed"), "failed", "", "RuntimeError: evaluation failed"),
        (InputError("camera: folds"), "failed", "", "InputError: camera: folds"),
    ],
)
def test_what_goes_wrong_becomes_the_outcome(
    error: Exception, status: str, constraint: str, finding: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def design(spec: DesignSpec) -> Layout:
        raise error

    monkeypatch.setattr(optimise, "design", design)
    outcome, layout = solve(DesignSpec())
    assert layout is None
    assert (outcome.status, outcome.constraint, outcome.finding) == (status, constraint, finding)
    assert outcome.metrics == {}


def test_an_interruption_is_no_outcome(monkeypatch: pytest.MonkeyPatch) -> None:
    def design(spec: DesignSpec) -> Layout:
        raise KeyboardInterrupt

    monkeypatch.setattr(optimise, "design", design)
    with pytest.raises(KeyboardInterrupt):
        solve(DesignSpec())


def outcome_of(spec: DesignSpec, **values: float) -> Outcome:
    metrics = {name: Metric(value=value, unit="") for name, value in values.items()}
    return Outcome(spec=spec, status="solved", metrics=metrics)


def test_figures_that_compare_have_closed_forms() -> None:
    values = {"pixel_efficiency_300mm": 0.5, "pixel_efficiency_500mm": 0.3, "pixel_efficiency_900mm": 0.9}
    outcome = outcome_of(
        DesignSpec(), fov_x_deg=90.0, fov_y_deg=90.0, depth_nearest_mm=250.0, depth_farthest_mm=1000.0, **values
    )
    figures = summary_figures(outcome)
    assert figures["pixel_efficiency_mean"] == pytest.approx(0.4)
    # The diagonal of a square field of view of 90 degrees lies sqrt(2) off the axis at distance 1.
    assert figures["fov_diagonal_deg"] == pytest.approx(109.4712206)
    assert figures["depth_of_field_per_m"] == pytest.approx(3.0)


def test_figures_that_are_not_there_are_none() -> None:
    assert set(summary_figures(outcome_of(DesignSpec())).values()) == {None}


def test_rows_share_their_columns_and_miss_what_is_not_there() -> None:
    first = outcome_of(DesignSpec(), pixel_efficiency_300mm=0.5, pixel_efficiency_500mm=0.3)
    second = outcome_of(DesignSpec(depths_mm=(400.0,)), pixel_efficiency_400mm=0.6)
    third = Outcome(spec=DesignSpec(rows=5), status="infeasible", constraint="spacing", finding="too close")
    rows = rows_of([first, second, third])
    assert [list(row) for row in rows[1:]] == [list(rows[0])] * 2
    assert set(DesignSpec.model_fields) - {"pattern", "objective", "shape", "size_step_mm", "same_size"} <= set(rows[0])
    assert rows[0]["camera"] == "Logitech C920"
    assert [row["depths_mm"] for row in rows] == [[300.0, 500.0], [400.0], [300.0, 500.0]]
    assert [row["pixel_efficiency_400mm"] for row in rows] == [None, 0.6, None]
    assert [row["pixel_efficiency_mean"] for row in rows] == [0.4, 0.6, None]
    assert (rows[2]["status"], rows[2]["constraint"], rows[2]["finding"]) == ("infeasible", "spacing", "too close")


def test_a_figure_that_is_none_is_an_empty_cell_with_its_reason() -> None:
    none = Metric(value=float("nan"), unit="mm", reason="too blurred")
    outcome = outcome_of(DesignSpec(), fov_x_deg=40.0)
    outcome = outcome.replaced(metrics=outcome.metrics | {"fov_y_deg": none, "depth_sigma_300mm": none})
    (row,) = rows_of([outcome])
    assert (row["fov_x_deg"], row["fov_y_deg"], row["fov_diagonal_deg"]) == (40.0, None, None)
    assert row["none"] == "fov_y_deg: too blurred; depth_sigma_300mm: too blurred"
    assert Outcome.model_validate_json(outcome.model_dump_json()) == outcome


POINTS = st.lists(st.tuples(st.integers(0, 5), st.integers(0, 5)), max_size=12)


@given(POINTS)
def test_the_front_is_what_nothing_dominates(points: list[tuple[int, int]]) -> None:
    front = [points[number] for number in pareto_front(points)]
    dominated = {p for p in points for q in points if q != p and q[0] >= p[0] and q[1] >= p[1]}
    assert front == sorted(set(points) - dominated)


def test_the_grid_needs_no_optimiser() -> None:
    heavy = {"casadi", "scipy", "cv2", "shapely"}
    code = f"import mirrorcam.optics.design.spec_grid, sys; print(sorted({heavy} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"
