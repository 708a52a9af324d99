"""The optimiser's own expressions against the core's functions, and the derivatives of every kind of term."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from shapely import Polygon

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.design.assess.layout_metrics import grid_error
from mirrorcam.optics.design.program import constraints
from mirrorcam.optics.design.program.mirror_variables import Kind
from mirrorcam.optics.design.program.seeds import faceted_parabola
from mirrorcam.optics.design.program.terms import ELASTIC, Term
from mirrorcam.optics.geometry.arrangement import Pattern
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.mirror_gaps import area_mm2, edges_mm
from mirrorcam.optics.geometry.sub_images import whole_pupil_outline
from tests.optics.design.program.seeded_mirrors import (
    KINDS,
    expressed,
    fold_of,
    lens_of,
    number,
    optics_of,
    seeded,
    spec_of,
)


@pytest.mark.parametrize(
    "asked",
    [*({"rows": rows, "cols": cols} for rows, cols in [(3, 3), (2, 4), (1, 3), (3, 1)]), {"pattern": Pattern.ring(5)}],
    ids=["3x3", "2x4", "1x3", "3x1", "ring5"],
)
def test_grid_error_is_that_of_the_metrics(asked: dict[str, object]) -> None:
    layout = faceted_parabola(DesignSpec.model_validate(asked))
    centres = [ca.SX(centre) for centre in layout.virtual_centres_in_view_mm.reshape(-1, 3)]
    squared, spacings = constraints.squared_grid_error(centres, layout.arrangement)
    assert np.sqrt(number(squared).item()) == pytest.approx(grid_error(layout))
    assert len(spacings) == (layout.arrangement.extent > 0).sum()
    assert all(number(spacing).item() > 0 for spacing in spacings)


def test_a_region_starts_as_a_polygon_that_winds_from_x_to_minus_y() -> None:
    region = Polygon(constraints.region_directions())
    assert region.is_valid
    assert not region.exterior.is_ccw
    assert region.area == pytest.approx(constraints.REGION_CORNERS / 2 * np.sin(2 * np.pi / constraints.REGION_CORNERS))


@pytest.mark.parametrize("fold_deg", [90.0, 110.0])
@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind.second_surface])
def test_usable_edges_are_those_of_the_mirror(kind: Kind, fold_deg: float) -> None:
    spec = spec_of(kind, fold_deg)
    for index in range(4):
        mine, theirs = expressed(spec, kind, index)
        edges = constraints._usable_edges(kind, mine)
        ends = np.array([[number(end).ravel() @ spec.view_from_rig for end in edge] for edge in edges])
        lines = ends[..., :2] / ends[..., 2:]
        # Corners where lines of neighbouring edges cross; every line bounds what the core says is usable.
        usable = theirs.usable_normalized
        assert len(usable) == kind.sides
        for a, b in lines:
            along = (b - a) / np.linalg.norm(b - a)
            inside = along[0] * (usable - a)[:, 1] - along[1] * (usable - a)[:, 0]
            assert inside.min() == pytest.approx(0.0, abs=2e-5)
            assert np.sort(inside)[1] == pytest.approx(0.0, abs=2e-5), "the line runs along an edge, not past a corner"
            assert inside.max() > 0.05


def test_usable_edges_lose_what_light_needs_to_enter() -> None:
    kind = Kind(4, False, True)
    spec = spec_of(kind)
    _, theirs = expressed(spec, kind, 0)
    seen, shown = Polygon(theirs.apparent.outline_normalized), Polygon(theirs.usable_normalized)
    assert shown.area < 0.98 * seen.area


def term_value(term: Term, unknowns: list[FloatArray], parameters: list[FloatArray]) -> tuple[float, FloatArray]:
    f, g = term.value(np.concatenate(unknowns), np.concatenate(parameters))
    return float(f), np.array(g).ravel()


@pytest.mark.parametrize("kind", KINDS)
def test_a_mirror_term_measures_edges_area_and_depth(kind: Kind) -> None:
    spec = spec_of(kind, 100.0)
    centres, corners = seeded(spec)
    _, mirror = expressed(spec, kind, 1)
    rest = np.array([0.1, 0.02, 4.0, 0.09, 0.0])
    term = constraints.mirror_term(kind)
    _, g = term_value(term, [fold_of(spec), centres[1], corners[1]], [np.array(optics_of(spec)), *lens_of(spec), rest])
    size, depth = (g[term.family == ELASTIC.index(name)] for name in ("size", "depth"))
    apparent = mirror.apparent
    assert_allclose(size[:-1], (edges_mm(apparent) / 80.0) ** 2 - 0.01 - constraints.MARGIN, atol=1e-6)
    assert size[-1] == pytest.approx(area_mm2(apparent) / 6400.0 - 0.02 - constraints.MARGIN, abs=1e-6)
    reach = (mirror.solid.corners_in_rig_mm @ spec.view_from_rig[2]).max() / 80.0
    assert depth.min() == pytest.approx(4.0 - reach - constraints.MARGIN, abs=1e-6)


@pytest.mark.parametrize("kind", KINDS)
def test_a_view_term_counts_the_pixels_that_show_a_region(kind: Kind) -> None:
    spec, depth = spec_of(kind, 105.0), 5.0
    centres, corners = seeded(spec)
    _, mirror = expressed(spec, kind, 2)
    aim = spec.view_from_rig[:2, 2]
    tangents = constraints.region_directions() * [0.13, 0.07]
    region = np.column_stack([aim + tangents * (1.0 + depth), np.full(len(tangents), depth)])
    points = mirror.apparent.reflect(region * 80.0 @ spec.view_from_rig)
    camera = spec.camera
    normalized = points[:, :2] / points[:, 2:]
    along = np.linspace(0.0, 1.0, 64, endpoint=False)[:, None, None]
    outline = normalized * (1.0 - along) + np.roll(normalized, -1, axis=0) * along
    seen = camera.pixels_from_normalized(outline.swapaxes(0, 1).reshape(-1, 2))
    share = Polygon(seen).area / (camera.width_px * camera.height_px)
    term = constraints.view_term(kind)
    numbers = [np.array(optics_of(spec)), *lens_of(spec), np.array([depth, 0.09, 2.0, 0.01, 0.0, 0.0])]
    f, g = term_value(term, [fold_of(spec), centres[2], corners[2], tangents.ravel()], numbers)
    assert -f / 2.0 == pytest.approx(share, rel=1e-4)
    assert g[-1] == pytest.approx(share - 0.01, abs=1e-5)
    # The least of the others says by what area over a tile's the region's nearest corner lies within an edge.
    usable = Polygon(whole_pupil_outline(mirror, camera.pupil))
    assert (g[:-1] >= 0).all() == usable.contains(Polygon(normalized))
    far = term_value(term, [fold_of(spec), centres[2], corners[2], 3.0 * tangents.ravel()], numbers)[1]
    assert far[:-1].min() < 0


# Regions: star-shaped about their middles and wound once.


@settings(max_examples=60)
@given(st.lists(st.floats(0.2, 3.0), min_size=8, max_size=8), st.lists(st.floats(-0.38, 0.38), min_size=8, max_size=8))
def test_a_region_in_order_is_a_simple_polygon_that_its_middle_sees(reach: list[float], aside: list[float]) -> None:
    term, half = constraints.region_term(), np.array([0.3, 0.2])
    angles = 2.0 * np.pi * (np.arange(8) + 0.5) / 8 + aside
    spokes = np.array(reach)[:, None] * np.column_stack([np.cos(angles), -np.sin(angles)])
    middle = np.array([0.1, -0.2])
    corners = middle + half * spokes
    g = np.array(term.value(np.concatenate([middle, corners.ravel()]), half)[1])
    assert (g > 0).all()
    assert Polygon(corners).is_valid
    swapped = corners[[1, 0, *range(2, 8)]]
    assert (np.array(term.value(np.concatenate([middle, swapped.ravel()]), half)[1]) < 0).any()
