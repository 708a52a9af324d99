"""The screws that hold and tilt a mirror's carrier: how long they are, what springs press, and how far they move it.

A countersunk screw comes from the holder's back, passes a spring in a recess of its front, and draws the carrier to the
holder by the thread in the carrier's back. Three of them set a plane: turned in, a screw moves its corner of the
carrier by its pitch per turn.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mirrorcam.cad.plan.fasteners import ROOF_IN_WEBS_DEG, SUNK_HEAD, thread_of
from mirrorcam.cad.plan.hardware import PRINT_SETTINGS, Hardware
from mirrorcam.core.errors import InputError

SCREW = "M3"
"""Thread of the screws: the same as all others, so that inserts and nuts are the same."""

# The carrier's edge keeps this far from the holder at the end of its travel.
SPARE_MM = 0.2
# A screw ends this far before the end of its hole, a head lies this far below the back.
TIP_MM, SUNK_MM = 0.2, 0.3
# At the end of its travel a spring is still pressed by this much.
PRESSED_MM = 1.2
# The cone for a head is as wide as the head and this much; it leans so far from upright, and widens below the head.
HEAD_FIT_MM, CONE_DEG = 0.05, 44.0
# Depth in the plate for a head and its cone, down to the wall under a spring.
HEAD_SPACE_MM = 2.5
# The blade of the driver, the holes in the mount through which it turns the screws, and how far these reach along the
# mount's x from their middles: they print lying, with a roof.
DRIVER_MM, DRIVER_HOLE_MM = 4.0, 4.6
DRIVER_HOLE_ENDS_MM = (-DRIVER_HOLE_MM / 2.0, DRIVER_HOLE_MM / 2.0 / float(np.sin(np.radians(ROOF_IN_WEBS_DEG))))
# The plastic under a captive nut in a carrier.
UNDER_NUT_MM = 2.0


@dataclass(frozen=True)
class Adjuster:
    """The three screws of every carrier, all alike; mm.

    A screw of `length_mm` passes the holder, `plate_mm` thick, and the gap of `gap_mm` to the carrier, and reaches
    `engaged_mm` into its hole, `hole_mm` deep. A spring, pressed to `spring_mm` by `force_n`, lies in a recess of
    `recess_mm` in the holder's front; the rest of the travel, `travel_mm` either way, leaves it pressed by `least_n`.
    """

    length_mm: float
    plate_mm: float
    gap_mm: float
    engaged_mm: float
    hole_mm: float
    travel_mm: float
    recess_mm: float
    recess_wide_mm: float
    spring_mm: float
    force_n: float
    least_n: float

    @property
    def head_mm(self) -> float:
        """Diameter of the cone for a head where it is widest: at the back."""
        return head_wide_mm()

    @property
    def cone_mm(self) -> float:
        """Depth of that cone, down to the clearance hole."""
        half = thread_of(SCREW).clearance_mm / 2.0
        return float((self.head_mm / 2.0 - half) / np.tan(np.radians(CONE_DEG)))


def head_wide_mm() -> float:
    """Diameter of the cone for a head at the back, below which the head lies."""
    return SUNK_HEAD * thread_of(SCREW).diameter_mm + 2.0 * (HEAD_FIT_MM + SUNK_MM)


def recess_wide_mm(hardware: Hardware) -> float:
    """Diameter of the recess for a spring."""
    spring = hardware.holder.spring
    return spring.mean_mm + spring.wire_mm + 2.0 * hardware.fit.free_mm


def boss_mm(hardware: Hardware) -> float:
    """Radius of the plastic of a carrier round a screw's axis: an insert and its wall, or a nut and a thin one."""
    screw = hardware.screw
    if screw.kind == "insert":
        return screw.insert_hole_mm / 2.0 + screw.insert_wall_mm
    return screw.nut_flats_mm / np.sqrt(3.0) + hardware.fit.slide_mm + hardware.printer.wall_mm


def travel_mm(reach_mm: float, hardware: Hardware) -> float:
    """How far a point of a carrier, `reach_mm` from its middle, moves either way along the screws."""
    return float(np.tan(np.radians(hardware.holder.adjust_deg)) * reach_mm + hardware.holder.adjust_mm)


def least_plate_mm(travel: float, hardware: Hardware) -> float:
    """Thickness of a holder that has space for a spring's recess and a head's cone, with a wall between them."""
    spring = hardware.holder.spring
    return spring.free_mm - PRESSED_MM - travel + HEAD_SPACE_MM + hardware.printer.wall_mm


def plan_adjuster(screws_reach_mm: float, edge_reach_mm: float, plate_mm: float, hardware: Hardware) -> Adjuster:
    """Choose the screw, and how far springs are pressed.

    Parameters
    ----------
    screws_reach_mm, edge_reach_mm : float
        The largest distance of a carrier's screw, and of its edge, from the middle of its screws.
    plate_mm : float
        Thickness of the holder.
    hardware : Hardware
        Screws, spring, and how far mirrors are to be moved.

    Raises
    ------
    InputError
        Where no screw on the list is long enough, or the spring too short.
    """
    screw, spring = hardware.screw, hardware.holder.spring
    travel = travel_mm(screws_reach_mm, hardware)
    # In whole layers, of which the coupon's gauge for it is printed.
    layer = PRINT_SETTINGS.layer_mm
    gap = round(layer * float(np.ceil((travel_mm(edge_reach_mm, hardware) + SPARE_MM) / layer)), 6)
    held = screw.engaged_mm if screw.kind == "insert" else UNDER_NUT_MM + screw.nut_height_mm
    least = plate_mm - SUNK_MM + gap + held + travel
    lengths = [length for length in screw.lengths_mm if length >= least]
    if not lengths:
        raise InputError(
            f"screws of carriers must be {least:.1f} mm long for {hardware.holder.adjust_deg:g} deg either way, longer "
            "than any on the list (screw.lengths_mm): expected smaller mirrors or a smaller holder.adjust_deg"
        )
    length = min(lengths)
    engaged = length + SUNK_MM - plate_mm - gap
    pressed_to = spring.free_mm - PRESSED_MM - travel
    if pressed_to - travel < spring.solid_mm or pressed_to < gap:
        raise InputError(
            f"spring {spring.size} closes before a mirror has moved by {travel:.2f} mm either way, expected a longer "
            "holder.spring or a smaller holder.adjust_deg"
        )
    shank = (thread_of(SCREW).clearance_mm - thread_of(SCREW).diameter_mm) / 2.0
    if plate_mm * np.tan(np.radians(hardware.holder.adjust_deg)) > shank:
        most = np.degrees(np.arctan(shank / plate_mm))
        raise InputError(
            f"holder.adjust_deg is {hardware.holder.adjust_deg:g}, expected at most {most:.1f}: screws touch the sides "
            f"of their holes, which are {plate_mm:.1f} mm long"
        )
    inside = engaged + travel + TIP_MM
    return Adjuster(
        length_mm=length,
        plate_mm=plate_mm,
        gap_mm=gap,
        engaged_mm=engaged,
        hole_mm=max(inside, screw.insert_depth_mm) if screw.kind == "insert" else inside,
        travel_mm=travel,
        recess_mm=pressed_to - gap,
        recess_wide_mm=recess_wide_mm(hardware),
        spring_mm=pressed_to,
        force_n=spring.n_per_mm * (spring.free_mm - pressed_to),
        least_n=spring.n_per_mm * PRESSED_MM,
    )
