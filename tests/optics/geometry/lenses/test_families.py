"""Lens families by name: each has its number of coefficients, with distinct names."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.optics.geometry.lenses.families import FIXED_SIZE_FAMILIES, LensName, lens_of
from mirrorcam.optics.geometry.lenses.spline import LensGrid


@pytest.mark.parametrize("name", FIXED_SIZE_FAMILIES)
def test_a_family_takes_as_many_numbers_as_it_names(name: LensName) -> None:
    names = lens_of(name, np.zeros(len(FIXED_SIZE_FAMILIES[name].NAMES))).names
    assert len(set(names)) == len(names)
    with pytest.raises(ValueError, match=rf"3 distortion coefficients, expected {len(names)} for a {name} lens: k1, "):
        lens_of(name, np.zeros(3))


def test_a_spline_has_a_grid_and_no_other_lens_has_one() -> None:
    grid = LensGrid(cols=5, rows=4, reach_x=0.5, reach_y=0.4)
    assert len(lens_of("spline", np.zeros(5 + 2 * 20), grid).names) == 45
    with pytest.raises(ValueError, match=r"9 distortion coefficients, expected 45 for a spline lens: k1, .* 2 x 20 of"):
        lens_of("spline", np.zeros(9), grid)
    with pytest.raises(ValueError, match="a spline lens without lens_grid"):
        lens_of("spline", np.zeros(5))
    with pytest.raises(ValueError, match="a rational lens with lens_grid"):
        lens_of("rational", np.zeros(8), grid)
