"""Suggestions: values for which a design exists, and none exists halfway back to the requested value."""

from __future__ import annotations

from collections.abc import Generator, Sequence
from functools import cache
from typing import Any

import numpy as np
import pytest

from mirrorcam.core.processes.calls import Call, in_parallel
from mirrorcam.core.processes.worker_process import WorkerProcess
from mirrorcam.optics.design.assess.verify import verify
from mirrorcam.optics.design.optimise import design
from mirrorcam.optics.design.suggestions import PARAMETERS, Suggestion, _rounded, nearest_feasible, suggestions
from mirrorcam.optics.geometry.design_spec import DesignSpec, InfeasibleDesign

CASES: dict[str, tuple[dict[str, Any], set[str]]] = {
    "size": ({"rows": 1, "cols": 2, "min_edge_mm": 200.0}, {"min_edge_mm", "scale_mm"}),
    "spacing": ({"rows": 2, "cols": 2, "spacing_mm": 100.0}, {"spacing_mm", "scale_mm"}),
    "seen gap": ({"rows": 1, "cols": 2, "seen_gap_mm": 120.0}, {"seen_gap_mm", "scale_mm"}),
    "body": ({"rows": 1, "cols": 2, "body_clearance_mm": 150.0}, {"body_clearance_mm", "scale_mm"}),
    "depth": ({"depths_mm": (10.0, 500.0), "fold_deg": 90.0}, {"depths_mm"}),
}


@cache
def refusal(constraint: str) -> InfeasibleDesign:
    with pytest.raises(InfeasibleDesign) as refused:
        design(spec_of(constraint))
    assert refused.value.constraint == constraint
    return refused.value


@cache
def found(constraint: str) -> list[Suggestion]:
    return nearest_feasible(spec_of(constraint), refusal(constraint))


def spec_of(constraint: str) -> DesignSpec:
    return DesignSpec.model_validate(CASES[constraint][0])


@pytest.mark.slow
@pytest.mark.parametrize("constraint", CASES)
def test_each_suggestion_changes_one_parameter_and_is_designed(constraint: str) -> None:
    spec, expected = spec_of(constraint), CASES[constraint][1]
    assert {suggestion.parameter for suggestion in found(constraint)} >= expected
    assert [s.change for s in found(constraint)] == sorted(s.change for s in found(constraint))
    for suggestion in found(constraint):
        mended, layout = suggestion.spec, suggestion.layout
        assert mended.replaced(**{suggestion.parameter: getattr(spec, suggestion.parameter)}) == spec
        assert 0.0 < suggestion.change <= 1.0
        assert layout.spec == mended
        assert layout.verdict == verify(layout, mended)
        assert all(metric.passed for metric in layout.verdict.values())
        assert layout.metrics
        assert all(metric.passed for metric in design(mended).verdict.values())


@pytest.mark.slow
@pytest.mark.parametrize("constraint", CASES)
def test_halfway_back_to_the_requested_value_there_is_no_design(constraint: str) -> None:
    spec = spec_of(constraint)
    for suggestion in found(constraint):
        if suggestion.parameter not in CASES[constraint][1]:
            continue
        now, then = (np.atleast_1d(getattr(each, suggestion.parameter)) for each in (spec, suggestion.spec))
        between = tuple(float(value) for value in (now + then) / 2.0)
        value = between if suggestion.parameter == "depths_mm" else between[0]
        with pytest.raises(InfeasibleDesign):
            design(spec.replaced(**{suggestion.parameter: value}))


@pytest.mark.slow
def test_fewer_mirrors_and_another_fold_also_help() -> None:
    assert {suggestion.parameter for suggestion in found("spacing")} & {"rows", "cols"}
    spec = DesignSpec(rows=1, cols=2, scale_mm=20.0, fold_deg=150.0)
    by_parameter = {s.parameter: s for s in suggestions(spec, InfeasibleDesign("body", "0.6 mm too close"))}
    fold = by_parameter["fold_deg"].spec.fold_deg
    assert fold != "auto"
    assert 120.0 < fold < 150.0
    assert fold == round(fold, 1)
    assert 0.0 < by_parameter["body_clearance_mm"].spec.body_clearance_mm < 8.0


@pytest.mark.slow
def test_they_are_the_same_in_two_processes() -> None:
    worker = WorkerProcess(preload=["mirrorcam.optics.design.suggestions"])
    try:
        elsewhere = nearest_feasible(spec_of("size"), refusal("size"), in_parallel(worker))
    finally:
        worker.kill()
    assert [s.layout.model_dump_json() for s in elsewhere] == [s.layout.model_dump_json() for s in found("size")]


@pytest.mark.slow
def test_parameters_that_do_not_relieve_the_constraint_are_not_tried() -> None:
    tried: list[Call] = []

    def noted(calls: Sequence[Call]) -> Generator[Any, None, None]:
        tried.extend(calls)
        yield from ()

    assert list(suggestions(spec_of("size"), refusal("size"), noted)) == []
    parameters = {PARAMETERS[what].name if isinstance(what, int) else what for _, (_, what) in tried}
    assert parameters == {"scale_mm", "min_edge_mm", "min_area_mm2"}


def test_values_are_rounded_away_from_what_they_were() -> None:
    assert _rounded(np.array([100.0]), np.array([62.76])) == pytest.approx([62.7])
    assert _rounded(np.array([80.0]), np.array([121.01])) == pytest.approx([122.0])
    assert _rounded(np.array([10.0, 500.0]), np.array([26.41, 1320.1])) == pytest.approx([26.5, 1330.0])
    assert _rounded(np.array([1.0]), np.array([0.0])) == pytest.approx([0.0])
