"""The optimiser's own expressions against the core's functions, and the derivatives of every kind of term."""

from __future__ import annotations

from collections.abc import Callable

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from shapely import Polygon
from shapely.ops import nearest_points

from mirrorcam.optics.base.values import FloatArray
from mirrorcam.optics.design.assess.layout_metrics import grid_error
from mirrorcam.optics.design.program import constraints
from mirrorcam.optics.design.program.mirror_variables import Kind
from mirrorcam.optics.design.program.seeds import faceted_parabola
from mirrorcam.optics.design.program.terms import ELASTIC, Expression, Indices, Term
from mirrorcam.optics.geometry.arrangement import Arrangement, Pattern
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.mirror_gaps import area_mm2, edges_mm
from mirrorcam.optics.geometry.pupil import whole_pupil_outline
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
    numbers = [np.array(optics_of(spec)), *lens_of(spec), np.array([depth, 0.09, 2.0, 0.01])]
    f, g = term_value(term, [fold_of(spec), centres[2], corners[2], tangents.ravel()], numbers)
    assert -f / 2.0 == pytest.approx(share, rel=1e-4)
    assert g[-1] == pytest.approx(share - 0.01, abs=1e-5)
    # The least of the others says by what area over a tile's the region's nearest corner lies within an edge.
    usable = Polygon(whole_pupil_outline(mirror, camera.pupil))
    assert (g[:-1] >= 0).all() == usable.contains(Polygon(normalized))
    far = term_value(term, [fold_of(spec), centres[2], corners[2], 3.0 * tangents.ravel()], numbers)[1]
    assert far[:-1].min() < 0


@pytest.mark.parametrize(("first", "second"), [(0, 1), (1, 2), (2, 0)])
@pytest.mark.parametrize("sides", [4, 5, 6])
def test_a_seen_gap_term_measures_how_far_sub_images_are_apart(sides: int, first: int, second: int) -> None:
    _, corners = seeded(spec_of(Kind(sides, False, False)))
    outlines = [corners[k].reshape(-1, 2) for k in (first, second)]
    bodies = [Polygon(outline) for outline in outlines]
    a, b = (np.array(point.coords[0]) for point in nearest_points(*bodies))
    term, gap = constraints.seen_gap_term(sides), 0.003
    found = []
    for turn in np.radians([0.0, -3.0, 3.0, 30.0, 180.0]):
        cos, sin = np.cos(turn), np.sin(turn)
        normal = np.array([[cos, -sin], [sin, cos]]) @ (b - a) / np.linalg.norm(b - a)
        line = np.array([*normal, -(outlines[0] @ normal).max()])
        _, g = term_value(term, [*(outline.ravel() for outline in outlines), line], [np.array([gap])])
        apart = term.family == ELASTIC.index("seen gap")
        # For a line of unit normal that touches the first: the excess of the gap to every corner of the second.
        assert g[~apart].min() == pytest.approx(0.0, abs=1e-12)
        assert_allclose(np.sort(g[apart]), np.sort(outlines[1] @ normal + line[2] - gap - constraints.MARGIN))
        found.append(float(g[apart].min()))
    assert found[0] == pytest.approx(bodies[0].distance(bodies[1]) - gap - constraints.MARGIN, abs=1e-12)
    assert max(found[1:]) < found[0]


def test_a_line_between_sub_images_has_a_normal_of_about_unit_length() -> None:
    # A longer normal would make the gap seem larger than it is; none at all would stand between nothing.
    _, corners = seeded(spec_of(KINDS[0]))
    term = constraints.seen_gap_term(4)
    for length, allowed in [(1.0, True), (0.91, True), (0.89, False), (1.01, False)]:
        line = np.array([0.6 * length, 0.8 * length, 0.0])
        _, g = term_value(term, [corners[0], corners[3], line], [np.array([0.0])])
        assert (g[:2].min() >= -1e-12) == allowed


NAMES = ("mirror", "region", "view", "grid", "mean", "seen", "gap", "in", "out", "body gap", "body light")


def random_use(kind: Kind, name: str) -> tuple[Term, FloatArray, FloatArray]:
    """A term with unknowns and parameters at which nothing is special."""
    spec = spec_of(kind, 105.0)
    rng = np.random.default_rng(11)
    centres, corners = seeded(spec)
    optics, lens = np.array(optics_of(spec)), lens_of(spec)
    plane = np.array([0.5, -0.7, 0.3, 0.6])
    fold, box = fold_of(spec), spec.kept_free_in_rig_mm.ravel() / 80.0
    pair = [fold, centres[0], corners[0], centres[3], corners[3], plane]
    region = (constraints.region_directions() * [0.11, 0.08] + rng.normal(0.0, 0.01, (8, 2))).ravel()
    uses: dict[str, tuple[Term, list[FloatArray], list[FloatArray]]] = {
        "mirror": (
            constraints.mirror_term(kind),
            [fold, centres[1], corners[1]],
            [optics, *lens, np.array([0.1, 0.02, 4.0, 0.09, 0.7])],
        ),
        "region": (
            constraints.region_term(),
            [np.array([0.02, -0.03]), region],
            [np.array([0.2, 0.12])],
        ),
        "view": (
            constraints.view_term(kind),
            [fold, centres[2], corners[2], region],
            [optics, *lens, np.array([5.0, 0.09, 0.8, 0.01])],
        ),
        "grid": (constraints.grid_term(Arrangement(2, 2)), [centres.ravel()], [np.array([3.0])]),
        "mean": (constraints.mean_term(2), [fold, centres[:2].ravel()], []),
        "seen": (
            constraints.seen_gap_term(kind.sides),
            [corners[0], corners[3], np.array([0.5, -0.7, 0.3])],
            [np.array([0.02])],
        ),
        "gap": (constraints.gap_term(kind), pair, [optics, np.array([0.02])]),
        "in": (constraints.incoming_term(kind), pair, [optics]),
        "out": (constraints.outgoing_term(kind), pair, [optics]),
        "body gap": (constraints.body_gap_term(kind), [fold, centres[1], corners[1], plane], [optics, box]),
        "body light": (constraints.body_light_term(kind), [fold, centres[1], corners[1], plane], [optics, box]),
    }
    term, unknowns, parameters = uses[name]
    return term, np.concatenate(unknowns), np.concatenate([np.zeros(0), *parameters])


def sparse(shape: tuple[int, int], rows: Indices, cols: Indices, values: Expression) -> FloatArray:
    matrix = np.zeros(shape)
    np.add.at(matrix, (rows, cols), np.array(values).ravel())
    return matrix


def central(function: Callable[[FloatArray], FloatArray], at: FloatArray, step: float = 1e-6) -> FloatArray:
    """Derivatives (m, n) of a function (n,) -> (m,) by central differences."""
    steps = step * np.eye(len(at))
    return np.array([(function(at + one) - function(at - one)) / (2.0 * step) for one in steps]).T


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("kind", KINDS)
def test_derivatives_of_terms_agree_with_differences(kind: Kind, name: str) -> None:
    term, x, p = random_use(kind, name)
    assert x.shape == (term.unknowns,)
    assert p.shape == (term.parameters,)
    rng = np.random.default_rng(2)
    multipliers, weight = rng.normal(0.0, 1.0, term.family.size), 0.6

    def gradient(at: FloatArray) -> FloatArray:
        return np.array(term.gradient(at, p)).ravel()

    def jacobian(at: FloatArray) -> FloatArray:
        return sparse((term.family.size, term.unknowns), term.rows, term.cols, term.jacobian(at, p))

    def objective(at: FloatArray) -> FloatArray:
        return np.array(term.value(at, p)[0]).ravel()

    def limits(at: FloatArray) -> FloatArray:
        return np.array(term.value(at, p)[1]).ravel()

    def close(found: FloatArray, expected: FloatArray) -> None:
        assert_allclose(found, expected, rtol=1e-6, atol=1e-7 * max(1.0, np.abs(expected).max()))

    close(gradient(x), central(objective, x)[0])
    close(jacobian(x), central(limits, x))
    upper = sparse((term.unknowns,) * 2, term.upper_rows, term.upper_cols, term.hessian(x, p, weight, multipliers))
    assert not np.tril(upper, -1).any()
    close(
        upper + np.triu(upper, 1).T,
        central(lambda at: weight * gradient(at) + jacobian(at).T @ multipliers, x),
    )
    # Differences that are all zero would agree with anything.
    assert np.abs(jacobian(x)).max() > 0.1
    assert np.abs(upper).max() > 0.1 or name == "region", "only that one is linear"


def test_a_mean_is_an_equality_and_the_rest_are_limits() -> None:
    kind = KINDS[0]
    for name in NAMES:
        assert random_use(kind, name)[0].equality == (name == "mean")


def test_each_elastic_family_has_its_terms() -> None:
    kind = Kind(4, False, True)
    families = {name: {ELASTIC[k] for k in random_use(kind, name)[0].family if k >= 0} for name in NAMES}
    assert families == {
        "mirror": {"size", "depth", "occlusion"},
        "region": set(),
        "view": {"overlap"},
        "grid": set(),
        "mean": set(),
        "seen": {"seen gap"},
        "gap": {"spacing"},
        "in": {"occlusion"},
        "out": {"occlusion"},
        "body gap": {"body"},
        "body light": {"body"},
    }


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
