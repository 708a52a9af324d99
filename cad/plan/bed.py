"""The printer's bed: whether a part fits it, and how far the cuts of a larger part may be moved."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mirrorcam.cad.plan.hardware import Hardware
from mirrorcam.cad.plan.part_plan import PartPlan
from mirrorcam.core.values import InputError

# How far a cut may be moved off the place that was asked for (see `plan.cuts.off_corners`).
MOVED_MM = 0.09


def bed_lengths_mm(lengths_mm: tuple[float, float], hardware: Hardware) -> tuple[float, float]:
    """Length of the bed along a part's x and y: the part's longer side lies along the bed's longer side."""
    short, long = sorted(hardware.printer.bed_mm[:2])
    return (long, short) if lengths_mm[0] >= lengths_mm[1] else (short, long)


def turned_onto_bed(part: PartPlan, length_mm: float, bed_mm: float, hardware: Hardware) -> PartPlan:
    """The part, turned by a quarter where its length along x fits the bed only that way."""
    if bed_mm == hardware.printer.bed_mm[0] or length_mm <= hardware.printer.bed_mm[0]:
        return part
    quarter = np.array([[0.0, -1.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
    return replace(part, print_from_rig=quarter @ part.print_from_rig)


def require_height(name: str, height_mm: float, hardware: Hardware) -> None:
    """Raise InputError where a part is higher than the printer: cuts are upright and make no piece lower."""
    if height_mm > hardware.printer.bed_mm[2]:
        raise InputError(
            f"{name} is {height_mm:.1f} mm high, expected at most {hardware.printer.bed_mm[2]:g} mm (printer bed)"
        )


def cut_slack_mm(length_mm: float, count: int, bed_mm: float) -> float:
    """Largest shift of each cut into `count` equal pieces, by itself, at which all pieces still fit the bed."""
    spare = max(0.0, bed_mm - length_mm / count - MOVED_MM)
    return spare if count == 2 else spare / 2.0
