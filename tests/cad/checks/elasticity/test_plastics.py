"""The table of plastics: what any plastic obeys, and names that it has not."""

from __future__ import annotations

import pytest

from mirrorcam.cad.checks.elasticity.plastics import PLASTICS, STEEL_PER_K, plastic_named
from mirrorcam.cad.plan.hardware import HARDWARE
from mirrorcam.core.values import InputError


def test_plastics_are_softer_and_expand_more_than_metal() -> None:
    assert len({plastic.name for plastic in PLASTICS}) == len(PLASTICS) == 5
    for plastic in PLASTICS:
        assert 1000.0 < plastic.modulus_mpa < 10000.0
        assert 1.0 < plastic.density_g_per_cm3 < 1.5
        assert STEEL_PER_K < plastic.strain_per_k < 2e-4
        assert 0.1 < plastic.creep < 1.5
        assert plastic.source


def test_a_printers_plastic_keeps_its_own_modulus() -> None:
    printer = HARDWARE.printer
    found = plastic_named(printer.plastic, 2000.0, 1.2)
    assert (found.name, found.modulus_mpa, found.density_g_per_cm3) == ("PLA", 2000.0, 1.2)
    assert plastic_named("pla", printer.plastic_mpa, printer.plastic_g_per_cm3) == PLASTICS[0]
    with pytest.raises(InputError, match=r"printer\.plastic = wood: .* expected one of PLA, PETG"):
        plastic_named("wood", 2000.0, 1.2)
