"""The bending of the mount against textbook formulas."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.cad.plan.beam import POISSON, Section, bends_per_newton

SECTION = Section(depth_mm=24.0, width_mm=80.0, skin_mm=2.4, web_mm=1.4, web_deg=45.0, plastic_mpa=2300.0)
HEIGHT = 120.0
POST = np.array([[0.0, 0.0], [0.0, HEIGHT]])
TIP = np.array([0.0, 0.0, HEIGHT])


def test_the_section_by_parallel_axes() -> None:
    apart = SECTION.depth_mm - SECTION.skin_mm
    skin = SECTION.width_mm * SECTION.skin_mm
    expected = 2.0 * (skin * (apart / 2.0) ** 2 + SECTION.width_mm * SECTION.skin_mm**3 / 12.0)
    assert SECTION.bending_nmm2 == pytest.approx(SECTION.plastic_mpa * expected)


def test_a_post_bends_as_a_cantilever() -> None:
    turn, shift = bends_per_newton(POST, TIP, SECTION)
    assert turn[0, 1] == pytest.approx(-(HEIGHT**2) / 2.0 / SECTION.bending_nmm2)
    assert shift[1, 1] == pytest.approx(HEIGHT**3 / 3.0 / SECTION.bending_nmm2 + HEIGHT / SECTION.shear_n)
    assert shift[0, 0] == pytest.approx(HEIGHT**3 / 3.0 / SECTION.sideways_nmm2)
    np.testing.assert_allclose(shift[2], 0.0, atol=1e-12)


def test_a_load_beside_a_post_bends_it_by_its_moment_and_twists_it() -> None:
    arm = 50.0
    turn, shift = bends_per_newton(POST, TIP + np.array([0.0, arm, 0.0]), SECTION)
    assert abs(turn[0, 2]) == pytest.approx(arm * HEIGHT / SECTION.bending_nmm2)
    assert shift[2, 2] == pytest.approx(arm**2 * HEIGHT / SECTION.bending_nmm2)
    assert abs(turn[2, 0]) == pytest.approx(arm * HEIGHT / SECTION.torsion_nmm2)


def test_work_is_the_same_whichever_force_comes_first() -> None:
    path = np.array([[0.0, 0.0], [-3.0, 60.0], [40.0, 100.0]])
    _, shift = bends_per_newton(path, np.array([5.0, 20.0, 90.0]), SECTION)
    np.testing.assert_allclose(shift, shift.T, atol=1e-15)
    assert np.linalg.eigvalsh(shift).min() > 0.0


def test_pieces_of_a_path_add_up() -> None:
    halves = np.array([[0.0, 0.0], [0.0, 30.0], [0.0, HEIGHT]])
    for whole, parted in zip(bends_per_newton(POST, TIP, SECTION), bends_per_newton(halves, TIP, SECTION), strict=True):
        np.testing.assert_allclose(parted, whole, rtol=1e-12, atol=1e-18)


def test_twist_lies_between_loose_skins_and_a_closed_box() -> None:
    """With a core that cannot shear the skins act as the long sides of a closed box, G J = 2 G t h^2 b."""
    shear = SECTION.plastic_mpa / (2.0 * (1.0 + POISSON))
    apart = SECTION.depth_mm - SECTION.skin_mm
    box = 2.0 * shear * SECTION.skin_mm * apart**2 * SECTION.width_mm
    assert 0.0 < SECTION.torsion_nmm2 < box
    stiff = Section(24.0, 80.0, 2.4, 1e6, 45.0, 2300.0)
    assert stiff.torsion_nmm2 == pytest.approx(box, rel=0.01)
    # A soft core: k b / 2 = x is small and 1 - tanh(x) / x is x^2 / 3.
    soft = Section(24.0, 80.0, 2.4, 1e-4, 45.0, 2300.0)
    half = np.sqrt(2.0 * soft.shear_n / (80.0 * apart) / (shear * 2.4 * apart)) * 40.0
    assert soft.torsion_nmm2 == pytest.approx(box * half**2 / 3.0, rel=1e-3)
