"""The steps of building a device, in order: the pieces joined, the calibration pictures taken, and the tools.

The guide's headings, and the check of the camera's view in those pictures, both follow this table.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from mirrorcam.cad.assembly.components import item_title
from mirrorcam.cad.assembly.device_plan import Device
from mirrorcam.cad.holder.screwed_holder import ScrewedHolderPlan
from mirrorcam.cad.plan.device_names import CAMERA, CARRIER, CLIP, HOLDER, MOUNT
from mirrorcam.cad.plan.goods import standard_of
from mirrorcam.cad.plan.hardware import Fastening
from mirrorcam.cad.plan.part_plan import PurchasedItem
from mirrorcam.cad.plan.rectangles import is_sold_in_size
from mirrorcam.cad.plan.threads import diameter_mm

# Regular expressions for the names of pieces.
MIRROR, ADAPTER, CARRIERS = r"mirror_\d+(?:-\d+)?", r"adapter_\w+", rf"{CARRIER}\d+(?:-\d+)?"


@dataclass(frozen=True)
class Step:
    """A step of the guide: the pairs of pieces that it joins, by patterns of their names.

    `pictures` is the folder of the calibration pictures that are taken at its end; "" for none.
    """

    name: str
    joins: tuple[tuple[str, str], ...] = ()
    pictures: str = ""


STEPS = (
    Step("measure"),
    Step("print"),
    Step("cut"),
    Step("inserts"),
    Step("mirrors", ((MIRROR, HOLDER), (MIRROR, CARRIERS), (CARRIERS, HOLDER))),
    Step("holder", ((HOLDER, MOUNT),)),
    Step("camera", ((CAMERA, CLIP),), pictures="base"),
    Step("clip", ((CLIP, MOUNT),)),
    Step("back", ((ADAPTER, MOUNT),)),
    Step("calibrate", pictures="frames"),
)


@dataclass(frozen=True)
class SeatOrder:
    """The order in which mirrors go into their seats, by name, and the play in mm of those that are loose by then."""

    order: tuple[str, ...] = ()
    loose_mm: tuple[tuple[str, float], ...] = ()


def connected_to_camera(
    steps: Iterable[Step], last: Step, pieces: Iterable[str], fastened: Mapping[str, tuple[str, ...]]
) -> set[str]:
    """The pieces connected to the camera after a step, without the camera itself.

    Parameters
    ----------
    steps : iterable of Step
        All steps, in order.
    last : Step
        The last completed step.
    pieces : iterable of str
        Names of all pieces of the assembled device except fasteners; "mount_1" is a piece of a split part.
    fastened : mapping of str to tuple of str
        Names of fasteners, each with the parts that it joins; a fastener is present as soon as its parts are.

    Returns
    -------
    set of str
        Names of pieces and fasteners.
    """
    names = set(pieces) - {CAMERA}
    order = tuple(steps)
    done = order[: order.index(last) + 1]
    connected = _connected({CAMERA}, names, [pair for step in done for pair in step.joins])
    connected |= {
        name
        for name, parts in fastened.items()
        if all(any(is_piece_of(piece, part) for piece in connected) for part in parts)
    }
    return connected - {CAMERA}


def parts_when_joined(joins: Iterable[str], pieces: Iterable[str], steps: Iterable[Step] = STEPS) -> set[str]:
    """The pieces present when parts are screwed together: all pieces connected to them after the joining step.

    The joining step is the one that joins both parts; otherwise the first step after which every part is joined to
    something; otherwise the last step.

    Parameters
    ----------
    joins : iterable of str
        Names of the parts that a fastener joins; only one if it holds a purchased item in that part.
    pieces : iterable of str
        Names of all pieces of the assembled device except fasteners; "mount_1" is a piece of a split part.
    steps : iterable of Step
        All steps, in order.

    Returns
    -------
    set of str
        Names of pieces.
    """
    parts, order = tuple(joins), tuple(steps)
    last = joining_step(parts, order)
    return pieces_joined(parts, pieces, order[: order.index(last) + 1])


def joining_step(joins: Iterable[str], steps: Iterable[Step] = STEPS) -> Step:
    """The step that joins the parts of a fastener, see `parts_when_joined`."""
    parts, order = tuple(joins), tuple(steps)
    joining = next((step for step in order if any(_matches(pair, parts) for pair in step.joins)), None)
    if joining is not None:
        return joining
    joined_kinds: list[str] = []
    for step in order:
        joined_kinds += [kind for pair in step.joins for kind in pair]
        if all(any(is_piece_of(part, kind) for kind in joined_kinds) for part in parts):
            return step
    return order[-1]


def step_of_item(item: PurchasedItem, screw: Fastening, steps: Iterable[Step] = STEPS) -> Step:
    """The step that uses a purchased item: the inserts and nuts of the parts' screws have their own."""
    order = tuple(steps)
    own = {"insert": "inserts", "nut": "inserts", "pin": "print"}.get(item.kind)
    if own is None or (item.kind == "nut" and item.size != screw.thread):
        return joining_step(item.joins, order)
    return next(step for step in order if step.name == own)


def pieces_joined(parts: Iterable[str], pieces: Iterable[str], steps: Iterable[Step]) -> set[str]:
    """The pieces of parts, and all pieces that the steps connect to them; names as in `parts_when_joined`."""
    kinds, names = tuple(parts), set(pieces)
    own = {name for name in names if any(is_piece_of(name, part) for part in kinds)}
    return _connected(own, names, [pair for step in steps for pair in step.joins])


def _matches(pair: tuple[str, str], parts: tuple[str, ...]) -> bool:
    return len(parts) == 2 and any(
        is_piece_of(parts[0], first) and is_piece_of(parts[1], second) for first, second in (pair, pair[::-1])
    )


def _connected(initial: set[str], names: set[str], joins: list[tuple[str, str]]) -> set[str]:
    """A set of pieces, and all pieces joined to it by pairs of patterns, directly or through others."""
    connected = set(initial)
    while added := {
        name
        for name in names - connected
        for pair in joins
        for kind, other_kind in (pair, pair[::-1])
        if is_piece_of(name, kind) and any(is_piece_of(piece, other_kind) for piece in connected)
    }:
        connected |= added
    return connected


def is_piece_of(name: str, kind: str) -> bool:
    """Return whether a name matches a pattern of a part or is a piece of it: "mount" and "mount_1" match "mount"."""
    return re.fullmatch(rf"(?:{kind})(?:_\d+)?", name) is not None


# Width across flats of the hexagon socket by thread diameter, mm: table 1 of ISO 4762 and ISO 10642; ASME B18.3.
SOCKETS_MM = {
    "ISO 4762": {2.0: 1.5, 2.5: 2.0, 3.0: 2.5, 4.0: 3.0, 5.0: 4.0, 6.0: 5.0},
    "ISO 10642": {3.0: 2.0, 4.0: 2.5, 5.0: 3.0, 6.0: 4.0},
    "ASME B18.3": {6.35: 3.97},
}


@dataclass(frozen=True)
class Tool:
    """A tool or consumable that does not stay in the device: its name and purpose."""

    name: str
    purpose: str


def tools_of(device: Device, items: Sequence[PurchasedItem]) -> tuple[Tool, ...]:
    """All hand tools for a device with these purchased items, in the order of the guide's steps, without machines."""
    glass, taped = device.hardware.cutting.material == "glass", device.hardware.holder.mirrors == "tape"
    sold = is_sold_in_size(device.layout)
    scored = glass and not sold
    tools = [
        Tool("calipers", "to measure camera, mirrors and board"),
        Tool("kitchen scale", "to weigh the camera"),
        Tool("steel ruler", "to find the entrance pupil" + ("; to cut along" if scored or taped else "")),
        Tool("blade", "to clean pads and seats" + ("; to cut tape" if taped else "")),
    ]
    if scored:
        tools.append(Tool("goggles and cut-resistant gloves", "to break glass"))
    if glass or sold:
        tools.append(Tool("paint marker", "to label the mirrors"))
    thread = device.hardware.screw.thread
    if any(item.kind == "insert" for item in items):
        tools.append(Tool(f"soldering iron with a tip for {thread} inserts", "at about 220 °C in PLA"))
    if any((item.kind, item.size) == ("nut", thread) for item in items) and not taped:
        tools.append(Tool("tweezers", "to place nuts"))
    tools += [
        Tool("tweezers", "to place tape") if taped else Tool("5 ml syringe", "to lay beads of glue"),
        Tool("cotton gloves", "to handle mirrors"),
        *_keys(items),
    ]
    if cable_ties(device):
        tools.append(Tool("side cutters", "to cut off the ends of cable ties"))
    if any(
        "hexagon" not in standard_of(item_title(item)) and "socket" not in standard_of(item_title(item))
        for item in items
        if item.kind == "screw"
    ):
        tools.append(Tool("small screwdriver", "for the screws of the camera"))
    if not isinstance(device.holder, ScrewedHolderPlan):
        tools.append(Tool("dental floss", "to remove a mirror"))
    return tuple(tools)


def cable_ties(device: Device) -> list[tuple[str, str]]:
    """What each cable tie joins, and the name of the step that closes it."""
    camera = device.hardware.camera
    ties = [("cable to camera clip", "camera"), ("cable to mount", "clip")] if camera.has_cable else []
    ties += [("camera to camera clip", "camera")] * len(device.clip.straps_mm)
    return ties + ([("lens to camera clip", "camera")] if camera.rest_mm is not None else [])


def also_needed(device: Device, items: Sequence[PurchasedItem]) -> tuple[Tool, ...]:
    """Items needed that are neither built in nor tools."""
    needed = [
        Tool("calibration board, printed on paper", "`mirrorcam board --out board.pdf` makes the page, at 100 %"),
        Tool("flat stiff plate of the same size, glass or aluminium", "to glue the board on"),
    ]
    surfaces = {mirror.surface for mirror in device.layout.mirrors}
    if device.hardware.holder.mirrors == "tape":
        needed.append(Tool("isopropyl alcohol and a lint-free cloth", "to degrease pads"))
    if "second" in surfaces:
        glass = device.hardware.cutting.material == "glass"
        needed.append(Tool("alcohol and a lint-free cloth" if glass else "soap and a soft cloth", "to clean mirrors"))
    if "second" in surfaces and device.hardware.cutting.material == "acrylic" and not is_sold_in_size(device.layout):
        needed.append(Tool("paper tape", "over the paint, to carry the marks"))
    if any(item.kind == "pin" for item in items):
        needed.append(Tool("epoxy glue", "to join the pieces of a part"))
    if device.clip.tray is not None and not device.hardware.camera.has_cable:
        needed.append(Tool("dot of felt, 1 mm thick", "between the display and the screw"))
    return tuple(needed)


def _keys(items: Sequence[PurchasedItem]) -> list[Tool]:
    """Hex keys by size, each with its screws."""
    screws: dict[float, list[str]] = {}
    for item in items:
        standard = standard_of(item_title(item)).partition(",")[0]
        if item.kind != "screw" or standard not in SOCKETS_MM:
            continue
        thread = item_title(item).partition(" x ")[0]
        diameter = diameter_mm(thread)
        names = screws.setdefault(SOCKETS_MM[standard][diameter], [])
        name = f"{thread} ({standard})"
        if name not in names:
            names.append(name)
    return [Tool(f"{size:g} mm hex key", f"screws {', '.join(sorted(screws[size]))}") for size in sorted(screws)]
