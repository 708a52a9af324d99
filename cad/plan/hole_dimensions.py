"""Dimensions of parts beside their overall sizes: holes, and distances that other parts depend on."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from mirrorcam.cad.plan.dimension import Hole, Length
from mirrorcam.cad.plan.fasteners import OUTSIDE_MM, Bore, Countersink, Hexagon
from mirrorcam.core.values import FloatArray


def holes(cuts: Iterable[Any]) -> tuple[Hole, ...]:
    """All holes among the cuts of a part, at their mouths: bores, slots, countersinks, and pockets for nuts."""
    return tuple(_hole(cut) for cut in cuts if isinstance(cut, Bore | Countersink | Hexagon))


def _hole(cut: Bore | Countersink | Hexagon) -> Hole:
    mouth, deep = cut.mouth + OUTSIDE_MM * cut.axis, cut.depth_mm - OUTSIDE_MM
    if isinstance(cut, Countersink):
        slope = (cut.radius_mm - cut.end_radius_mm) / cut.depth_mm
        widest = cut.radius_mm - OUTSIDE_MM * slope
        angle = 2.0 * np.degrees(np.arctan(slope))
        text = f"x {angle:.0f}°"
        return Hole(mouth, cut.axis, round(2.0 * widest, 3), text, deep, "countersink", cut.travel_mm)
    if isinstance(cut, Hexagon):
        return Hole(cut.mouth, cut.axis, round(cut.flats_mm, 3), "", cut.depth_mm, "hexagon")
    return Hole(mouth, cut.axis, round(2.0 * cut.radius_mm, 3), "", deep, travel_mm=cut.travel_mm)


def length(
    start: FloatArray, end: FloatArray, text: str = "", way: FloatArray | None = None, before: str = ""
) -> Length:
    """The distance between two points (3,) in rig, or its part along a direction (3,)."""
    return Length(np.array([start, end]), text, way, before)
