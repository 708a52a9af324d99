"""The slicer settings that guide and slicer share."""

from __future__ import annotations

from mirrorcam.cad.plan.hardware import HARDWARE
from mirrorcam.cad.plan.print_settings import PRINT_SETTINGS


def test_the_perimeters_print_the_thinnest_wall() -> None:
    assert PRINT_SETTINGS.perimeters * PRINT_SETTINGS.nozzle_mm <= HARDWARE.printer.wall_mm + 1e-9
    assert PRINT_SETTINGS.layer_mm < PRINT_SETTINGS.nozzle_mm
    assert 0 < PRINT_SETTINGS.infill_percent < 100
