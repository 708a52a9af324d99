"""The geometry of chains of mirrors: unfolded light, seeds, rays, and a small search."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest

from benchmarks.two_bounces import moved_px, row_of, shares, solved, tilted
from benchmarks.two_bounces_chains import Chain, Found, Question
from benchmarks.two_bounces_program import separator
from benchmarks.two_bounces_rays import traced
from benchmarks.two_bounces_seeds import cells_of, chain_through, ladder, star
from mirrorcam.core.values import FloatArray

BOX_MM = (131.0, 71.0, 69.0)
QUESTION = Question(1, 2, 2, 0.0, BOX_MM)
AWAY, IN_FRONT = np.array([3.0, 0.0, 0.0]), np.array([0.0, 0.0, 40.0])


@pytest.fixture(scope="module")
def found() -> Found:
    best = solved(QUESTION, 0)
    assert best is not None
    return best


def _periscope() -> Chain:
    """Two parallel mirrors at 45 degrees, 50 mm apart: 40 mm forwards, 50 mm to the right, then forwards."""
    places = np.array([[0.0, 0.0, 40.0], [50.0, 0.0, 40.0]])
    return chain_through(cells_of(Question(1, 2, 2, 0.0, BOX_MM), 0.5)[0] * 0.0, places, np.array([50.0, 0.0, 400.0]))


def test_a_periscope_moves_the_pupil_sideways_and_back_and_turns_nothing() -> None:
    chain = _periscope()
    np.testing.assert_allclose(chain.virtual_centre_in_rig_mm, [50.0, 0.0, -50.0], atol=1e-9)
    points = np.random.default_rng(0).uniform([-50.0, -50.0, 300.0], [50.0, 50.0, 500.0], (20, 3))
    from_centre = points - chain.virtual_centre_in_rig_mm
    np.testing.assert_allclose(chain.normalized(points), from_centre[:, :2] / from_centre[:, 2:], atol=1e-12)


@pytest.mark.parametrize("seed", [star, ladder])
def test_points_of_the_scene_appear_where_their_light_started(
    seed: Callable[[Question, float, float, float], list[Chain]],
) -> None:
    for chain in seed(Question(2, 2, 2, 0.0, BOX_MM), 30.0, 50.0, 0.6):
        pixels = chain.cell
        ends = chain.scene_from_unfolded(np.column_stack([pixels, np.ones(4)]) * 450.0)
        np.testing.assert_allclose(chain.normalized(ends), pixels, atol=1e-12)


def test_a_tilt_of_one_mirror_turns_the_view_by_twice_as_much() -> None:
    chain = _periscope()
    point = np.array([50.0, 0.0, 1e7])
    upright = np.array([0.0, 1.0, 0.0])
    for bounce in range(2):
        moved = tilted(dataclasses.replace(chain, outlines_mm=_places()), bounce, 1e-4 * upright)
        turned = moved.normalized(point) - chain.normalized(point)
        assert np.linalg.norm(turned) == pytest.approx(2e-4, rel=1e-3)


def _places() -> FloatArray:
    return np.repeat(np.array([[[0.0, 0.0, 40.0]], [[50.0, 0.0, 40.0]]]), 4, axis=1)


def test_the_separator_lies_in_the_middle_of_the_gap() -> None:
    cube = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float)
    normal, height = separator(cube, cube + AWAY)
    assert (cube @ normal).max() < height < ((cube + AWAY) @ normal).min()


def test_rays_find_what_the_program_says(found: Found) -> None:
    rays = traced(found, columns=64)
    assert rays.blocked < 0.01
    assert rays.usable.mean() == pytest.approx(shares(found).sum(), abs=0.02)


def test_rays_notice_a_mirror_in_the_way(found: Found) -> None:
    first, second = found.chains
    between = second.outlines_mm.copy()
    between[1] += first.outlines_mm[1].mean(axis=0) + IN_FRONT - between[1].mean(axis=0)
    blocked = dataclasses.replace(found, chains=(first, dataclasses.replace(second, outlines_mm=between)))
    assert traced(blocked, columns=64).blocked > 0.3


def test_arrangements_fit_the_box_and_aim_along_the_views(found: Found) -> None:
    corners = np.concatenate([chain.outlines_mm.reshape(-1, 3) for chain in found.chains])
    assert (np.ptp(corners, axis=0) <= np.array(BOX_MM) + 1e-4).all()
    centres = np.mean([chain.virtual_centre_in_rig_mm for chain in found.chains], axis=0)
    np.testing.assert_allclose(found.regions_mm.mean(axis=1)[:, :2], np.tile(centres[:2], (2, 1)), atol=1e-3)


def test_two_mirrors_see_more_than_one_at_equal_size(found: Found) -> None:
    single = solved(Question(1, 2, 1, 90.0, BOX_MM), 0)
    assert single is not None
    assert row_of(found).resolution_mm > 1.2 * row_of(single).resolution_mm
    assert moved_px(found) > moved_px(single)
