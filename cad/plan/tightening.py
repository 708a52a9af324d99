"""Tightening torques of screws, at which the plastic bears a quarter of its strength.

The torque for a preload F (VDI 2230-1, equation for the tightening torque), with friction mu of thread and head, is
M = F (0.16 P + 0.58 d2 mu + D mu / 2), where D is the mean diameter of the bearing ring under the head. Friction is
assumed low, since a given torque then causes the largest preload. F is the smallest of these limits:

- the pressure p on the bearing ring under the head, its washer or a nut;
- the shear strength of half the cylinder round an insert or a thread-forming screw; its ridges take the other half.

p is a quarter of the plastic's tensile strength as moulded, since plastic creeps under a permanent load. The shear
limit is p / sqrt(3) (von Mises).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mirrorcam.cad.plan.device_names import CARRIER, CLIP
from mirrorcam.cad.plan.hardware import Hardware
from mirrorcam.cad.plan.part_plan import FORMING, PurchasedItem
from mirrorcam.cad.plan.threads import Thread, thread_of

FRICTION = 0.12
# Fraction of its strength that a plastic bears for years.
PERMANENT_FRACTION = 0.25
# Fraction of the cylinder round an insert or a thread that is plastic: the rest is its ridges.
PLASTIC_FRACTION = 0.5
# Largest force of a screw whose tip presses on the camera's body; such a screw joins only the clip.
CAMERA_SCREW_N = 50.0
CAMERA_SCREW_JOINS = (CLIP,)
COAXIAL_MM = 1e-3


@dataclass(frozen=True)
class Tightening:
    """The largest tightening torque of a screw in N m, and what limits it."""

    torque_nm: float
    limit: str

    @property
    def text(self) -> str:
        """The torque for documents, rounded down to two digits: "0.18 N m"."""
        digit = 10.0 ** (np.floor(np.log10(self.torque_nm)) - 1.0)
        return f"{np.floor(self.torque_nm / digit + 1e-9) * digit:.2g} N m"


def tightenings(items: Sequence[PurchasedItem], hardware: Hardware) -> tuple[Tightening | None, ...]:
    """The tightening of each purchased item, in their order; None for screws that adjust mirrors, and other items.

    The insert, nut or washer of a screw is the item on its axis.
    """
    return tuple(_tightening(item, items, hardware) if item.kind == "screw" else None for item in items)


def _tightening(screw: PurchasedItem, items: Sequence[PurchasedItem], hardware: Hardware) -> Tightening | None:
    table, thread = hardware.screw, thread_of(screw.size)
    on_axis = {item.kind for item in items if item is not screw and _is_coaxial(item, screw)}
    pressure = PERMANENT_FRACTION * hardware.printer.plastic_strength_mpa
    # Screws against springs adjust a mirror and are not tightened.
    if screw.joins[-1].startswith(CARRIER):
        return None
    if screw.joins == CAMERA_SCREW_JOINS and not screw.size.endswith(FORMING):
        return Tightening(_torque_nm(thread, CAMERA_SCREW_N, 0.0), "the camera's body")
    head, hole = thread.head_mm, thread.clearance_mm
    outer = max(head, table.washer_mm) if "washer" in on_axis else head
    forces = {"plastic under the head": pressure * _ring_mm2(outer, hole)}
    if screw.size.endswith(FORMING):
        # The head rests on the board.
        forces = {"thread in the plastic": _shear_n(thread.diameter_mm, _engaged_mm(screw, hardware), pressure)}
    elif "insert" in on_axis:
        forces["plastic round the insert"] = _shear_n(table.insert_hole_mm, table.insert_mm, pressure)
    elif "nut" in on_axis:
        flats = table.nut_flats_mm
        forces["plastic under the nut"] = pressure * (np.sqrt(3.0) / 2.0 * flats**2 - np.pi / 4.0 * hole**2)
    limit = min(forces, key=lambda name: forces[name])
    return Tightening(_torque_nm(thread, float(forces[limit]), (head + hole) / 2.0), limit)


def _torque_nm(thread: Thread, force_n: float, bearing_mm: float) -> float:
    """Torque for a force, by the formula above; `bearing_mm` is the mean diameter of the bearing ring."""
    flank = thread.diameter_mm - 3.0 * np.sqrt(3.0) / 8.0 * thread.pitch_mm
    arm_mm = 0.16 * thread.pitch_mm + 0.58 * flank * FRICTION + bearing_mm / 2.0 * FRICTION
    return float(force_n * arm_mm / 1000.0)


def _shear_n(diameter_mm: float, length_mm: float, pressure_mpa: float) -> float:
    return float(PLASTIC_FRACTION * pressure_mpa / np.sqrt(3.0) * np.pi * diameter_mm * length_mm)


def _ring_mm2(outer_mm: float, inner_mm: float) -> float:
    return float(np.pi / 4.0 * (outer_mm**2 - inner_mm**2))


def _engaged_mm(screw: PurchasedItem, hardware: Hardware) -> float:
    """Length of a board's screw in plastic, below the board."""
    return max(screw.length_mm - hardware.camera.depth_mm, 0.0)


def _is_coaxial(item: PurchasedItem, screw: PurchasedItem) -> bool:
    """Return whether an item is on a screw's axis, between one screw length above the head and the tip."""
    frame = screw.rig_from_item
    offset = item.rig_from_item[:3, 3] - frame[:3, 3]
    depth = -float(offset @ frame[:3, 2])
    distance = float(np.linalg.norm(offset + depth * frame[:3, 2]))
    return distance < COAXIAL_MM and -screw.length_mm < depth <= screw.length_mm
