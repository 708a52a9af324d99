"""The faceted parabola to compare with: what it carries, and where there is none."""

from __future__ import annotations

import pytest

from mirrorcam.core.values import InputError
from mirrorcam.optics.design.assess.layout_metrics import evaluate
from mirrorcam.optics.design.assess.verify import verify
from mirrorcam.optics.design.parabola import assessed_parabola
from mirrorcam.optics.design.program.seeds import faceted_parabola
from mirrorcam.optics.geometry.design_spec import DesignSpec, InfeasibleDesign

SPEC = DesignSpec(rows=2, cols=3, depths_mm=(500.0, 300.0))


def test_it_is_the_seed_with_its_figures() -> None:
    bare, found = faceted_parabola(SPEC), assessed_parabola(SPEC)
    assert found.identity == bare.identity
    assert found.spec == SPEC
    assert found.metrics == evaluate(bare, SPEC.depths_mm)
    assert found.verdict == verify(bare, SPEC)


def test_a_verdict_that_fails_is_a_figure() -> None:
    found = assessed_parabola(SPEC.replaced(seen_gap_mm=5.0))
    assert not found.verdict["smallest_seen_gap_mm"].passed


def test_facets_that_do_not_fit_are_refused() -> None:
    with pytest.raises(InfeasibleDesign):
        assessed_parabola(DesignSpec(rows=7, cols=7, spacing_mm=40.0))


def test_a_depth_nearer_than_the_mirrors_is_refused() -> None:
    with pytest.raises(InputError, match="nearer than the mirrors"):
        assessed_parabola(SPEC.replaced(depths_mm=(20.0,), fold_deg=90.0))
