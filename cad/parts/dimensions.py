"""What the drawings of the parts say beside overall sizes: their holes, and distances that other parts depend on."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from cad.documents.dimension import Hole, Length
from cad.parts.fasteners import OUTSIDE_MM, Bore, Hexagon
from cad.seats import Frustum
from optics.values import FloatArray


def holes(cuts: Iterable[Frustum | Bore | Hexagon]) -> tuple[Hole, ...]:
    """Every round hole at its mouth; a slot says how long its way is."""
    return tuple(
        Hole(cut.mouth + OUTSIDE_MM * cut.axis, cut.axis, 2.0 * cut.radius_mm, slot_text(cut))
        for cut in cuts
        if isinstance(cut, Bore)
    )


def slot_text(bore: Bore) -> str:
    """What is said of a slot beside its width."""
    return f"slot, {bore.travel_mm:g} travel" if bore.travel_mm else ""


def length(start: FloatArray, end: FloatArray, text: str) -> Length:
    """The distance between two points (3,) in rig."""
    return Length(np.array([start, end]), text)
