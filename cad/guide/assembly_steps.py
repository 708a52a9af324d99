"""The components of each step of the assembly, for the pictures and the guide."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mirrorcam.cad.assembly.build_steps import STEPS, SeatOrder, is_piece_of
from mirrorcam.cad.assembly.components import Component
from mirrorcam.cad.plan.device_names import CAMERA, CARRIER, CLIP, HOLDER, MOUNT
from mirrorcam.core.figures.figure_texts import TIMES
from mirrorcam.core.names import anchor_of

# Prefix of the names of an adapter's parts.
ADAPTER = "adapter"


def joins_of(component: Component) -> tuple[str, ...]:
    """The parts that a fastener joins, the outer part first; () for other components."""
    return component.item.joins if component.item else ()


def belongs(part: Component, name: str) -> bool:
    """Return whether a printed part is the named one or a segment of it, such as "mount_1" of "mount"."""
    return is_piece_of(part.name, re.escape(name))


def home_of(fastener: Component, name: str, parts: Iterable[Component]) -> Component | None:
    """The named part that contains a fastener, or its nearest segment if it is split; None if there is none."""
    centre = np.asarray(fastener.mesh.bounds).mean(axis=0)

    def distance(part: Component) -> float:
        low, high = np.asarray(part.mesh.bounds)
        return float(np.linalg.norm(centre - np.clip(centre, low, high)))

    return min((part for part in parts if belongs(part, name)), key=distance, default=None)


def counted(components: Iterable[Component]) -> str:
    """A list of components with their counts, each linked to its section: "4 × [M3 nuts](#m3-nut)"; "" for none."""
    counts = Counter(component.title for component in components)
    return ", ".join(
        f"{count} {TIMES} [{title}{'' if count == 1 else 's'}](#{anchor_of(title)})" for title, count in counts.items()
    )


@dataclass(frozen=True)
class Stages:
    """All components of a device, grouped by the steps that need them."""

    components: Sequence[Component]

    def printed(self, *stems: str) -> list[Component]:
        """Printed parts with these prefixes, which include all segments of a split part."""
        return [
            component for component in self.components if component.kind == "part" and component.name.startswith(stems)
        ]

    def of_kind(self, *kinds: str) -> list[Component]:
        return [component for component in self.components if component.kind in kinds]

    @property
    def holder(self) -> list[Component]:
        return self.printed(HOLDER)

    @property
    def mount(self) -> list[Component]:
        return self.printed(MOUNT)

    @property
    def clip(self) -> list[Component]:
        return self.printed(CLIP)

    @property
    def adapter(self) -> list[Component]:
        return self.printed(ADAPTER)

    @property
    def carriers(self) -> list[Component]:
        """The carriers of mirrors; none if mirrors are glued to the holder."""
        return self.printed(CARRIER)

    @property
    def carrier_screws(self) -> list[Component]:
        """Screws that pull the carriers towards the holder, and their springs."""
        return self.screws(CARRIER, HOLDER)

    @property
    def mirrors(self) -> list[Component]:
        return self.of_kind("mirror")

    @property
    def camera(self) -> list[Component]:
        return self.of_kind("camera")

    @property
    def threads(self) -> list[Component]:
        """Inserts and captive nuts that are inserted before parts are joined: of the same kind as the holder's."""
        found = self.of_kind("insert", "nut")
        holders = [thread for thread in found if joins_of(thread)[-1] == HOLDER]
        kinds = {(thread.item.kind, thread.item.size) for thread in holders if thread.item}
        return [thread for thread in found if thread.item is None or (thread.item.kind, thread.item.size) in kinds]

    @property
    def back_nuts(self) -> list[Component]:
        """The adapter's own nuts, by which it is fastened to its support."""
        return [component for component in self.of_kind("nut") if component not in self.threads]

    @property
    def pins(self) -> list[Component]:
        """Pins between the segments of a split part."""
        return self.of_kind("pin")

    def threads_in(self, parts: Iterable[Component]) -> list[Component]:
        """The inserts and nuts whose seats are in the given parts."""
        parts = list(parts)
        return [
            component for component in self.threads if any(belongs(part, joins_of(component)[-1]) for part in parts)
        ]

    def screws(self, stem: str, *others: str) -> list[Component]:
        """Screws, washers and springs that join a part to others, all given by the prefixes of their names."""
        return [
            component
            for component in self.of_kind("screw", "washer", "spring")
            if any(name.startswith(stem) for name in joins_of(component))
            and any(name.startswith(others) for name in joins_of(component))
        ]

    @property
    def holder_screws(self) -> list[Component]:
        return self.screws(HOLDER, MOUNT)

    @property
    def camera_screws(self) -> list[Component]:
        """Screws that join only the clip, which hold the camera."""
        return [component for component in self.of_kind("screw") if set(joins_of(component)) <= {CLIP, CAMERA}]

    @property
    def clip_screws(self) -> list[Component]:
        return self.screws(CLIP, MOUNT)

    @property
    def adapter_screws(self) -> list[Component]:
        return self.screws(ADAPTER, ADAPTER, MOUNT)


def first_off(components: Iterable[Component], undone_first: Mapping[str, Sequence[str]]) -> dict[str, str]:
    """Sentences about the parts to take off before each step can be undone, by the step's name; "" if none."""
    printed = [component for component in components if component.kind == "part"]
    numbers = {step.name: (number, step) for number, step in enumerate(STEPS, start=1)}

    def part_text(name: str) -> str:
        number, step = numbers[name]
        kinds = {pair[0] for pair in step.joins}
        titles = [part.title.lower() for part in printed if any(is_piece_of(part.name, kind) for kind in kinds)]
        return f"the {' and the '.join(titles)} (step {number})"

    sentences = {step.name: "" for step in STEPS}
    for name, first in undone_first.items():
        if first:
            parts = ", then ".join(map(part_text, first))
            sentences[name] = f"In the assembled device a tool does not reach its screws: first take off {parts}."
    return sentences


def order_text(seats: SeatOrder, spacer_mm: float, narrowest_mm: float) -> str:
    """The order of the mirrors and how to place the loose ones; "" if there is no order.

    `spacer_mm` is the thickness of the coupon's strip for the gaps, 0 if it has none. A slide shifts a mirror's view by
    the same share of the mirror, at most that of the narrowest mirror.
    """
    if not seats.order:
        return ""
    text = f"Lay the mirrors into their seats in this order: {', '.join(seats.order)}."
    if not seats.loose_mm:
        return f"{text} Rims or mirrors that are in already hold each of them."
    names, plays = zip(*seats.loose_mm, strict=True)
    several = len(names) > 1
    subject = f"Mirror{'s' if several else ''} {', '.join(names)}" if len(names) < len(seats.order) else "All of them"
    place = (
        f"stand the strip of the fit coupon, {spacer_mm:g} mm thick, in the gap to each neighbour that is already in, "
        "where the gap is narrowest, and set the mirror against it"
        if spacer_mm
        else f"centre {'each' if several else 'it'} between rims and neighbours, with equal gaps"
    )
    return (
        f"{text} {subject} can slide by up to {max(plays):g} mm for lack of rims. Directions and distances depend only "
        "on the plane of a mirror, not on where it is in that plane, but its edges move in the picture: a millimetre "
        f"costs about {100.0 / narrowest_mm:.0f} % of the field that all views share. So {place}."
    )
