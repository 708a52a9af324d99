"""Weights of sampling strategies, and masks of scalar variants."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.render_scenes.reference.interactions import has_flag, invert, power_heuristic
from mirrorcam.render_scenes.variant import SCALAR, use_variant


@pytest.mark.parametrize("variant", [None, SCALAR])
def test_the_weights_of_two_strategies_add_up_to_one(variant: str | None) -> None:
    use_variant(variant)
    import mitsuba as mi

    for own, other in ((1.0, 3.0), (0.2, 0.0), (5.0, 5.0)):
        weights = [power_heuristic(mi.Float(a), mi.Float(b)) for a, b in ((own, other), (other, own))]
        assert float(np.sum([np.array(weight) for weight in weights])) == pytest.approx(1.0)
    assert float(np.sum(np.array(power_heuristic(mi.Float(1.0), mi.Float(3.0))))) == pytest.approx(0.1)
    assert float(np.sum(np.array(power_heuristic(mi.Float(0.0), mi.Float(0.0))))) == 0.0


@pytest.mark.parametrize("variant", [None, SCALAR])
def test_masks_are_inverted_as_masks(variant: str | None) -> None:
    use_variant(variant)
    import mitsuba as mi

    assert not np.array(invert(mi.Bool(True))).any()
    assert np.array(invert(mi.Bool(False))).all()


def test_a_ray_that_meets_nothing_has_no_flag() -> None:
    use_variant(SCALAR)
    import mitsuba as mi

    assert not has_flag(None, mi.BSDFFlags.Smooth, mi.Bool(True))
