"""The bending of the mount against textbook formulas.

Folded plates against beams and plates in closed form.
"""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.cad.plan.stiffness import POISSON, FoldedPlates, Section, beam_compliance
from mirrorcam.core.values import FloatArray

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
    turn, shift = beam_compliance(POST, TIP, SECTION)
    assert turn[0, 1] == pytest.approx(-(HEIGHT**2) / 2.0 / SECTION.bending_nmm2)
    assert shift[1, 1] == pytest.approx(HEIGHT**3 / 3.0 / SECTION.bending_nmm2 + HEIGHT / SECTION.shear_n)
    assert shift[0, 0] == pytest.approx(HEIGHT**3 / 3.0 / SECTION.lateral_bending_nmm2)
    np.testing.assert_allclose(shift[2], 0.0, atol=1e-12)


def test_an_eccentric_load_bends_a_post_by_its_moment_and_twists_it() -> None:
    arm = 50.0
    turn, shift = beam_compliance(POST, TIP + np.array([0.0, arm, 0.0]), SECTION)
    assert abs(turn[0, 2]) == pytest.approx(arm * HEIGHT / SECTION.bending_nmm2)
    assert shift[2, 2] == pytest.approx(arm**2 * HEIGHT / SECTION.bending_nmm2)
    assert abs(turn[2, 0]) == pytest.approx(arm * HEIGHT / SECTION.torsion_nmm2)


def test_work_is_the_same_whichever_force_comes_first() -> None:
    path = np.array([[0.0, 0.0], [-3.0, 60.0], [40.0, 100.0]])
    _, shift = beam_compliance(path, np.array([5.0, 20.0, 90.0]), SECTION)
    np.testing.assert_allclose(shift, shift.T, atol=1e-15)
    assert np.linalg.eigvalsh(shift).min() > 0.0


def test_pieces_of_a_path_add_up() -> None:
    halves = np.array([[0.0, 0.0], [0.0, 30.0], [0.0, HEIGHT]])
    for whole, parted in zip(beam_compliance(POST, TIP, SECTION), beam_compliance(halves, TIP, SECTION), strict=True):
        np.testing.assert_allclose(parted, whole, rtol=1e-12, atol=1e-18)


def test_twist_lies_between_loose_skins_and_a_closed_box() -> None:
    """With a core rigid in shear, the skins act as the long sides of a closed box, G J = 2 G t h^2 b."""
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


MODULUS, WIDTH, LENGTH, THICK = 2300.0, 20.0, 200.0, 2.0
AREA, FLAT, ON_EDGE = WIDTH * THICK, WIDTH * THICK**3 / 12.0, THICK * WIDTH**3 / 12.0


def strip(*, pieces: int = 4, poisson: float = 0.0, along: tuple[float, float] = (0.0, 1.0)) -> FoldedPlates:
    """A strip from the origin in a direction of y and z."""
    edges = np.linspace(0.0, LENGTH, pieces + 1)[:, None] * np.array(along)
    return FoldedPlates(
        edges=edges,
        strips=np.column_stack([np.arange(pieces), np.arange(1, pieces + 1)]),
        thickness_mm=np.full(pieces, THICK),
        modulus_mpa=np.full(pieces, MODULUS),
        poisson=poisson,
        half_width_mm=WIDTH / 2.0,
    )


def cantilever(plates: FoldedPlates) -> FloatArray:
    """Compliance of its end, with a rigid edge there and a fixed edge at the other end."""
    xs = np.linspace(-0.9, 0.9, 5) * WIDTH / 2.0
    first, last = np.zeros(5, dtype=int), np.full(5, len(plates.edges) - 1)
    return plates.compliance(supports=(first, xs), attachments=(last, xs), load=np.array([0.0, *plates.edges[-1]]))


def test_a_strip_is_a_cantilever_in_bending_tension_and_shear() -> None:
    end = cantilever(strip())
    bending = MODULUS * FLAT
    # Along y, across the plate: it bends about x.
    assert end[1, 1] == pytest.approx(LENGTH**3 / 3.0 / bending, rel=1e-3)
    assert end[3, 1] == pytest.approx(-(LENGTH**2) / 2.0 / bending, rel=1e-3)
    assert end[3, 3] == pytest.approx(LENGTH / bending, rel=1e-3)
    assert end[2, 2] == pytest.approx(LENGTH / MODULUS / AREA, rel=1e-3)
    # Along x it bends on edge; Timoshenko's shear area is 5/6 of the section.
    shear = MODULUS / 2.0
    expected = LENGTH**3 / 3.0 / (MODULUS * ON_EDGE) + LENGTH / (5.0 / 6.0 * shear * AREA)
    assert end[0, 0] == pytest.approx(expected, rel=0.01)
    assert end[4, 4] == pytest.approx(LENGTH / (MODULUS * ON_EDGE), rel=0.01)


def test_a_narrow_strip_twists_by_saint_venants_formula() -> None:
    end = cantilever(strip(pieces=8))
    thin = 1.0 - 0.63 * THICK / WIDTH
    # Its ends do not warp, which makes it slightly stiffer.
    assert end[5, 5] == pytest.approx(LENGTH / (MODULUS / 2.0 * WIDTH * THICK**3 / 3.0), rel=0.08)
    assert end[5, 5] < LENGTH / (MODULUS / 2.0 * WIDTH * THICK**3 / 3.0 * thin)


def test_a_wide_plate_bends_as_a_plate() -> None:
    """Without anticlastic bending of its edges, stiffer by 1 / (1 - poisson^2)."""
    wide = strip(pieces=1, poisson=0.35)
    end = cantilever(wide)
    assert end[3, 3] < LENGTH / (MODULUS * FLAT)
    assert end[3, 3] > LENGTH * (1.0 - 0.35**2) / (MODULUS * FLAT)


def test_compliance_rotates_with_the_structure() -> None:
    upright, lying = cantilever(strip(poisson=0.3)), cantilever(strip(poisson=0.3, along=(0.6, 0.8)))
    turn = np.array([[1.0, 0.0, 0.0], [0.0, 0.8, 0.6], [0.0, -0.6, 0.8]])
    both = np.kron(np.eye(2), turn)
    np.testing.assert_allclose(lying, both @ upright @ both.T, atol=1e-6 * np.abs(upright).max())


def test_two_strips_at_a_right_angle_each_bend_as_a_beam() -> None:
    """A portal's leg and arm: the arm's end sinks by its own bending and by the rotation of the leg."""
    edges = np.array([[0.0, 0.0], [0.0, 100.0], [50.0, 100.0]])
    frame = FoldedPlates(edges, np.array([[0, 1], [1, 2]]), np.full(2, THICK), np.full(2, MODULUS), 0.0, WIDTH / 2.0)
    end = cantilever(frame)
    expected = (50.0**3 / 3.0 + 50.0**2 * 100.0) / (MODULUS * FLAT) + 100.0 / (MODULUS * AREA)
    assert end[2, 2] == pytest.approx(expected, rel=2e-3)


def test_a_strip_of_half_the_modulus_is_twice_as_compliant() -> None:
    whole = strip()
    soft = FoldedPlates(whole.edges, whole.strips, whole.thickness_mm, whole.modulus_mpa / 2.0, 0.0, WIDTH / 2.0)
    np.testing.assert_allclose(cantilever(soft), 2.0 * cantilever(whole), rtol=1e-6, atol=1e-12)
