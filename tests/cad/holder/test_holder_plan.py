"""The plan of the holder: rims out of the light, holes in solid material, and layouts that cannot be built."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from shapely import Polygon

from mirrorcam.cad.assembly.device_plan import Device
from mirrorcam.cad.holder.back import tip_mm
from mirrorcam.cad.holder.holder_body import HolderPlan
from mirrorcam.cad.holder.holder_plan import plan_holder
from mirrorcam.cad.plan.hardware import HARDWARE
from mirrorcam.cad.plan.seats import seat_distance_mm
from mirrorcam.core.errors import InputError
from mirrorcam.optics.geometry.layout import Layout


def test_every_hole_ends_a_wall_below_the_seats(default_layout: Layout, device: Device) -> None:
    body = device.holder
    turn, origin = body.rig_from_mount[:3, :3], body.rig_from_mount[:3, 3]
    angle = np.linspace(0.0, 2.0 * np.pi, 36)
    ring = HARDWARE.screw.insert_hole_mm / 2.0 * np.column_stack([np.cos(angle), np.sin(angle)])
    for hole in body.holes_in_mount_mm:
        flat = np.column_stack(
            [ring + hole, np.full(len(ring), -HARDWARE.screw.insert_depth_mm - HARDWARE.printer.wall_mm)]
        )
        ends = flat @ turn.T + origin
        for mirror, core in zip(default_layout.mirrors, body.cores, strict=True):
            below = Polygon((core.top - origin) @ turn[:, :2])
            over = [below.contains(Polygon(ring + hole)), below.intersects(Polygon(ring + hole))]
            if any(over):
                assert (ends @ mirror.normal_in_rig + seat_distance_mm(mirror, HARDWARE) < 1e-9).all()


def thin_floor(body: HolderPlan) -> float:
    """Minimum thickness of material behind any corner of a seat, along the mount's z."""
    back = body.rig_from_mount[:3, 3] @ body.rig_from_mount[:3, 2]
    return min(float((back - core.top @ body.rig_from_mount[:3, 2]).min()) for core in body.cores)


def test_the_floor_is_as_thick_as_the_table_says(make_flat_pair: Callable[..., Layout]) -> None:
    layout = make_flat_pair(gap_mm=10.0)
    assert thin_floor(plan_holder(layout, HARDWARE)) == pytest.approx(
        HARDWARE.screw.insert_depth_mm
        + tip_mm(HARDWARE.screw)
        + HARDWARE.holder.groove_depth_mm
        + HARDWARE.printer.floor_mm
    )
    assert thin_floor(
        plan_holder(layout, HARDWARE.replaced(holder=HARDWARE.holder.replaced(floor_mm=12.0)))
    ) == pytest.approx(12.0)


def test_a_part_higher_than_the_printer_is_refused_with_its_height(make_parabola: Callable[..., Layout]) -> None:
    with pytest.raises(InputError, match=r"mm high, expected at most 20 mm"):
        plan_holder(
            make_parabola(3, 3), HARDWARE.replaced(printer=HARDWARE.printer.replaced(bed_mm=(220.0, 220.0, 20.0)))
        )
