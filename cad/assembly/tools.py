"""The tools that building a device takes, and what else is needed: one table for the guide and the parts list."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from mirrorcam.cad.assembly.device_plan import Device
from mirrorcam.cad.assembly.pieces import item_title, standard_of
from mirrorcam.cad.holder.screwed_holder import ScrewedHolderPlan
from mirrorcam.cad.plan.fasteners import diameter_mm
from mirrorcam.cad.plan.part_plan import BoughtItem

# Across flats of the hexagon socket, mm, by the thread's diameter: ISO 4762, table 1, and ISO 10642, table 1.
SOCKETS_MM = {
    "ISO 4762": {2.0: 1.5, 3.0: 2.5, 4.0: 3.0, 5.0: 4.0, 6.0: 5.0},
    "ISO 10642": {3.0: 2.0, 4.0: 2.5, 5.0: 3.0, 6.0: 4.0},
}


@dataclass(frozen=True)
class Tool:
    """Something that is used but does not stay in the device: its name, and what it is for."""

    name: str
    purpose: str


def tools_of(device: Device, items: Sequence[BoughtItem]) -> tuple[Tool, ...]:
    """All hand tools that a device of these bought items takes, in the order of the guide's steps; no machines."""
    glass = device.hardware.cutting.material == "glass"
    found = [
        Tool("calipers", "to measure camera, mirrors and board"),
        Tool("kitchen scale", "to weigh the camera"),
        Tool("steel ruler", "to find the entrance pupil; to cut along"),
        Tool("blade", "to clean pads and seats"),
    ]
    if glass:
        found += [
            Tool("goggles and cut-resistant gloves", "to break glass"),
            Tool("paint marker", "to name the mirrors"),
        ]
    if any(item.kind == "insert" for item in items):
        found.append(Tool("soldering iron with a tip for M3 inserts", "at about 220 °C in PLA"))
    if any((item.kind, item.size) == ("nut", "M3") for item in items):
        found.append(Tool("tweezers", "to place nuts"))
    found += [
        Tool("syringe of 5 ml", "to lay beads of glue"),
        Tool("cotton gloves", "to touch mirrors with"),
        *_keys(items),
    ]
    if any(standard_of(item_title(item)).startswith("for plastics") for item in items if item.kind == "screw"):
        found.append(Tool("small screwdriver", "for the screws of the camera's board"))
    if not isinstance(device.holder, ScrewedHolderPlan):
        found.append(Tool("dental floss", "to take out a mirror again"))
    return tuple(found)


def also_needed(device: Device) -> tuple[Tool, ...]:
    """What is neither built in nor a tool."""
    needed = [
        Tool("calibration board, printed on paper", "`mirrorcam board --out board.pdf` makes the page, at 100 %"),
        Tool("flat stiff plate of its size, of glass or aluminium", "to glue the board on"),
    ]
    if device.hardware.camera.held_by.kind == "lips" and device.hardware.camera.held_by.display:
        needed.append(Tool("dot of felt, 1 mm thick", "between the display and the screw"))
    return tuple(needed)


def _keys(items: Sequence[BoughtItem]) -> list[Tool]:
    """Hex keys by their sizes, and the screws that each is for."""
    screws: dict[float, list[str]] = {}
    for item in items:
        standard = standard_of(item_title(item)).partition(",")[0]
        if item.kind != "screw" or standard not in SOCKETS_MM:
            continue
        diameter = diameter_mm(item.size.partition(" ")[0])
        names = screws.setdefault(SOCKETS_MM[standard][diameter], [])
        name = f"M{diameter:g} ({standard})"
        if name not in names:
            names.append(name)
    return [Tool(f"hex key of {size:g} mm", f"screws {', '.join(sorted(screws[size]))}") for size in sorted(screws)]
