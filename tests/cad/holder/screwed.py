"""A small layout with mirrors on carriers, for tests."""

from __future__ import annotations

from functools import cache

from mirrorcam.cad.holder.screwed_holder import ScrewedHolderPlan, plan_screwed_holder
from mirrorcam.cad.plan.hardware import HARDWARE, Hardware
from mirrorcam.optics.geometry.layout import Layout
from tests.cad.parabolas import parabola


def with_screws(kind: str = "insert") -> Hardware:
    """The default hardware with carriers, and inserts or nuts for their screws."""
    return HARDWARE.replaced(
        holder=HARDWARE.holder.replaced(mirrors="screws"), screw=HARDWARE.screw.replaced(kind=kind)
    )


def pair() -> Layout:
    """Two mirrors side by side."""
    return parabola(1, 2, scale_mm=60.0)


@cache
def planned(kind: str = "insert") -> ScrewedHolderPlan:
    """Its holder."""
    return plan_screwed_holder(pair(), with_screws(kind))
