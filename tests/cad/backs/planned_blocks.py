"""The plan of a back's part made of blocks."""

from __future__ import annotations

from mirrorcam.cad.assembly.device_plan import Device
from mirrorcam.cad.backs.back import Back, BackPart, carried_load
from mirrorcam.cad.backs.blocks import BlocksPlan
from mirrorcam.cad.backs.plan_backs import PLANNERS
from mirrorcam.cad.plan.back_table import AnyBack


def blocks_of(part: BackPart) -> BlocksPlan:
    """The plan of such a part."""
    assert isinstance(part.plan, BlocksPlan)
    return part.plan


def planned_back(device: Device, table: AnyBack) -> Back:
    """The back of a device's mount in the stand frame, by its table."""
    load = carried_load(device.mount, device.clip, device.hardware)
    back: Back = PLANNERS[table.kind](table, device.mount.foot, load, device.hardware)
    return back
