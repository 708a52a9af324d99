"""The screws that fasten and tilt a mirror's carrier: screw length, spring force and range of adjustment.

A countersunk screw enters from the holder's back, passes a spring in a recess of the front, and draws the carrier to
the holder by the thread in the carrier's back. Three screws set a plane: each moves its corner of the carrier by the
pitch per turn.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mirrorcam.cad.plan.fasteners import ROOF_IN_WEBS_DEG
from mirrorcam.cad.plan.hardware import PRINT_SETTINGS, Hardware
from mirrorcam.cad.plan.threads import SUNK_HEAD, thread_of
from mirrorcam.core.errors import InputError

# Gap between the carrier's edge and the holder at the end of its travel.
END_GAP_MM = 0.2
# Clearance at the end of a screw's hole, and depth of a head below the back.
TIP_CLEARANCE_MM, SUNK_MM = 0.2, 0.3
# Compression of a spring when its screw is loosened to the end of the travel.
MIN_COMPRESSION_MM = 1.2
# Radial clearance of a head in its cone, and the cone's half angle; the cone widens towards the back.
HEAD_FIT_MM, CONE_DEG = 0.05, 44.0
# Depth in the plate for a head and its cone, down to the wall under a spring, in diameters of the thread.
HEAD_DEPTH = 2.5 / 3.0
# Widths of the screwdriver's blade and of its holes in the mount, and the ends of these holes along the mount's x from
# their centres: the holes are printed horizontally and have a roof.
DRIVER_MM, DRIVER_HOLE_MM = 4.0, 4.6
DRIVER_HOLE_ENDS_MM = (-DRIVER_HOLE_MM / 2.0, DRIVER_HOLE_MM / 2.0 / float(np.sin(np.radians(ROOF_IN_WEBS_DEG))))
# Thickness of the plastic under a captive nut in a carrier.
UNDER_NUT_MM = 2.0


@dataclass(frozen=True)
class Adjuster:
    """The screws of the carriers, three for each and all alike; mm.

    A screw of a `thread` and `length_mm` passes through the holder, `plate_mm` thick, and the gap of `gap_mm` to the
    carrier, and engages `engaged_mm` in a hole `hole_mm` deep. A spring, compressed to `spring_mm` by `force_n`, lies
    in a recess of depth `recess_mm` in the holder's front. With the screw loosened to the end of its travel, plus or
    minus `travel_mm`, the spring's force is still `min_force_n`.
    """

    thread: str
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
    min_force_n: float

    @property
    def head_mm(self) -> float:
        """Largest diameter of the cone for a head, at the back."""
        return head_diameter_mm(self.thread)

    @property
    def cone_mm(self) -> float:
        """Depth of the cone, down to the clearance hole."""
        half = thread_of(self.thread).clearance_mm / 2.0
        return float((self.head_mm / 2.0 - half) / np.tan(np.radians(CONE_DEG)))


def head_diameter_mm(thread: str) -> float:
    """Diameter of the cone for a sunk head at the back's face."""
    return SUNK_HEAD * thread_of(thread).diameter_mm + 2.0 * (HEAD_FIT_MM + SUNK_MM)


def recess_diameter_mm(hardware: Hardware) -> float:
    """Diameter of the recess for a spring."""
    spring = hardware.holder.spring
    return spring.mean_mm + spring.wire_mm + 2.0 * hardware.fit.free_mm


def boss_mm(hardware: Hardware) -> float:
    """Radius of a carrier's plastic round a screw's axis: an insert and its wall, or a nut and a thin wall."""
    screw = hardware.screw
    if screw.kind == "insert":
        return screw.insert_hole_mm / 2.0 + screw.insert_wall_mm
    return screw.nut_flats_mm / np.sqrt(3.0) + hardware.fit.slide_mm + hardware.printer.wall_mm


def travel_mm(radius_mm: float, hardware: Hardware) -> float:
    """Range of motion along the screws, plus or minus, of a carrier's point `radius_mm` from its centre."""
    return float(np.tan(np.radians(hardware.holder.adjust_deg)) * radius_mm + hardware.holder.adjust_mm)


def min_plate_mm(travel: float, hardware: Hardware) -> float:
    """Minimum thickness of a holder with a spring's recess, a head's cone and a wall between them."""
    spring, diameter = hardware.holder.spring, thread_of(hardware.screw.thread).diameter_mm
    return spring.free_mm - MIN_COMPRESSION_MM - travel + HEAD_DEPTH * diameter + hardware.printer.wall_mm


def plan_adjuster(screws_radius_mm: float, edge_radius_mm: float, plate_mm: float, hardware: Hardware) -> Adjuster:
    """Choose the length of the screws and the compression of the springs.

    Parameters
    ----------
    screws_radius_mm, edge_radius_mm : float
        Largest distance of a carrier's screw, and of its edge, from the centre of its screws.
    plate_mm : float
        Thickness of the holder.
    hardware : Hardware
        Screws, spring and range of adjustment.

    Raises
    ------
    InputError
        If no screw on the list is long enough, the spring is too short or too narrow, or a tilted screw touches its
        hole.
    """
    screw, spring = hardware.screw, hardware.holder.spring
    thread = thread_of(screw.thread)
    if (inside := spring.mean_mm - spring.wire_mm) <= thread.diameter_mm:
        raise InputError(
            f"spring {spring.size} is {inside:g} mm wide inside, expected more than the {screw.thread} screw in it: "
            "give a wider holder.spring"
        )
    travel = travel_mm(screws_radius_mm, hardware)
    # A multiple of the layer height, since the coupon has a printed gauge of this thickness.
    layer = PRINT_SETTINGS.layer_mm
    gap = round(layer * float(np.ceil((travel_mm(edge_radius_mm, hardware) + END_GAP_MM) / layer)), 6)
    engagement = screw.engaged_mm if screw.kind == "insert" else UNDER_NUT_MM + screw.nut_height_mm
    needed = plate_mm - SUNK_MM + gap + engagement + travel
    lengths = [length for length in screw.lengths_mm if length >= needed]
    if not lengths:
        raise InputError(
            f"{screw.thread} screws of carriers must be {needed:.1f} mm long for {hardware.holder.adjust_deg:g} deg "
            "either way, longer than any on the list (screw.lengths_mm): expected smaller mirrors or a smaller "
            "holder.adjust_deg"
        )
    length = min(lengths)
    engaged = length + SUNK_MM - plate_mm - gap
    spring_length = spring.free_mm - MIN_COMPRESSION_MM - travel
    if spring_length - travel < spring.solid_mm or spring_length < gap:
        raise InputError(
            f"spring {spring.size} closes before a mirror has moved by {travel:.2f} mm either way, expected a longer "
            "holder.spring or a smaller holder.adjust_deg"
        )
    hole_clearance = (thread.clearance_mm - thread.diameter_mm) / 2.0
    if plate_mm * np.tan(np.radians(hardware.holder.adjust_deg)) > hole_clearance:
        max_deg = np.degrees(np.arctan(hole_clearance / plate_mm))
        raise InputError(
            f"holder.adjust_deg is {hardware.holder.adjust_deg:g}, expected at most {max_deg:.1f}: screws touch the "
            f"sides of their holes, which are {plate_mm:.1f} mm long"
        )
    thread_depth = engaged + travel + TIP_CLEARANCE_MM
    return Adjuster(
        thread=screw.thread,
        length_mm=length,
        plate_mm=plate_mm,
        gap_mm=gap,
        engaged_mm=engaged,
        hole_mm=max(thread_depth, screw.insert_depth_mm) if screw.kind == "insert" else thread_depth,
        travel_mm=travel,
        recess_mm=spring_length - gap,
        recess_wide_mm=recess_diameter_mm(hardware),
        spring_mm=spring_length,
        force_n=spring.n_per_mm * (spring.free_mm - spring_length),
        min_force_n=spring.n_per_mm * MIN_COMPRESSION_MM,
    )
