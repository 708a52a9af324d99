"""Previews: interpolation between solved designs, its accuracy, and specs without a preview."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest

from mirrorcam.optics.design.assess.layout_metrics import evaluate, grid_error
from mirrorcam.optics.design.optimise import design
from mirrorcam.optics.design.preview import CHANGES, _cost, _mixture, differences, preview, sketch
from mirrorcam.optics.design.program.design_problem import REFERENCE_GRID_ERROR
from mirrorcam.optics.geometry.arrangement import Pattern
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.design_spec import DesignSpec, InfeasibleDesign
from mirrorcam.optics.geometry.layout import Layout
from tests.nightly import a_few

designed = cache(design)
SMALL = DesignSpec(rows=1, cols=2, shape="free")
NARROW = Camera.c920().replaced(fx_px=1.1 * Camera.c920().fx_px, fy_px=1.1 * Camera.c920().fy_px)

BRACKETS: list[tuple[dict[str, Any], dict[str, Any], dict[str, Any]]] = [
    ({"scale_mm": 70.0}, {"scale_mm": 80.0}, {"scale_mm": 90.0}),
    ({"fold_deg": 115.0}, {"fold_deg": 120.0}, {"fold_deg": 125.0}),
    ({"depths_mm": (300.0, 500.0)}, {"depths_mm": (340.0, 500.0)}, {"depths_mm": (380.0, 500.0)}),
    ({"spacing_mm": 1.0}, {"spacing_mm": 2.0}, {"spacing_mm": 3.0}),
    ({"tradeoff": 0.3}, {"tradeoff": 0.35}, {"tradeoff": 0.4}),
    (
        {"camera": Camera.c920()},
        {"camera": Camera.c920().replaced(fx_px=1428.0, fy_px=1428.0)},
        {"camera": NARROW},
    ),
]


def moved_mm(found: Layout, expected: Layout) -> float:
    """Largest distance between corners of mirrors."""
    pairs = zip(found.mirrors, expected.mirrors, strict=True)
    return max(float(np.abs(a.outline_in_rig_mm - b.outline_in_rig_mm).max()) for a, b in pairs)


def seen(layout: Layout, spec: DesignSpec) -> float:
    metrics = evaluate(layout, spec.depths_mm)
    return float(np.mean([metrics[f"pixel_efficiency_{depth:g}mm"].value for depth in spec.depths_mm]))


@pytest.mark.slow
@pytest.mark.parametrize(("low", "between", "high"), a_few(2, BRACKETS), ids=[next(iter(b)) for _, b, _ in BRACKETS])
def test_between_two_designs_it_comes_near_the_exact_one(
    low: dict[str, Any], between: dict[str, Any], high: dict[str, Any]
) -> None:
    spec = SMALL.replaced(**between)
    found = preview(spec, [designed(SMALL.replaced(**low)), designed(SMALL.replaced(**high))])
    exact = designed(spec)
    assert found is not None
    assert seen(found, spec) == pytest.approx(seen(exact, spec), abs=0.01)
    assert grid_error(found) == pytest.approx(grid_error(exact), abs=0.01)
    middle = found.virtual_centres_in_view_mm.mean(axis=(0, 1))
    assert np.abs(middle - spec.scale_mm * (spec.view_from_rig[:, 2] - [0.0, 0.0, 1.0])).max() < 1e-5


def test_the_design_of_a_spec_is_its_own_preview() -> None:
    exact = designed(SMALL)
    found = preview(SMALL, [designed(SMALL.replaced(scale_mm=90.0)), exact])
    assert found is not None
    assert moved_mm(found, exact) < 1e-4
    assert found.provenance["designs"] == exact.identity


def test_it_says_that_it_is_a_preview_and_has_no_figures() -> None:
    spec = SMALL.replaced(scale_mm=85.0)
    found = preview(spec, [designed(SMALL), designed(SMALL.replaced(scale_mm=90.0))])
    assert found is not None
    assert found.spec == spec
    assert "neither optimised nor checked" in found.provenance["preview"]
    assert len(found.provenance["designs"].split()) == 2
    assert (found.metrics, found.verdict) == ({}, {})


def test_a_wider_sensor_is_used_and_a_narrower_one_kept_to() -> None:
    for fx_px in (1000.0, 2000.0):
        spec = SMALL.replaced(camera=Camera.c920().replaced(fx_px=fx_px, fy_px=fx_px))
        found = preview(spec, [designed(SMALL)])
        assert found is not None
        outlines = np.concatenate([found.outline_px(k) for k in range(2)])
        assert outlines.min() >= -0.5 - 1e-3
        assert (outlines <= np.array([1919.5, 1079.5]) + 1e-3).all()
        assert outlines[:, 0].max() - outlines[:, 0].min() > 1900.0


def test_a_fold_to_be_chosen_is_that_of_the_nearest_design() -> None:
    spec = SMALL.replaced(scale_mm=82.0, fold_deg="auto")
    found = preview(spec, [designed(SMALL.replaced(fold_deg=115.0, scale_mm=90.0)), designed(SMALL)])
    assert found is not None
    assert found.spec == spec.replaced(fold_deg=120.0)


def test_where_no_design_is_of_the_kind_there_is_no_preview() -> None:
    exact = designed(SMALL)
    for changes in ({"cols": 3}, {"sides": 5}, {"surface": "second"}, {"depths_mm": (300.0,)}, {"objective": "depth"}):
        other = DesignSpec.model_validate(SMALL.model_dump() | changes)
        assert differences(SMALL, other) is None
        assert preview(other, [exact]) is None
    assert differences(SMALL, DesignSpec(pattern=Pattern.ring(5))) is None
    assert preview(SMALL, []) is None
    assert preview(SMALL, [exact.replaced(spec=None)]) is None


def test_the_nearest_design_replaces_a_mixture_of_two_kinds() -> None:
    low, high = designed(SMALL), designed(SMALL.replaced(scale_mm=90.0))
    # The other design has its views exchanged: an equal optimum whose mean with the first puts both in the centre.
    exchanged = high.replaced(mirrors=tuple(mirror for mirror in high.mirrors[::-1]))
    found = preview(SMALL.replaced(scale_mm=82.0), [low, exchanged])
    assert found is not None
    assert found.provenance["designs"] == low.identity


def test_a_mixture_worse_than_its_parts_is_not_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    low, high = designed(SMALL), designed(SMALL.replaced(scale_mm=90.0))
    spec = SMALL.replaced(scale_mm=82.0)
    for worse, parts in ((0.03, 2), (-0.5, 1)):
        monkeypatch.setattr("mirrorcam.optics.design.preview.MAX_INCREASE", worse)
        found = preview(spec, [low, high])
        assert found is not None
        assert len(found.provenance["designs"].split()) == parts


@pytest.mark.parametrize("measured", [True, False])
def test_the_cost_trades_the_grid_for_the_area_that_is_not_used(measured: bool) -> None:
    layout = designed(SMALL)
    costs = [
        _cost(layout.replaced(spec=SMALL.replaced(tradeoff=tradeoff), metrics=layout.metrics if measured else {}))
        for tradeoff in (0.0, 0.25, 1.0)
    ]
    assert costs[0] == pytest.approx(1.0 - seen(layout, SMALL), rel=1e-3)
    assert costs[1] == pytest.approx(0.75 * costs[0] + 0.25 * costs[2])
    assert costs[2] == pytest.approx((grid_error(layout) / REFERENCE_GRID_ERROR) ** 2)


def test_differences_are_by_parameter_and_antisymmetric() -> None:
    other = SMALL.replaced(scale_mm=100.0, fold_deg=125.0, depths_mm=(300.0, 600.0), spacing_mm=1.5, camera=NARROW)
    there, back = differences(SMALL, other), differences(other, SMALL)
    assert there is not None
    assert back is not None
    assert set(there) == {
        *("scale_mm", "fold_deg", "depths_mm 1", "spacing_mm"),
        *("camera left", "camera top", "camera right", "camera bottom"),
    }
    assert there["fold_deg"] == pytest.approx(5.0 / CHANGES["fold_deg"])
    assert there["scale_mm"] == pytest.approx(np.log(1.25) / CHANGES["scale_mm"])
    assert {name: -by for name, by in back.items() if not name.startswith("camera")} == pytest.approx(
        {name: by for name, by in there.items() if not name.startswith("camera")}
    )
    assert differences(SMALL, SMALL) == {}


def test_the_mixture_interpolates_between_the_nearest() -> None:
    on_a_line = [{"a": -1.0}, {"a": 3.0}, {"a": 30.0}]
    assert _mixture(on_a_line) == pytest.approx([0.75, 0.25, 0.0], abs=0.02)
    assert _mixture([{"a": 1.0}, {"a": 2.0}]) == pytest.approx([1.0, 0.0], abs=0.02)
    corners = [{"a": 1.0, "b": 1.0}, {"a": 1.0, "b": -1.0}, {"a": -1.0, "b": 1.0}, {"a": -1.0, "b": -1.0}]
    assert _mixture(corners) == pytest.approx([0.25] * 4, abs=0.02)
    assert _mixture([{}, {"a": 1.0}]) == pytest.approx([1.0, 0.0])


@pytest.mark.slow
def test_a_sketch_shows_the_field_of_the_design_and_the_trend_of_its_depth() -> None:
    fields, sigmas = [], []
    for scale_mm in (60.0, 90.0):
        spec = SMALL.replaced(scale_mm=scale_mm, depths_mm=(400.0,))
        sketched, exact = (evaluate(layout, spec.depths_mm) for layout in (sketch(spec), designed(spec)))
        fields += [sketched[name].value / exact[name].value for name in ("fov_x_deg", "fov_y_deg")]
        sigmas.append(sketched["depth_sigma_400mm"].value / exact["depth_sigma_400mm"].value)
    assert fields == pytest.approx([1.0] * 4, abs=0.25)
    assert sigmas[0] == pytest.approx(sigmas[1], rel=0.15)


def test_a_scene_nearer_than_the_mirrors_has_no_sketch() -> None:
    with pytest.raises(InfeasibleDesign, match="is nearer than the mirrors"):
        sketch(SMALL.replaced(fold_deg=60.0, scale_mm=300.0, depths_mm=(100.0,)))
