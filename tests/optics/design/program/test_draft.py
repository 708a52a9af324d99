"""A program in the making: where its fold and mirrors are, and what all terms take, in scales."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from mirrorcam.core.bounds import FOLD_DEG
from mirrorcam.optics.design.program.draft import Draft
from mirrorcam.optics.design.program.seeds import seed_of
from mirrorcam.optics.design.program.terms import ELASTIC
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.design_spec import DesignSpec


def test_unknowns_start_as_the_mirrors_of_the_seed() -> None:
    spec = DesignSpec(rows=1, cols=3, sides=5, fold_deg=100.0)
    seed = seed_of(spec, 375.0)
    draft = Draft.begun(spec, seed)
    start = draft.program.start
    assert_allclose(np.degrees(start[draft.fold]), [100.0])
    assert_allclose(start[np.array(draft.centres)], seed.centres)
    assert_allclose([start[corners] for _, corners in draft.mirrors], seed.corners.reshape(3, 10))
    assert draft.program.size == len(ELASTIC) + 1 + 3 * (3 + 10)


@pytest.mark.parametrize(("asked", "least", "most"), [(100.0, 100.0, 100.0), ("auto", FOLD_DEG.least, FOLD_DEG.most)])
def test_a_fold_is_given_or_free_in_its_range(asked: float | str, least: float, most: float) -> None:
    spec = DesignSpec.model_validate({"rows": 1, "cols": 2, "fold_deg": asked})
    draft = Draft.begun(spec, seed_of(spec, 375.0))
    low, high = draft.program.bounds
    assert_allclose(np.degrees([*low[draft.fold], *high[draft.fold]]), [least, most])


def test_lengths_are_in_scales() -> None:
    camera = Camera.c920().replaced(aperture_mm=2.0, focus_mm=400.0)
    spec = DesignSpec(camera=camera, scale_mm=50.0, surface="second", thickness_mm=2.0)
    assert_allclose(Draft.begun(spec, seed_of(spec, 375.0)).optics, [0.04, 1.49, 0.02, 0.125])
