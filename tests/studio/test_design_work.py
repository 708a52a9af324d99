"""What the studio's processes answer."""

from __future__ import annotations

import pytest

from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.studio import design_work
from mirrorcam.studio.design_values import COMPARED, DesignDrawing, RefusedDesign, SolvedDesign

SMALL = DesignSpec(rows=1, cols=2, depths_mm=(300.0,))


@pytest.fixture(scope="module")
def small() -> SolvedDesign:
    found = design_work.solve(SMALL)
    assert isinstance(found, SolvedDesign)
    return found


def test_a_request_is_solved_with_its_figures(small: SolvedDesign) -> None:
    assert small.drawing.kind == "exact"
    assert small.drawing.identity == small.layout.identity
    assert set(small.values) == {compared.start for compared in COMPARED}
    assert None not in small.values.values()
    assert small.values["depth_sigma"] == small.layout.metrics["depth_sigma_300mm"].value


def test_a_request_that_cannot_be_is_refused_as_a_value() -> None:
    found = design_work.solve(DesignSpec(seen_gap_mm=200.0))
    assert isinstance(found, RefusedDesign)
    assert found.constraint == "seen gap"
    assert "200 mm apart" in found.finding


def test_a_preview_is_the_parabola_until_something_near_was_solved(
    small: SolvedDesign, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(design_work, "_known_layouts", type(design_work._known_layouts)(maxlen=5))
    other = SMALL.replaced(scale_mm=90.0)
    first = DesignDrawing.model_validate_json(design_work.preview(other) or "")
    assert first.kind == "parabola"
    design_work.remember(small.layout)
    second = DesignDrawing.model_validate_json(design_work.preview(other) or "")
    assert second.kind == "preview"
    assert second.spec["scale_mm"] == 90.0
    assert second.verdict == []


def test_nothing_is_previewed_where_there_is_nothing_to_show() -> None:
    assert design_work.preview(DesignSpec(rows=7, cols=7, spacing_mm=40.0)) is None


@pytest.mark.slow
def test_the_report_holds_figures_and_pictures(small: SolvedDesign) -> None:
    page = design_work.report(small.layout)
    assert small.layout.identity in page
    assert page.count("data:image/png;base64,") == 3


def test_a_layout_that_was_solved_before_keeps_its_figures(default_layout: Layout) -> None:
    found = design_work.solved_design(default_layout.replaced(spec=DesignSpec()))
    assert found.drawing.identity == default_layout.identity
    assert {figure.name for figure in found.drawing.verdict} >= {"smallest_gap_mm", "blocked_light"}
