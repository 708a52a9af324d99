"""The one place that knows all kinds of backs: which module plans which table of dimensions."""

from __future__ import annotations

from typing import Any

from mirrorcam.cad.backs.back import Back
from mirrorcam.cad.backs.desk import plan_desk
from mirrorcam.cad.backs.kinova_gen2 import plan_gen2
from mirrorcam.cad.backs.load import carried
from mirrorcam.cad.parts.clip import ClipPlan
from mirrorcam.cad.parts.mount import MountPlan
from mirrorcam.cad.plan.hardware import Hardware

PLANNERS: dict[str, Any] = {"none": plan_desk, "gen2": plan_gen2}


def plan_back(clip: ClipPlan, mount: MountPlan, hardware: Hardware) -> Back:
    """Plan the back that the hardware names, under a mount and for all that stands on it.

    Raises InputError with the measure that breaks where it cannot be made.
    """
    table = hardware.back
    return PLANNERS[table.kind](table, clip, mount, carried(mount, clip, hardware), hardware)
