"""Strip plan of rectangular mirrors: straight cuts from edge to edge, as a glass cutter or a guillotine makes them.

A strip along the sheet's longer side has the width of its mirrors' shorter sides; mirrors are then cut off it. A strip
holds mirrors of one width only, so that every cut runs from edge to edge.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

# Rounding of sides, so that mirrors of one width share a strip.
ROUNDING_MM = 1e-6


@dataclass(frozen=True)
class Strip:
    """A strip cut off sheet `sheet`, counted from 1: its width, and the names and lengths of the mirrors on it."""

    sheet: int
    width_mm: float
    pieces: tuple[tuple[str, float], ...]

    @property
    def length_mm(self) -> float:
        """Length of the strip that becomes mirrors."""
        return sum(length for _, length in self.pieces)


def strip_plan(sizes_mm: Mapping[str, tuple[float, float]], sheet_mm: tuple[float, float]) -> tuple[Strip, ...]:
    """Strips for mirrors given by names and (longer, shorter) sides, mm, the widest strips and longest mirrors first.

    Cuts take no width, as when glass is scored. Raises ValueError for a mirror larger than the sheet.
    """
    shorter_mm, longer_mm = sorted(sheet_mm)
    for name, (longer, shorter) in sizes_mm.items():
        if longer > longer_mm + ROUNDING_MM or shorter > shorter_mm + ROUNDING_MM:
            raise ValueError(f"mirror {name} of {longer:g} x {shorter:g} mm is larger than a sheet, but each must fit")
    runs: list[tuple[float, list[tuple[str, float]]]] = []
    ordered = sorted(sizes_mm.items(), key=lambda item: (-item[1][1], -item[1][0], item[0]))
    for name, (longer, shorter) in ordered:
        for width, pieces in runs:
            used = sum(length for _, length in pieces)
            if abs(width - shorter) < ROUNDING_MM and used + longer <= longer_mm + ROUNDING_MM:
                pieces.append((name, longer))
                break
        else:
            runs.append((shorter, [(name, longer)]))
    strips: list[Strip] = []
    used_mm: list[float] = []
    for width, pieces in runs:
        free = (k for k, used in enumerate(used_mm) if used + width <= shorter_mm + ROUNDING_MM)
        sheet = next(free, len(used_mm))
        if sheet == len(used_mm):
            used_mm.append(0.0)
        used_mm[sheet] += width
        strips.append(Strip(sheet + 1, width, tuple(pieces)))
    return tuple(sorted(strips, key=lambda strip: strip.sheet))
