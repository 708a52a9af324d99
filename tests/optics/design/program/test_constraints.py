"""The optimiser's expressions against the functions of `geometry`, and the derivatives of every kind of term."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from shapely import Polygon

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.design.assess.depth_sigma import depth_sigma_mm
from mirrorcam.optics.design.assess.layout_metrics import grid_error
from mirrorcam.optics.design.program import constraints
from mirrorcam.optics.design.program.constraints import region_directions
from mirrorcam.optics.design.program.mirror_variables import Kind
from mirrorcam.optics.design.program.seeds import faceted_parabola, mirrors_of
from mirrorcam.optics.design.program.terms import ELASTIC, Term
from mirrorcam.optics.geometry.arrangement import Pattern
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror_gaps import area_mm2, edges_mm
from mirrorcam.optics.geometry.pupil import SHARP_VARIANCE_PX2
from mirrorcam.optics.geometry.sub_images import unvignetted_outline
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

SPEC = spec_of(KINDS[4], 105.0)
SCALE_MM, CAMERA = SPEC.scale_mm, SPEC.camera
CENTRES, CORNERS = seeded(SPEC)
INVERSE_FOCUS = SCALE_MM / CAMERA.focus_mm
BLUR = CAMERA.fx_px * CAMERA.aperture_mm / SCALE_MM / 4.0 / np.sqrt(SHARP_VARIANCE_PX2)
REGION = (region_directions() * [0.11, 0.08] + np.random.default_rng(5).normal(0.0, 0.005, (8, 2))).ravel()
USES: dict[str, tuple[Term, FloatArray, FloatArray]] = {
    "sigma": (
        constraints.depth_sigma_term(4, 3),
        np.concatenate([fold_of(SPEC), CENTRES.ravel()]),
        np.array([5.0, 0.1, -0.06, INVERSE_FOCUS, BLUR, 0.5]),
    ),
    "field of view": (
        constraints.field_of_view_term(4),
        np.concatenate([REGION, CENTRES.ravel()]),
        np.array([5.0, 0.1, 0.05]),
    ),
    "grid limit": (
        constraints.grid_limit_term(SPEC.arrangement),
        CENTRES.ravel(),
        np.array([0.25]),
    ),
}


@pytest.mark.parametrize(
    "requested",
    [*({"rows": rows, "cols": cols} for rows, cols in [(3, 3), (2, 4), (1, 3), (3, 1)]), {"pattern": Pattern.ring(5)}],
    ids=["3x3", "2x4", "1x3", "3x1", "ring5"],
)
def test_grid_error_is_that_of_the_metrics(requested: dict[str, object]) -> None:
    layout = faceted_parabola(DesignSpec.model_validate(requested))
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
        # Corners where lines of neighbouring edges cross; every line bounds the usable part of `geometry`.
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
    numbers = [np.array(optics_of(spec)), *lens_of(spec), np.array([depth, 0.09, 2.0, 0.01])]
    f, g = term_value(term, [fold_of(spec), centres[2], corners[2], tangents.ravel()], numbers)
    assert -f / 2.0 == pytest.approx(share, rel=1e-4)
    assert g[-1] == pytest.approx(share - 0.01, abs=1e-5)
    # The smallest of the others is the signed area, relative to a tile, of the region's nearest corner and an edge.
    usable = Polygon(unvignetted_outline(mirror, camera.pupil))
    assert (g[:-1] >= 0).all() == usable.contains(Polygon(normalized))
    far = term_value(term, [fold_of(spec), centres[2], corners[2], 3.0 * tangents.ravel()], numbers)[1]
    assert far[:-1].min() < 0


# Regions: star-shaped about their centres with winding number one.


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


def layout_of(centres: FloatArray) -> Layout:
    mirrors = mirrors_of(SPEC, centres * SCALE_MM, CORNERS.reshape(4, -1, 2))
    return Layout(rows=2, cols=2, camera=CAMERA, mirrors=mirrors, view_from_rig=SPEC.view_from_rig)


def sigma(centres: FloatArray, depth: float, tangents: list[float]) -> float:
    """The term's standard deviation, up to a factor."""
    term, unknowns = constraints.depth_sigma_term(4, 3), np.concatenate([fold_of(SPEC), centres.ravel()])
    return float(term.value(unknowns, [depth, *tangents, INVERSE_FOCUS, BLUR, 1.0])[0])


@pytest.mark.parametrize("depth_mm", [300.0, 500.0])
@pytest.mark.parametrize("tangents", [[0.0, 0.0], [0.1, -0.06]])
def test_the_standard_deviation_changes_as_the_bound_does(depth_mm: float, tangents: list[float]) -> None:
    wider = CENTRES + 0.2 * (CENTRES - CENTRES.mean(axis=0)) * [1.0, 1.0, 0.0]
    across = SPEC.view_from_rig[:2, 2] * SCALE_MM + np.array(tangents) * (SCALE_MM + depth_mm)
    bounds = [depth_sigma_mm(layout_of(centres), np.array([[*across, depth_mm]]))[0] for centres in (CENTRES, wider)]
    found = [sigma(centres, depth_mm / SCALE_MM, tangents) for centres in (CENTRES, wider)]
    assert bounds[1] < 0.9 * bounds[0]
    # The term takes the views' mean shift for the same at all frequencies.
    assert found[1] / found[0] == pytest.approx(bounds[1] / bounds[0], rel=0.01)


def test_a_field_of_view_is_a_tangent_from_the_mean_virtual_centre() -> None:
    half = np.array([0.12, 0.07])
    corners = (np.sign(region_directions()) * half).ravel()
    size = number(constraints.field_of_view(ca.SX(corners), [ca.SX(c) for c in CENTRES], 5.0)).ravel()
    assert_allclose(size, 2.0 * half * 6.0 / (5.0 - CENTRES[:, 2].mean()))


def test_the_limit_is_one_of_the_grid_error() -> None:
    term, x, p = USES["grid limit"]
    g = np.array(term.value(x, p)[1]).ravel()
    assert g[-1] == pytest.approx(p[0] ** 2 - grid_error(layout_of(CENTRES)) ** 2)


@pytest.mark.parametrize("name", USES)
def test_derivatives_agree_with_differences(name: str) -> None:
    term, x, p = USES[name]
    weight, multipliers = 0.6, np.random.default_rng(2).normal(0.0, 1.0, term.family.size)
    steps = 1e-6 * np.eye(x.size)

    def lagrangian(at: FloatArray) -> float:
        f, g = term.value(at, p)
        return float(weight * float(f) + multipliers @ np.array(g).ravel())

    def slopes(at: FloatArray) -> FloatArray:
        jacobian = np.zeros((term.family.size, term.unknowns))
        np.add.at(jacobian, (term.rows, term.cols), np.array(term.jacobian(at, p)).ravel())
        return np.asarray(weight * np.array(term.gradient(at, p)).ravel() + jacobian.T @ multipliers)

    differences = np.array([(lagrangian(x + by) - lagrangian(x - by)) / 2e-6 for by in steps])
    assert_allclose(slopes(x), differences, rtol=1e-6, atol=1e-7)
    upper = np.zeros((x.size, x.size))
    np.add.at(upper, (term.upper_rows, term.upper_cols), np.array(term.hessian(x, p, weight, multipliers)).ravel())
    second = np.array([(slopes(x + by) - slopes(x - by)) / 2e-6 for by in steps])
    assert_allclose(upper + np.triu(upper, 1).T, second, rtol=1e-6, atol=1e-6)
