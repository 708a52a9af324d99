"""Designs of rectangles: cut in steps, or of sizes that are sold."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest

from mirrorcam.optics.design.assess.verify import require_passed, verify
from mirrorcam.optics.design.optimise import design
from mirrorcam.optics.geometry.design_spec import DesignSpec, InfeasibleDesign
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror_gaps import edges_mm

designed = cache(design)
SMALL = DesignSpec(rows=2, cols=2, shape="free")
"""A grid that is designed in a second."""


def sizes_mm(layout: Layout) -> list[list[float]]:
    return [edges_mm(mirror)[:2].round(4).tolist() for mirror in layout.mirrors]


def usable(layout: Layout) -> float:
    return float(np.mean([layout.metrics[f"usable_efficiency_{depth}mm"].value for depth in (300, 500)]))


def test_cut_rectangles_keep_most_of_the_pixels() -> None:
    layout = designed(DesignSpec(shape="rectangles"))
    assert all(side == round(side) for size in sizes_mm(layout) for side in size)
    assert usable(layout) >= 0.85 * usable(designed(DesignSpec()))


@pytest.mark.slow
def test_one_size_of_stock_keeps_most_of_the_pixels_at_the_best_fold() -> None:
    spec = DesignSpec(shape="stock:25x15,25x20,30x20", same_size=True, fold_deg="auto")
    layout = designed(spec)
    assert len({tuple(sorted(size)) for size in sizes_mm(layout)}) == 1
    assert usable(layout) >= 0.72 * usable(designed(DesignSpec(fold_deg="auto")))


@pytest.mark.parametrize(
    ("field", "least", "name"),
    [("min_edge_mm", 20.0, "shortest_edge_mm"), ("min_area_mm2", 800.0, "smallest_area_mm2")],
)
def test_rectangles_are_as_large_as_requested(field: str, least: float, name: str) -> None:
    layout = design(DesignSpec(rows=2, cols=4, fold_deg=90.0).replaced(**{field: least}))
    assert least * (1.0 - 1e-6) <= layout.metrics[name].value < 1.1 * least


@pytest.mark.slow
def test_rectangles_for_depth_have_a_fifth_less_sigma_than_those_for_overlap() -> None:
    overlap, depth = (design(DesignSpec.model_validate({"objective": name})) for name in ("overlap", "depth"))
    for working in (300, 500):
        sigma, usable_there = f"depth_sigma_{working}mm", f"usable_efficiency_{working}mm"
        assert depth.metrics[sigma].value < 0.8 * overlap.metrics[sigma].value
        assert depth.metrics[usable_there].value >= 0.98 * overlap.metrics[usable_there].value


@pytest.mark.parametrize("surface", ["first", "second"])
def test_sides_are_multiples_of_the_step_on_the_reflecting_surface(surface: str) -> None:
    spec = SMALL.replaced(shape="rectangles", size_step_mm=2.5, surface=surface, thickness_mm=2.0)
    layout = designed(spec)
    assert (np.mod(sizes_mm(layout), 2.5) == 0.0).all()
    assert layout.verdict["off_rectangle_mm"].value < 1e-5


def test_each_mirror_gets_a_size_of_the_list() -> None:
    layout = designed(SMALL.replaced(shape="stock:40x30,50x30,60x40"))
    assert {tuple(sorted(size)) for size in sizes_mm(layout)} <= {(30.0, 40.0), (30.0, 50.0), (40.0, 60.0)}


@pytest.mark.slow
def test_the_list_is_at_least_as_good_as_its_best_size() -> None:
    shape = "stock:40x30,50x30"
    each, one = (designed(SMALL.replaced(shape=shape, same_size=same)) for same in (False, True))
    assert len({tuple(size) for size in sizes_mm(one)}) == 1
    assert usable(each) >= usable(one) - 1e-3


@pytest.mark.parametrize(
    ("fields", "first", "last"),
    [
        ({"shape": "free"}, (0, 2), (2, 2)),
        ({}, (0, 3), (3, 3)),
        ({"same_size": True}, (0, 6), (6, 6)),
        ({"objective": "depth"}, (0, 8), (8, 8)),
        ({"spacing_mm": 25.0}, (0, 3), (4, 4)),
        ({"shape": "stock:25x15,25x20,30x20"}, (0, 15), (9, 15)),
    ],
    ids=str,
)
def test_searches_for_sizes_are_counted_from_the_start_and_no_count_decreases(
    fields: dict[str, Any], first: tuple[int, int], last: tuple[int, int]
) -> None:
    counts: list[tuple[int, int]] = []
    spec = DesignSpec(rows=1, cols=2, depths_mm=(300.0,)).replaced(**fields)
    design(spec, progress=lambda *count: counts.append(count))
    assert (counts[0], counts[-1]) == (first, last)
    for column in zip(*counts, strict=True):
        assert list(column) == sorted(column)


def test_sizes_far_larger_than_the_sensor_sees_are_refused_at_once() -> None:
    with pytest.raises(InfeasibleDesign, match="no mirror at scale 80 mm has space for the smallest size, 400 x 300"):
        design(SMALL.replaced(shape="stock:400x300,500x400"))


@pytest.mark.parametrize(
    ("shape", "same_size", "name"),
    [("stock:41x30,50x30", False, "off_size_mm"), ("rectangles", True, "size_spread_mm")],
)
def test_the_verdict_finds_other_sizes(shape: str, same_size: bool, name: str) -> None:
    layout = designed(SMALL.replaced(shape="rectangles"))
    verdict = verify(layout, SMALL.replaced(shape=shape, same_size=same_size))
    assert not verdict[name].passed
    with pytest.raises(InfeasibleDesign, match="size"):
        require_passed(verdict)


def test_the_verdict_finds_quadrilaterals_that_are_no_rectangles() -> None:
    verdict = verify(designed(SMALL), SMALL.replaced(shape="rectangles"))
    assert not verdict["off_rectangle_mm"].passed
