"""Dimensions of parts beside their overall sizes: holes, and distances that other parts depend on."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from mirrorcam.cad.plan.dimension import Hole, Length
from mirrorcam.cad.plan.fasteners import OUTSIDE_MM, Bore
from mirrorcam.optics.base.values import FloatArray

# A wider hole on the axis of a narrow one is an access hole for the driver, not a fit.
WIDER = 1.5


def holes(cuts: Iterable[Any]) -> tuple[Hole, ...]:
    """Round holes among the cuts of a part, at their mouths, without access holes; a slot with its travel."""
    bores = [cut for cut in cuts if isinstance(cut, Bore)]
    return tuple(
        Hole(bore.mouth + OUTSIDE_MM * bore.axis, bore.axis, round(2.0 * bore.radius_mm, 3), slot_text(bore))
        for bore in bores
        if not any(bore.radius_mm > WIDER * other.radius_mm and _on_one_axis(bore, other) for other in bores)
    )


def slot_text(bore: Bore) -> str:
    """The text of a slot beside its width."""
    return f"slot, {bore.travel_mm:g} travel" if bore.travel_mm else ""


def length(start: FloatArray, end: FloatArray, text: str = "", way: FloatArray | None = None) -> Length:
    """The distance between two points (3,) in rig, or its part along a direction (3,)."""
    return Length(np.array([start, end]), text, way)


def _on_one_axis(first: Bore, second: Bore) -> bool:
    apart = second.mouth - first.mouth
    return float(np.linalg.norm(np.cross(apart, first.axis))) < 1e-3 and abs(float(first.axis @ second.axis)) > 0.999
