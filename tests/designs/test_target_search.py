"""The search for designs that meet a target, mostly with sketches in place of designs."""

from __future__ import annotations

from collections.abc import Generator, Sequence
from typing import Any

import pytest

from mirrorcam.core.errors import InputError
from mirrorcam.core.processes.calls import Call, in_turn
from mirrorcam.designs.target import Target, measure
from mirrorcam.designs.target_search import MIRRORS, VARIED, designs_for
from mirrorcam.optics.design.preview import sketch
from mirrorcam.optics.design.spec_grid import Outcome
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.mirror_stock import stock_name

EASY = "2mm@400mm 100x60mm@400mm 2000g"
VARY = ("cols", "scale_mm", "depths_mm")
SPEC = DesignSpec(rows=2, shape="free", thickness_mm=1.0, refractive_index=1.49)


def sketched(calls: Sequence[Call]) -> Generator[Any, None, None]:
    """Sketches in place of the requested designs."""
    for _, (spec,) in calls:
        yield Outcome(spec=spec, status="solved"), sketch(spec)


def refused(calls: Sequence[Call]) -> Generator[Any, None, None]:
    for _, (spec,) in calls:
        yield Outcome(spec=spec, status="infeasible", constraint="spacing", finding="mirrors too close"), None


def test_designs_that_meet_the_target_have_different_counts_and_the_smallest_first() -> None:
    found = designs_for(EASY, SPEC, vary=VARY, calls=sketched)
    assert found.met
    assert all(design.meets for design in found.designs)
    assert len({(design.layout.rows, design.layout.cols) for design in found.designs}) == len(found.designs) > 1
    sizes = [design.log_size for design in found.designs]
    assert sizes == sorted(sizes)
    assert all(design.layout.spec is not None and design.layout.spec.depths_mm == (400.0,) for design in found.designs)


def test_if_no_design_meets_the_target_different_terms_give_way() -> None:
    found = designs_for("0.1mm@400mm 200x150mm@400mm 250g", SPEC, vary=VARY, calls=sketched)
    assert not found.met
    first, second = found.designs
    assert first.gives_way[0] != second.gives_way[0]
    for design in found.designs:
        main, *others = sorted(design.excess.values(), reverse=True)
        assert main == design.excess[design.gives_way[0]]
        assert max(others) < 0.1 * main


def test_the_same_target_gives_the_same_designs() -> None:
    first, second = (designs_for(EASY, SPEC, vary=VARY, calls=sketched) for _ in range(2))
    assert first == second


@pytest.mark.parametrize("vary", [("scale_mm",), ("cols", "fold_deg"), ()])
def test_fields_that_are_not_varied_hold(vary: tuple[str, ...]) -> None:
    spec = SPEC.replaced(rows=1, cols=2, scale_mm=62.5)
    for design in designs_for(EASY, spec, vary=vary, calls=sketched).designs:
        assert design.layout.spec is not None
        for name in set(VARIED) - set(vary):
            assert getattr(design.layout.spec, name) == getattr(spec, name)


def test_a_target_without_distances_keeps_the_working_depths() -> None:
    (design, *_) = designs_for("2000g", SPEC, vary=("scale_mm", "depths_mm"), calls=sketched).designs
    assert design.layout.spec is not None
    assert design.layout.spec.depths_mm == SPEC.depths_mm


def test_a_search_without_any_design_is_refused_with_the_reason() -> None:
    with pytest.raises(InputError, match="no design was found for 300g: mirrors too close"):
        designs_for("300g", SPEC, vary=("scale_mm",), calls=refused)


def test_mirrors_that_cannot_be_cut_are_no_design() -> None:
    thick = DesignSpec(rows=3, cols=4, scale_mm=40.0, thickness_mm=6.0)
    with pytest.raises(InputError, match="no design was found for 300g: mirrors are too narrow"):
        designs_for("300g", thick, vary=(), calls=sketched)


def test_other_mirrors_are_tried_if_no_design_has_the_price() -> None:
    """Designs with cheaper mirrors come first, then the nearest with those of the specification."""
    target, vary = "2mm@400mm 100EUR", ("scale_mm", "depths_mm")
    kept = designs_for(target, SPEC, vary=vary, calls=sketched)
    assert not kept.met
    *found, last = designs_for(target, SPEC, vary=(*vary, *MIRRORS), calls=sketched).designs
    assert found and all(design.meets for design in found)
    assert all(design.estimate.mirrors_eur < last.estimate.mirrors_eur for design in found)
    assert last.layout.spec is not None
    assert stock_name(last.layout.spec) == stock_name(SPEC)


def test_a_design_that_meets_a_target_is_never_followed_by_none() -> None:
    """Its own figures are the limits, so that hardly any other design meets them; searches change the mirrors."""
    for known in (SPEC.replaced(scale_mm=61.3, depths_mm=(400.0,)), SPEC.replaced(surface="second", tradeoff=0.7)):
        layout = sketch(known)
        figures = measure(layout, Target.of("1mm@400mm 150x120mm@400mm 100EUR 100g"))
        sigma, width, price, mass = (metric.value for metric in figures.reached.values())
        side, more = 0.9999 * width, 1.0001
        fits = f"{more * sigma}mm@400mm {side}x{0.8 * side}mm@400mm {more * price}EUR {more * mass}g"
        found = designs_for(fits, SPEC, known=[layout], calls=sketched)
        assert found.met
        assert all(design.meets for design in found.designs[:-1])


def test_a_distance_nearer_than_the_device_is_refused() -> None:
    with pytest.raises(InputError, match="distance 15 mm is nearer than the device"):
        designs_for("1mm@15mm", SPEC, vary=VARY, calls=sketched)


def test_unknown_fields_are_refused() -> None:
    with pytest.raises(InputError, match="vary: colour, expected some of rows, cols"):
        designs_for(EASY, SPEC, vary=("colour",))


def test_progress_never_falls_and_ends_with_the_total() -> None:
    seen: list[tuple[int, int]] = []
    designs_for(EASY, SPEC, vary=("scale_mm",), calls=sketched, progress=lambda *each: seen.append(each))
    assert seen == sorted(seen)
    assert len({total for _, total in seen}) == 1
    assert seen[-1][0] == seen[-1][1]


@pytest.mark.slow
def test_designs_are_exact_and_their_scale_is_the_smallest_that_suffices() -> None:
    """A larger device has finer depth and more mass: the design lies where the depth just suffices."""
    target = Target.of("0.6mm@400mm 260g")
    spec = SPEC.replaced(rows=1, cols=2)
    found = designs_for(target, spec, vary=("scale_mm", "depths_mm"), calls=in_turn)
    (design,) = found.designs
    assert design.meets
    assert all(metric.passed for metric in design.layout.verdict.values())
    depth, mass = design.excess.values()
    assert depth == pytest.approx(0.0, abs=0.05)
    assert mass < depth
