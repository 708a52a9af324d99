"""Threads of purchased items, and the sizes of heads, washers, nuts and inserts for them, in mm."""

from __future__ import annotations

import re
from dataclasses import dataclass


@dataclass(frozen=True)
class Thread:
    """A thread in mm: the screw's diameter, pitch, head and clearance hole, and its hexagon nut."""

    diameter_mm: float
    pitch_mm: float
    head_mm: float
    head_height_mm: float
    clearance_mm: float
    nut_flats_mm: float
    nut_height_mm: float


# Heads from ISO 4762, holes from ISO 273 (normal), nuts from ISO 4032; the last row from ASME B18.3 and B18.2.2.
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


@dataclass(frozen=True)
class Fittings:
    """The washer (diameter, thickness) and the heat-set insert (hole, length, wall round it) of a thread, in mm.

    `lengths_mm` are the lengths of screws that shops stock.
    """

    washer_mm: tuple[float, float]
    insert_mm: tuple[float, float, float]
    lengths_mm: tuple[float, ...]


# Washers from ISO 7089, holes and lengths of inserts from CNC Kitchen's data sheets, screws from ISO 4762.
FITTINGS = {
    "M2": Fittings((5.0, 0.3), (3.2, 3.0, 1.6), (4, 5, 6, 8, 10, 12, 16, 20)),
    "M2.5": Fittings((6.0, 0.5), (4.0, 4.0, 2.0), (4, 5, 6, 8, 10, 12, 16, 20, 25)),
    "M3": Fittings((7.0, 0.5), (4.0, 5.7, 2.0), (5, 6, 8, 10, 12, 16, 20, 25, 30)),
    "M4": Fittings((9.0, 0.8), (5.7, 8.1, 2.5), (6, 8, 10, 12, 16, 20, 25, 30, 35, 40)),
}

COUNTERSUNK = " countersunk"
"""Suffix of the size of a screw with a countersunk head of 90 deg (ISO 10642), whose length includes the head."""

SUNK_HEAD = 2.24
"""Theoretical sharp diameter of a countersunk head over the thread's diameter."""


def thread_of(size: str) -> Thread:
    """The thread of a size that starts with its name: "M3", "M3 countersunk", "1/4-20 UNC".

    Raises ValueError if the table has no thread of that name.
    """
    for name, thread in THREADS.items():
        if size == name or size.startswith(f"{name} "):
            return thread
    raise ValueError(f"{size=} does not name a thread, expected one of {', '.join(THREADS)}")


def diameter_mm(size: str) -> float:
    """The diameter of a size: its thread's, or the size itself if it is a number, such as "3" for a pin.

    Raises ValueError for any other size.
    """
    number = re.match(r"\d+(\.\d+)?$", size)
    return float(number.group()) if number else thread_of(size).diameter_mm
