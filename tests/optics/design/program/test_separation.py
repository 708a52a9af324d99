"""Terms that separate mirrors, against the distances of their outlines."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose
from shapely import Polygon
from shapely.ops import nearest_points

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.design.program import constraints, separation
from mirrorcam.optics.design.program.draft import Draft
from mirrorcam.optics.design.program.mirror_variables import Kind
from mirrorcam.optics.design.program.seeds import mirrors_of, seed_of
from mirrorcam.optics.design.program.separation import PairConstraint, add_body, add_pairs, neighbour_pairs
from mirrorcam.optics.design.program.terms import ELASTIC, Term
from mirrorcam.optics.geometry.arrangement import Arrangement
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.design_spec import DesignSpec
from tests.optics.design.program.seeded_mirrors import (
    KINDS,
    seeded,
    spec_of,
)

SPEC = DesignSpec(rows=2, cols=2)


def term_value(term: Term, unknowns: list[FloatArray], parameters: list[FloatArray]) -> tuple[float, FloatArray]:
    f, g = term.value(np.concatenate(unknowns), np.concatenate(parameters))
    return float(f), np.array(g).ravel()


@pytest.mark.parametrize(("first", "second"), [(0, 1), (1, 2), (2, 0)])
@pytest.mark.parametrize("sides", [4, 5, 6])
def test_a_seen_gap_term_measures_how_far_sub_images_are_apart(sides: int, first: int, second: int) -> None:
    _, corners = seeded(spec_of(Kind(sides, False, False)))
    outlines = [corners[k].reshape(-1, 2) for k in (first, second)]
    bodies = [Polygon(outline) for outline in outlines]
    a, b = (np.array(point.coords[0]) for point in nearest_points(*bodies))
    term, gap = separation.sub_image_gap_term(sides), 0.003
    found = []
    for turn in np.radians([0.0, -3.0, 3.0, 30.0, 180.0]):
        cos, sin = np.cos(turn), np.sin(turn)
        normal = np.array([[cos, -sin], [sin, cos]]) @ (b - a) / np.linalg.norm(b - a)
        line = np.array([*normal, -(outlines[0] @ normal).max()])
        _, g = term_value(term, [*(outline.ravel() for outline in outlines), line], [np.array([gap])])
        apart = term.family == ELASTIC.index("seen gap")
        # For a line with a unit normal that touches the first: the distances to the second's corners minus the gap.
        assert g[~apart].min() == pytest.approx(0.0, abs=1e-12)
        assert_allclose(np.sort(g[apart]), np.sort(outlines[1] @ normal + line[2] - gap - constraints.MARGIN))
        found.append(float(g[apart].min()))
    assert found[0] == pytest.approx(bodies[0].distance(bodies[1]) - gap - constraints.MARGIN, abs=1e-12)
    assert max(found[1:]) < found[0]


def test_a_line_between_sub_images_has_a_normal_of_about_unit_length() -> None:
    # A longer normal would exaggerate the gap; a zero normal would separate nothing.
    _, corners = seeded(spec_of(KINDS[0]))
    term = separation.sub_image_gap_term(4)
    for length, allowed in [(1.0, True), (0.91, True), (0.89, False), (1.01, False)]:
        line = np.array([0.6 * length, 0.8 * length, 0.0])
        _, g = term_value(term, [corners[0], corners[3], line], [np.array([0.0])])
        assert (g[:2].min() >= -1e-12) == allowed


def test_neighbours_keep_gaps_and_light_and_diagonals_less() -> None:
    pairs = neighbour_pairs(Arrangement(2, 3))
    expected = [(0, 1), (0, 3), (0, 4), (1, 2), (1, 3), (1, 4), (1, 5), (2, 4), (2, 5), (3, 4), (4, 5)]
    assert [(pair.first, pair.second) for pair in pairs if pair.kind == "gap"] == expected
    diagonal = {(0, 4), (1, 3), (1, 5), (2, 4)}
    both = {pair for first, second in expected for pair in ((first, second), (second, first))}
    assert {(pair.first, pair.second) for pair in pairs if pair.kind == "in"} == both
    straight = {(i, j) for i, j in both if (min(i, j), max(i, j)) not in diagonal}
    assert {(pair.first, pair.second) for pair in pairs if pair.kind == "out"} == straight
    assert len(set(pairs)) == len(pairs)


@pytest.mark.parametrize(("first", "second"), [(0, 1), (0, 2), (1, 3)])
def test_a_plane_between_mirrors_starts_between_them(first: int, second: int) -> None:
    seed = seed_of(SPEC, 375.0)
    draft = Draft.of(SPEC, seed)
    before = draft.program.size
    add_pairs(draft, (PairConstraint("gap", first, second),))
    *normal, offset = draft.program.start[before:]
    assert np.linalg.norm(normal) == pytest.approx(1.0)
    mirrors = mirrors_of(SPEC, seed.centres * SPEC.scale_mm, seed.corners)
    below, above = (mirrors[k].outline_in_rig_mm.mean(axis=0) @ SPEC.view_from_rig.T for k in (first, second))
    assert below @ normal < offset * SPEC.scale_mm < above @ normal


def test_a_camera_without_a_known_body_has_no_constraints_on_it() -> None:
    unknown = SPEC.replaced(camera=Camera.c920().replaced(body_mm=None))
    sizes = []
    for spec in (SPEC, unknown):
        draft = Draft.of(spec, seed_of(spec, 375.0))
        before = draft.program.size
        add_body(draft)
        sizes.append(draft.program.size - before)
    # A plane (4) for each mirror and one for its light.
    assert sizes == [4 * 2 * 4, 0]
