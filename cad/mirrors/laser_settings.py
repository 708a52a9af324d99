"""Starting values of power and speed for cutting acrylic mirrors with CO2 lasers of three classes.

Read in 2026-11: a course of Protolab (03-CO2 Laser Cutting & Engraving, U3M2 slide 3,
protolab.certifitrax.com) gives 65 to 75 % and 10 to 15 mm/s for cast acrylic of 3 mm at 60 W, half that speed for 6 mm
at 85 to 95 %, half the speed at 40 W and 30 % more at 80 W. A user of LightBurn's forum (topic 12728) cuts 3 mm at 80 W
with 80 % and 25 mm/s. Other thicknesses are scaled: the energy per length is in proportion to the thickness.
"""

from __future__ import annotations

from typing import NamedTuple

REFERENCE_MM = 3.0
SOURCE = "a course of Protolab (protolab.certifitrax.com, CO2 laser cutting, U3M2) for cast acrylic, read in 2026-11"
# Power of the tube in W, and the slowest and fastest cut of 3 mm in mm/s.
_SPEEDS = ((40, (5.0, 7.5)), (60, (10.0, 15.0)), (80, (13.0, 20.0)))
_PERCENT, _PERCENT_THICK = "65 to 75", "85 to 95"


class LaserSetting(NamedTuple):
    """Settings of one class of laser, as text: the power of its tube in W, power in % and speed in mm/s."""

    tube_w: int
    percent: str
    mm_per_s: str


def laser_settings(thickness_mm: float) -> tuple[LaserSetting, ...]:
    """Starting values for acrylic of a thickness."""
    percent = _PERCENT if thickness_mm <= REFERENCE_MM else _PERCENT_THICK
    scale = REFERENCE_MM / thickness_mm
    return tuple(
        LaserSetting(tube_w, percent, " to ".join(f"{speed * scale:.2g}" for speed in speeds))
        for tube_w, speeds in _SPEEDS
    )
