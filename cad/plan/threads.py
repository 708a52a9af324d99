"""Sizes of threads, and of the screws and nuts that go with them, as the standards have them."""

from __future__ import annotations

import re
from dataclasses import dataclass


@dataclass(frozen=True)
class Thread:
    """A thread: the screw's diameter, its pitch, head and clearance hole, and the hexagon nut across flats; mm."""

    diameter_mm: float
    pitch_mm: float
    head_mm: float
    head_height_mm: float
    clearance_mm: float
    nut_flats_mm: float
    nut_height_mm: float


# Heads of ISO 4762, holes of ISO 273 (normal), nuts of ISO 4032; the last of ASME B18.3 and B18.2.2.
THREADS = {
    "M1.6": Thread(1.6, 0.35, 3.0, 1.6, 1.8, 3.2, 1.3),
    "M2": Thread(2.0, 0.4, 3.8, 2.0, 2.4, 4.0, 1.6),
    "M2.5": Thread(2.5, 0.45, 4.5, 2.5, 2.9, 5.0, 2.0),
    "M3": Thread(3.0, 0.5, 5.5, 3.0, 3.4, 5.5, 2.4),
    "M4": Thread(4.0, 0.7, 7.0, 4.0, 4.5, 7.0, 3.2),
    "M5": Thread(5.0, 0.8, 8.5, 5.0, 5.5, 8.0, 4.7),
    "M6": Thread(6.0, 1.0, 10.0, 6.0, 6.6, 10.0, 5.2),
    "M8": Thread(8.0, 1.25, 13.0, 8.0, 9.0, 13.0, 6.8),
    "1/4-20 UNC": Thread(6.35, 1.27, 9.53, 6.35, 6.6, 11.11, 5.56),
}

COUNTERSUNK = " countersunk"
"""End of the size of a screw with a countersunk head of 90 deg (ISO 10642), whose length counts from its top."""

SUNK_HEAD = 2.24
"""Diameter of such a head over that of the thread, where its cone would end in a sharp edge."""


def thread_of(size: str) -> Thread:
    """The thread of a size, which begins with its name: "M3", "M3 countersunk", "1/4-20 UNC".

    Raises ValueError for a size of no thread in the table.
    """
    for name, thread in THREADS.items():
        if size == name or size.startswith(f"{name} "):
            return thread
    raise ValueError(f"{size=} names no thread, expected one of {', '.join(THREADS)}")


def diameter_mm(size: str) -> float:
    """The diameter of a size: that of its thread, or the number that it begins with, "3" of a pin.

    Raises ValueError for a size that names neither.
    """
    number = re.match(r"\d+(\.\d+)?$", size)
    return float(number.group()) if number else thread_of(size).diameter_mm
