"""The whole device as plain numbers: a plan for every part of a layout, refused here where it cannot be made."""

from __future__ import annotations

from dataclasses import dataclass

from cad.hardware import Hardware
from cad.holder.plan import HolderPlan, plan_holder
from optics.layout import Layout


@dataclass(frozen=True)
class Device:
    """The plans of all printed parts of a layout."""

    layout: Layout
    hardware: Hardware
    holder: HolderPlan


def plan_device(layout: Layout, hardware: Hardware) -> Device:
    """Plan every part; raises InputError with the measure that breaks where the device cannot be made."""
    return Device(layout=layout, hardware=hardware, holder=plan_holder(layout, hardware))
