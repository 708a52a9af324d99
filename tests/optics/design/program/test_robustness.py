"""Margins against tolerances beside devices drawn at random, whose mirrors are moved exactly."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from numpy.testing import assert_allclose

from mirrorcam.optics.design.assess.as_built_views import BuiltViews, built_views
from mirrorcam.optics.design.program.robustness import SAFE_SIGMAS, displacements, safe_gap, tilts
from mirrorcam.optics.design.program.seeds import Seed, layout_of, mirrors_of, seed_of
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.perturbations import draw_perturbations
from mirrorcam.optics.geometry.tolerances import Tolerances

DEVICES = 1000
SPEC = DesignSpec(rows=2, cols=2, robust_tilt_deg=0.5, robust_offset_mm=0.2)


@pytest.fixture(scope="module")
def seed() -> Seed:
    return seed_of(SPEC, 375.0)


@pytest.fixture(scope="module")
def built(seed: Seed) -> BuiltViews:
    layout = layout_of(SPEC, mirrors_of(SPEC, seed.centres * SPEC.scale_mm, seed.corners), {})
    tolerances = Tolerances.none().replaced(tilt_deg=SPEC.robust_tilt_deg, offset_mm=SPEC.robust_offset_mm)
    return built_views(layout, draw_perturbations(tolerances, 4, DEVICES, np.random.default_rng(1)))


def test_corners_move_by_their_standard_deviation(seed: Seed, built: BuiltViews) -> None:
    corners = shapely.get_coordinates(built.outlines.ravel()).reshape(DEVICES, 4, 5, 2)[:, :, :4]
    # Outlines start at another corner than those of the seed; each is the nearest of them.
    away = np.linalg.norm(corners.mean(axis=0)[:, :, None] - seed.corners[:, None], axis=-1)
    expected = np.take_along_axis(displacements(SPEC, seed), away.argmin(axis=2)[..., None], axis=1)
    assert_allclose(corners.std(axis=0), np.abs(expected), rtol=0.1, atol=1e-4)


def test_a_design_without_tolerances_has_no_displacements(seed: Seed) -> None:
    exact = SPEC.replaced(robust_tilt_deg=0.0, robust_offset_mm=0.0)
    assert not displacements(exact, seed).any()
    assert safe_gap(displacements(exact, seed)[:2], np.array([1.0, 0.0])) == 0.0


def test_a_safe_gap_is_that_of_the_corner_that_moves_most() -> None:
    moved = np.zeros((2, 4, 2))
    moved[0, 2], moved[1, 1] = [-0.003, 9.0], [0.004, 9.0]
    assert safe_gap(moved, np.array([1.0, 0.0])) == pytest.approx(0.005 * SAFE_SIGMAS)


def test_tilts_start_with_the_design_and_come_in_opposite_pairs() -> None:
    drawn = tilts(SPEC, 40)
    assert drawn.shape == (41, 4, 2)
    assert not drawn[0].any()
    assert_allclose(drawn[1::2], -drawn[2::2])
    assert np.degrees(drawn[1:].std()) == pytest.approx(0.5, rel=0.15)
    assert (tilts(SPEC, 40) == drawn).all()
