"""The one place that knows all kinds of backs: which module plans which table of dimensions."""

from __future__ import annotations

from typing import Any

from mirrorcam.cad.backs.arca import plan_arca
from mirrorcam.cad.backs.back import Back
from mirrorcam.cad.backs.desk import plan_desk
from mirrorcam.cad.backs.flange import plan_gen3, plan_iso9409
from mirrorcam.cad.backs.kinova_gen2 import plan_gen2
from mirrorcam.cad.backs.load import carried
from mirrorcam.cad.backs.monitor import plan_monitor
from mirrorcam.cad.backs.profile import plan_profile
from mirrorcam.cad.backs.tripod import plan_tripod
from mirrorcam.cad.backs.vesa import plan_vesa
from mirrorcam.cad.parts.clip import ClipPlan
from mirrorcam.cad.parts.mount import MountPlan
from mirrorcam.cad.plan.hardware import Hardware

PLANNERS: dict[str, Any] = {
    "none": plan_desk,
    "tripod": plan_tripod,
    "arca": plan_arca,
    "iso9409": plan_iso9409,
    "gen3": plan_gen3,
    "gen2": plan_gen2,
    "profile20": plan_profile,
    "vesa": plan_vesa,
    "monitor": plan_monitor,
}


def plan_back(clip: ClipPlan, mount: MountPlan, hardware: Hardware) -> Back:
    """Plan the back that the hardware names, under a mount and for all that stands on it.

    Raises InputError with the measure that breaks where it cannot be made.
    """
    table = hardware.back
    return PLANNERS[table.kind](table, mount, carried(mount, clip, hardware), hardware)
