"""A program under construction: indices of fold and mirrors, and common parameters, in units of the design scale."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from numpy.testing import assert_allclose

from mirrorcam.core.bounds import FOLD_DEG
from mirrorcam.optics.design.assess.as_built_views import BuiltViews, built_views
from mirrorcam.optics.design.program.draft import SAFE_SIGMAS, Draft, displacements, safe_gap, tilts
from mirrorcam.optics.design.program.seeds import Seed, layout_of, mirrors_of, seed_of
from mirrorcam.optics.design.program.terms import ELASTIC
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.perturbations import draw_perturbations
from mirrorcam.optics.geometry.tolerances import Tolerances

DEVICES = 1000
SPEC = DesignSpec(rows=2, cols=2, robust_tilt_deg=0.5, robust_offset_mm=0.2)


def test_unknowns_start_as_the_mirrors_of_the_seed() -> None:
    spec = DesignSpec(rows=1, cols=3, sides=5, fold_deg=100.0)
    seed = seed_of(spec, 375.0)
    draft = Draft.of(spec, seed)
    start = draft.program.start
    assert_allclose(np.degrees(start[draft.fold]), [100.0])
    assert_allclose(start[np.array(draft.centres)], seed.centres)
    assert_allclose([start[corners] for _, corners in draft.mirrors], seed.corners.reshape(3, 10))
    assert draft.program.size == len(ELASTIC) + 1 + 3 * (3 + 10)


@pytest.mark.parametrize(
    ("fold_deg", "min_deg", "max_deg"), [(100.0, 100.0, 100.0), ("auto", FOLD_DEG.min, FOLD_DEG.max)]
)
def test_a_fold_is_given_or_free_in_its_range(fold_deg: float | str, min_deg: float, max_deg: float) -> None:
    spec = DesignSpec.model_validate({"rows": 1, "cols": 2, "fold_deg": fold_deg})
    draft = Draft.of(spec, seed_of(spec, 375.0))
    low, high = draft.program.bounds
    assert_allclose(np.degrees([*low[draft.fold], *high[draft.fold]]), [min_deg, max_deg])


def test_lengths_are_in_units_of_the_scale() -> None:
    camera = Camera.c920().replaced(aperture_mm=2.0, focus_mm=400.0)
    spec = DesignSpec(camera=camera, scale_mm=50.0, surface="second", thickness_mm=2.0)
    assert_allclose(Draft.of(spec, seed_of(spec, 375.0)).optics, [0.04, 1.52, 0.02, 0.125])


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
    # Outlines may start at another corner than the seed's: compare nearest corners.
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
