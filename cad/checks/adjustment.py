"""Checks of mirrors on carriers: clashes over the full travel, spring forces and access for a screwdriver.

In each pose the mirror is tilted by `holder.adjust_deg` about one of several axes and shifted by `holder.adjust_mm`
in either direction along the screws' axes. Its own screws move with it; `plan_adjuster` leaves space for their shanks.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import manifold3d
import numpy as np

from mirrorcam.cad.assembly.device_plan import Device
from mirrorcam.cad.checks.clashes import FASTENERS, overlap_mm3
from mirrorcam.cad.holder.adjuster import DRIVER_MM
from mirrorcam.cad.holder.carriers import CarrierPlan, rotation_about, tilt_per_turn_deg
from mirrorcam.cad.holder.screwed_holder import ScrewedHolderPlan
from mirrorcam.cad.plan.device_names import carrier_name
from mirrorcam.cad.plan.threads import SUNK_HEAD, thread_of
from mirrorcam.core.values import FloatArray, Metric

DIRECTIONS = 8
WEIGHT_N_PER_GRAM = 9.80665e-3
# Length of a screwdriver's blade; diameter and length of its handle.
BLADE_MM, HANDLE_MM = 75.0, (20.0, 30.0)
# Only solids closer than this to a mirror are tested.
NEAR_MM = 5.0


def check_adjustment(
    device: Device, solids: Mapping[str, manifold3d.Manifold], supports: Mapping[str, manifold3d.Manifold]
) -> dict[str, Metric]:
    """Check that every mirror can be adjusted; {} if the mirrors are glued to the holder.

    Parameters
    ----------
    device : Device
        The plans of its parts.
    solids : mapping of str to Manifold
        The solids of the assembled device by name, in the rig frame, mm.
    supports : mapping of str to Manifold
        Solids that support the device and may block a screwdriver.

    Returns
    -------
    dict of str to Metric
        Overlap of tilted mirrors and their carriers with other solids; the smallest gap to these; the smallest force of
        a spring, which must exceed the heaviest mirror's weight under acceleration; volume that blocks the screwdriver
        in the assembled device; smallest and largest tilt per turn of a screw.
    """
    holder = device.holder
    if not isinstance(holder, ScrewedHolderPlan):
        return {}
    clash, gap = _travel_clash(device, holder, solids)
    acceleration_in_g = device.hardware.clip.shaken_g
    min_force_n = acceleration_in_g * WEIGHT_N_PER_GRAM * _max_mass_grams(device, solids)
    tilts_deg = [tilt_per_turn_deg(carrier) for carrier in holder.carriers]
    return {
        "mirrors.adjust_clash_mm3": Metric(value=clash, unit="mm3", limit=0.0),
        "mirrors.adjust_gap_mm": Metric(value=round(gap, 3), unit="mm"),
        "mirrors.spring_least_n": Metric(
            value=round(holder.adjuster.min_force_n, 2), unit="N", limit=round(min_force_n, 3), lower_is_better=False
        ),
        "mirrors.adjust_tool_clash_mm3": Metric(
            value=_driver_clash(holder, {**solids, **supports}), unit="mm3", limit=0.0
        ),
        "mirrors.turn_least_deg": Metric(value=round(min(tilts_deg), 2), unit="deg"),
        "mirrors.turn_most_deg": Metric(value=round(max(tilts_deg), 2), unit="deg"),
    }


def poses(carrier: CarrierPlan, tilt_deg: float, shift_mm: float) -> Iterator[FloatArray]:
    """Motions (4, 4) in the rig frame that take a carrier to the ends of its travel."""
    frame, back = carrier.rig_from_back, np.linalg.inv(carrier.rig_from_back)
    for azimuth in 2.0 * np.pi / DIRECTIONS * np.arange(DIRECTIONS):
        for shift in (-shift_mm, shift_mm):
            motion = np.eye(4)
            motion[:3, :3] = rotation_about(
                np.array([np.cos(azimuth), np.sin(azimuth), 0.0]), float(np.radians(tilt_deg))
            )
            motion[2, 3] = shift
            yield frame @ motion @ back


def _travel_clash(
    device: Device, holder: ScrewedHolderPlan, solids: Mapping[str, manifold3d.Manifold]
) -> tuple[float, float]:
    """Overlap of tilted mirrors and carriers with other solids, and the smallest gap between them."""
    dimensions = device.hardware.holder
    overlap, gap = 0.0, NEAR_MM
    for carrier in holder.carriers:
        own = {carrier_name(carrier.name), f"mirror_{carrier.name}"}
        moving = manifold3d.Manifold.compose([solids[name] for name in sorted(own) if name in solids])
        if moving.is_empty():
            continue
        others = [
            solid
            for name, solid in solids.items()
            if name not in own and not name.startswith(FASTENERS) and moving.min_gap(solid, NEAR_MM) < NEAR_MM
        ]
        obstacle = manifold3d.Manifold.compose(others)
        for pose in poses(carrier, dimensions.adjust_deg, dimensions.adjust_mm):
            tilted = moving.transform(pose[:3])
            overlap += overlap_mm3(tilted, obstacle)
            gap = min(gap, tilted.min_gap(obstacle, NEAR_MM))
    return overlap, gap


def _max_mass_grams(device: Device, solids: Mapping[str, manifold3d.Manifold]) -> float:
    """Mass of the heaviest mirror with its carrier: an upper bound with solid plastic and glass mirrors."""
    density = device.hardware.printer.plastic_g_per_cm3
    glass = 2.5
    return max(
        (
            density * solids[carrier_name(name)].volume() / 1000.0 + glass * solids[f"mirror_{name}"].volume() / 1000.0
            for name in device.layout.mirror_names
            if carrier_name(name) in solids and f"mirror_{name}" in solids
        ),
        default=0.0,
    )


def _driver_clash(holder: ScrewedHolderPlan, solids: Mapping[str, manifold3d.Manifold]) -> float:
    """Largest overlap of a screwdriver at a screw with the assembled device and its support."""
    obstacle = manifold3d.Manifold.compose([solid for name, solid in solids.items() if not name.startswith(FASTENERS)])
    head_radius = SUNK_HEAD * thread_of(holder.adjuster.thread).diameter_mm / 2.0
    blade = manifold3d.Manifold.cylinder(BLADE_MM, DRIVER_MM / 2.0, circular_segments=32)
    handle = manifold3d.Manifold.cylinder(HANDLE_MM[1], HANDLE_MM[0] / 2.0, circular_segments=32)
    driver = blade.translate((0.0, 0.0, -head_radius / 4.0)) + handle.translate((0.0, 0.0, BLADE_MM))
    frame = np.array(holder.rig_from_mount)
    clash = 0.0
    for head in holder.heads:
        frame[:3, 3] = head
        clash = max(clash, overlap_mm3(obstacle, driver.transform(frame[:3])))
    return clash
