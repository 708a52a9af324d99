"""What a part weighs, against closed forms, and writers that fail."""

from __future__ import annotations

import numpy as np
import pytest
from build123d import Box, Location

from cad.exports import mass_properties
from cad.part import BuiltPart, PartPlan


def test_a_box_weighs_what_the_formula_says(block: PartPlan, built_block: BuiltPart) -> None:
    width, length, height = 60.0, 30.0, 10.0
    mass = width * length * height * 1.24e-3
    found = built_block.mass
    assert found.volume_mm3 == pytest.approx(width * length * height, rel=1e-12)
    assert found.mass_g == pytest.approx(mass, rel=1e-12)
    np.testing.assert_allclose(found.centre_in_rig_mm, [31.0, 17.0, 8.0], atol=1e-9)
    expected = mass / 12.0 * np.diag([length**2 + height**2, width**2 + height**2, width**2 + length**2])
    np.testing.assert_allclose(found.inertia_g_mm2, expected, rtol=1e-9, atol=1e-6)


def test_inertia_is_about_the_centre_of_mass_and_turns_with_the_part() -> None:
    turned = mass_properties(Location((500.0, -40.0, 7.0), (0.0, 0.0, 30.0)) * Box(60.0, 30.0, 10.0), 2.0)
    upright = mass_properties(Box(60.0, 30.0, 10.0), 2.0)
    cosine, sine = np.cos(np.radians(30.0)), np.sin(np.radians(30.0))
    turn = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
    np.testing.assert_allclose(turned.inertia_g_mm2, turn @ upright.inertia_g_mm2 @ turn.T, rtol=1e-6, atol=1e-3)
    np.testing.assert_allclose(turned.centre_in_rig_mm, [500.0, -40.0, 7.0], atol=1e-9)
