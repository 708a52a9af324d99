"""The functional dimensions of every kind of part, read from its plan."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from cad.documents.dimension import Dimensioned, Hole, Length
from cad.documents.holder_sheet import holder_holes
from cad.holder.plan import HolderPlan
from cad.parts.adapter import RingPlan
from cad.parts.fasteners import Bore
from cad.split import PiecePlan

# A wider hole on the axis of a narrow one is a way for the driver, not a fit.
WIDER = 1.5


def offered(plan: Any) -> tuple[Length | Hole, ...]:
    """The dimensions of a part's plan in rig; of a piece of a part that is split those of the whole."""
    if isinstance(plan, PiecePlan):
        return offered(plan.whole)
    if isinstance(plan, HolderPlan):
        return holder_holes(plan)
    if isinstance(plan, RingPlan):
        ends = np.array([(side * plan.radius_mm, plan.band_mm[1], plan.axis_z_mm) for side in (-1.0, 1.0)])
        return (Length(ends, "bore diameter"), *bored(plan.cuts))
    if isinstance(plan, Dimensioned):
        return plan.dimensions
    return bored(getattr(plan, "cuts", ()))


def bored(cuts: Iterable[Any]) -> tuple[Hole, ...]:
    """The holes and slots among what is cut from a part, without the driver's ways to their screws."""
    bores = [cut for cut in cuts if isinstance(cut, Bore)]
    return tuple(
        Hole(
            bore.mouth,
            bore.axis,
            round(2.0 * bore.radius_mm, 3),
            f"slot, {bore.travel_mm:g} from end to end" if bore.travel_mm else "",
        )
        for bore in bores
        if not any(bore.radius_mm > WIDER * other.radius_mm and _on_one_axis(bore, other) for other in bores)
    )


def _on_one_axis(first: Bore, second: Bore) -> bool:
    apart = second.mouth - first.mouth
    return float(np.linalg.norm(np.cross(apart, first.axis))) < 1e-3 and abs(float(first.axis @ second.axis)) > 0.999
