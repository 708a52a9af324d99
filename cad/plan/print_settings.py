"""The slicer settings of all parts: those of the figures of printing, and those that the assembly guide asks for."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class PrintSettings:
    """Nozzle, layers, number of perimeters (lines of a wall) and share of infill."""

    nozzle_mm: float = 0.4
    layer_mm: float = 0.2
    perimeters: int = 3
    infill_percent: int = 20


PRINT_SETTINGS = PrintSettings()
