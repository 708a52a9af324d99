"""Terms of a target: how they are read, and the figures that they limit."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from shapely import Polygon, affinity, box

from mirrorcam.core.errors import InputError
from mirrorcam.core.values import Metric
from mirrorcam.designs.target import Target, Term, excess_of, largest_factor, measure
from mirrorcam.optics.design.assess.layout_metrics import evaluate
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.sub_images import common_region

SIZES = st.floats(1.0, 1e3)


@pytest.mark.parametrize(
    "text",
    ["0.3mm@400mm", "150x120mm@400mm", "90EUR", "60EUR+camera", "300g", "8h", "180mm"],
)
def test_a_term_is_read_as_it_is_written(text: str) -> None:
    assert Term.of(text).text == text


@given(st.floats(1e-9, 1e6), st.floats(0.001, 1e6))
def test_a_term_of_any_size_is_read_as_it_is_written(limit: float, distance: float) -> None:
    written = Term(kind="depth_sigma", limits=(limit,), distance_mm=distance).text
    assert Term.of(written).text == written


@pytest.mark.parametrize(
    ("text", "same"),
    [
        ("300um@40cm", "0.3mm@400mm"),
        ("15x12cm@0.4m", "150x120mm@400mm"),
        ("0.3kg", "300g"),
        ("90min", "1.5h"),
        ("18cm", "180mm"),
        (".5mm@1m", "0.5mm@1000mm"),
        ("1e-5mm@1e3mm", "0.00001mm@1000mm"),
    ],
)
def test_units_are_converted(text: str, same: str) -> None:
    assert Term.of(text) == Term.of(same)


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("", r"target '': expected 0\.3mm@400mm"),
        ("90USD", r"target '90USD': expected "),
        ("0.3mm", r"0\.3mm is smaller than any device.* 0\.3mm@400mm"),
        ("-3g", r"target '-3g'"),
        ("0h", "0h is not positive"),
        ("150x120mm", r"target '150x120mm'"),
        ("300g, 0.4kg", "300g and 400g limit the same figure"),
        ("0.3mm@400mm 0.2mm@40cm", "0.3mm@400mm and 0.2mm@400mm limit the same figure"),
        (" ".join(f"1mm@{100 + k}mm" for k in range(11)), "11 distances, expected at most 10"),
    ],
)
def test_a_target_that_cannot_be_is_refused_in_one_line(text: str, found: str) -> None:
    with pytest.raises(InputError, match=found) as caught:
        Target.of(text)
    assert "\n" not in str(caught.value)


def test_terms_come_in_one_text_or_in_several() -> None:
    target = Target.of(["0.3mm@400mm", "0.5mm@600mm", "300g"])
    assert target == Target.of("0.3mm@400mm, 0.5mm@600mm 300g")
    assert target.depths_mm == (400.0, 600.0)
    assert Target.of(target.text) == target


@given(SIZES, SIZES, SIZES, SIZES)
def test_the_largest_rectangle_in_a_rectangle_touches_two_sides(
    a: float, b: float, width: float, height: float
) -> None:
    assert largest_factor(box(0.0, 0.0, a, b), width, height) == pytest.approx(min(a / width, b / height))


@given(SIZES, SIZES)
def test_the_largest_rectangle_in_a_diamond_has_its_corners_on_the_edges(width: float, height: float) -> None:
    diamond = Polygon([(1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0)])
    assert largest_factor(diamond, width, height) == pytest.approx(2.0 / (width + height))
    elsewhere = affinity.translate(affinity.scale(diamond, 3.0, 3.0), 40.0, -70.0)
    assert largest_factor(elsewhere, width, height) == pytest.approx(6.0 / (width + height))


def test_no_region_holds_no_rectangle() -> None:
    assert largest_factor(Polygon(), 1.0, 1.0) == 0.0


def test_the_excess_is_the_logarithm_of_what_is_missed() -> None:
    assert excess_of(Metric(value=330.0, unit="g", limit=300.0)) == pytest.approx(math.log(1.1))
    width = Metric(value=100.0, unit="mm", limit=200.0, lower_is_better=False)
    assert excess_of(width) == pytest.approx(math.log(2.0))
    assert excess_of(Metric(value=math.nan, unit="mm", limit=1.0, reason="no region")) > math.log(100.0)


def test_figures_are_those_of_the_design(default_layout: Layout) -> None:
    spec = DesignSpec()
    metrics = evaluate(default_layout, spec.depths_mm)
    target = Target.of("0.1mm@300mm 0.1mm@500mm 40x10mm@500mm 1000g 1000EUR 100h 1000mm")
    design = measure(default_layout, target)
    for depth in ("300mm", "500mm"):
        assert design.reached[f"0.1mm@{depth}"].value == pytest.approx(metrics[f"depth_sigma_{depth}"].value)
    region, _ = common_region(default_layout, 500.0)
    left, low, right, high = region.bounds
    width = design.reached["40x10mm@500mm"].value
    assert width <= right - left
    assert width / 4.0 <= high - low
    estimate = design.estimate
    device = [design.reached[term].value for term in ("1000g", "1000EUR", "100h", "1000mm")]
    assert device == [estimate.mass_g, estimate.price_eur, estimate.print_h, max(estimate.size_mm)]
    missed = [term for term in ("0.1mm@300mm", "0.1mm@500mm") if design.reached[term].value > 0.1]
    assert set(design.gives_way) == set(missed)
    assert design.meets == (not missed)


def test_a_distance_behind_the_mirrors_has_no_figure(default_layout: Layout) -> None:
    design = measure(default_layout, Target.of("1mm@20mm 10x10mm@20mm"))
    assert not design.reached["1mm@20mm"].known
    assert design.reached["10x10mm@20mm"].value == 0.0
    assert len(design.gives_way) == 2


def test_the_price_without_the_camera_is_lower_by_the_camera(default_layout: Layout) -> None:
    design = measure(default_layout, Target.of("500EUR 400EUR+camera"))
    with_camera, without = (design.reached[term].value for term in ("500EUR", "400EUR+camera"))
    assert with_camera - without == pytest.approx(design.estimate.camera_eur)
