"""Constraints on neighbours of a grid, and the planes that start between two mirrors of a seed."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.optics.design.program.draft import Draft
from mirrorcam.optics.design.program.seeds import mirrors_of, seed_of
from mirrorcam.optics.design.program.separated_pairs import PairConstraint, add_body, add_pairs, neighbour_pairs
from mirrorcam.optics.geometry.arrangement import Arrangement
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.design_spec import DesignSpec

SPEC = DesignSpec(rows=2, cols=2)


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
    draft = Draft.begun(SPEC, seed)
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
        draft = Draft.begun(spec, seed_of(spec, 375.0))
        before = draft.program.size
        add_body(draft)
        sizes.append(draft.program.size - before)
    # A plane (4) for each mirror and one for its light.
    assert sizes == [4 * 2 * 4, 0]
