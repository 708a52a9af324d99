"""What may replace a purchased item of a device: other lengths of screws, and the fields of a hardware file.

Lengths follow from the plans of the joints; a sentence is left out where the plan does not decide it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from mirrorcam.cad.assembly.device_plan import Device
from mirrorcam.cad.backs.blocks import TRIPOD
from mirrorcam.cad.plan.hardware import Fastening
from mirrorcam.cad.plan.part_plan import PurchasedItem
from mirrorcam.cad.plan.threads import COUNTERSUNK, FITTINGS

AGAIN = "under `[screw]` in a hardware file, and build again"


def substitutes(items: Sequence[PurchasedItem], device: Device) -> list[str]:
    """Sentences in Markdown on what may replace equal items of a device, and what may not."""
    first, screw = items[0], device.hardware.screw
    if first.kind == "screw":
        return length_notes(items, screw)
    if (first.kind, first.size) == ("insert", screw.thread):
        return [
            f"Another {screw.thread} insert, at least {screw.engaged_mm:g} mm long: give the hole of its data sheet "
            f"and its length as `insert_hole_mm` and `insert_mm` {AGAIN}.",
            f'Nuts: give `kind = "nut"` {AGAIN}.',
        ]
    if (first.kind, first.size) == ("nut", screw.thread):
        return [
            f"Only nuts of {screw.nut_flats_mm:g} mm across flats and {screw.nut_height_mm:g} mm high: self-locking "
            "ones are higher than the pockets.",
            f'Heat-set inserts: give `kind = "insert"` {AGAIN}.',
        ]
    if (first.kind, first.size) == ("nut", TRIPOD) and device.back.stand:
        return ["Leave it out if the device will never stand on a tripod."]
    return []


def length_notes(items: Sequence[PurchasedItem], screw: Fastening) -> list[str]:
    """Sentences on other lengths of equal screws: which of those that shops stock hold as well, and which do not."""
    own, size = items[0].length_mm, items[0].size
    thread, countersunk = size.removesuffix(COUNTERSUNK), size.endswith(COUNTERSUNK)
    ranges = [item.lengths_mm for item in items if item.lengths_mm is not None]
    if len(ranges) < len(items) or thread not in FITTINGS:
        return ["Only this length is known to fit."]
    shortest, longest = max(low for low, _ in ranges), min(high for _, high in ranges)
    lengths = FITTINGS[thread].lengths_mm
    fitting = [f"{thread} x {length:g}" for length in lengths if shortest <= length <= longest and length != own]
    notes = [f"{' and '.join(fitting)} hold{'s' if len(fitting) == 1 else ''} as well."] if fitting else []
    needed = screw.engaged_mm if screw.kind == "insert" else screw.nut_height_mm
    for length in [length for length in lengths if length < shortest - 1e-9][-1:]:
        thread_mm = needed - (shortest - length)
        short = f"has {thread_mm:.1f} mm of thread" if thread_mm > 0.05 else "does not reach the thread"
        notes.append(f"{thread} x {length:g} is too short: it {short}, expected at least {needed:g} mm.")
    for length in [length for length in lengths if length > longest + 1e-9][:1]:
        excess = length - longest
        washers = math.ceil(excess / screw.washer_height_mm - 1e-9)
        fits = not countersunk and length - washers * screw.washer_height_mm >= shortest - 1e-9
        remedy = f"; it fits with {washers} washer{'s' if washers > 1 else ''} under its head" if fits else ""
        notes.append(f"{thread} x {length:g} is {excess:.1f} mm too long{remedy}.")
    return notes
