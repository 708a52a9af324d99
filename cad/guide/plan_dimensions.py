"""The functional dimensions of every kind of part, read from its plan."""

from __future__ import annotations

from typing import Any

from mirrorcam.cad.guide.holder_drawing import holder_holes
from mirrorcam.cad.holder.holder_body import HolderPlan
from mirrorcam.cad.holder.screwed_holder import ScrewedHolderPlan
from mirrorcam.cad.plan.cuts import PiecePlan
from mirrorcam.cad.plan.dimension import Dimensioned, Hole, Length


def offered(plan: Any) -> tuple[Length | Hole, ...]:
    """The dimensions of a part's plan in rig; of a piece of a part that is split those of the whole."""
    if isinstance(plan, PiecePlan):
        return offered(plan.whole)
    if isinstance(plan, HolderPlan):
        return (*holder_holes(plan), *(plan.screw_holes if isinstance(plan, ScrewedHolderPlan) else ()))
    return plan.dimensions if isinstance(plan, Dimensioned) else ()
