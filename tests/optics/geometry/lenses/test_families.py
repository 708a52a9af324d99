"""Families by name: each has its number of coefficients, named apart."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.optics.geometry.lenses.families import FAMILIES, LensName, lens_of


@pytest.mark.parametrize("name", FAMILIES)
def test_a_family_takes_as_many_numbers_as_it_names(name: LensName) -> None:
    names = lens_of(name, np.zeros(len(FAMILIES[name].NAMES))).names
    assert len(set(names)) == len(names)
    with pytest.raises(ValueError, match=rf"3 numbers of distortion, expected the {len(names)} of a {name} lens: k1, "):
        lens_of(name, np.zeros(3))
