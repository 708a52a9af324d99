"""Openings of the mount: the scale, the cable's window, printable roofs."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.cad.assembly.device_plan import Device
from mirrorcam.cad.holder.adjuster import DRIVER_HOLE_MM
from mirrorcam.cad.holder.holder_body import HolderPlan
from mirrorcam.cad.holder.holder_plan import plan_holder
from mirrorcam.cad.parts.clip import ClipPlan, plan_clip
from mirrorcam.cad.parts.mount import MountPlan, plan_mount
from mirrorcam.cad.parts.mount_openings import _scale_marks, head_end_mm, leaves_unprintable_web_ends
from mirrorcam.cad.parts.truss import Webs
from mirrorcam.cad.plan.fasteners import Bore, head_space_mm
from mirrorcam.cad.plan.hardware import HARDWARE
from mirrorcam.optics.geometry.camera_library import read_body
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.transforms import transform
from tests.cad.holder.screwed import planned as planned_on_screws
from tests.cad.holder.screwed import with_screws

Planned = tuple[Layout, HolderPlan, ClipPlan, MountPlan]


@pytest.fixture(scope="module")
def planned(default_layout: Layout, device: Device) -> Planned:
    holder, clip = device.holder, plan_clip(HARDWARE)
    return default_layout, holder, clip, plan_mount(default_layout, holder, clip, HARDWARE)


@pytest.mark.slow
def test_a_wider_cable_window_widens_the_mount(planned: Planned) -> None:
    layout, holder, clip, mount = planned
    wide = HARDWARE.replaced(mount=HARDWARE.mount.replaced(cable_window_mm=(50.0, 10.0)))
    assert plan_mount(layout, holder, clip, wide).half_width_mm > max(mount.half_width_mm, 25.0 + 5.0 + 4.0)


@pytest.mark.slow
def test_roofs_in_oblique_skins_are_steeper_than_slicers_need(planned: Planned) -> None:
    """PrusaSlicer 2.5 added support under roofs of 42 deg in the head's skin, and none under roofs of 36 deg."""
    *_, plan = planned
    away = -plan.rig_from_head[:3, 2]
    through = HARDWARE.screw.clearance_hole_mm / 2.0
    holes = [
        cut
        for cut in plan.cuts
        if isinstance(cut, Bore) and cut.radius_mm == through and abs(cut.axis @ away) > 1.0 - 1e-9
    ]
    assert len(holes) >= 4
    assert all(hole.roof_deg <= 36.0 for hole in holes)


@pytest.mark.slow
@pytest.mark.parametrize("camera", ["c920", "board_38"])
def test_no_mark_of_the_scale_notches_the_ceiling_of_a_slot(fold_90_layout: Layout, camera: str) -> None:
    hardware = HARDWARE.replaced(camera=read_body(camera))
    clip, holder = plan_clip(hardware), plan_holder(fold_90_layout, hardware)
    mount = plan_mount(fold_90_layout, holder, clip, hardware)
    scale = _scale_marks(clip, mount.half_width_mm, hardware)
    radius, wall = hardware.screw.clearance_hole_mm / 2.0, hardware.printer.wall_mm
    top = max(clip.slide_z_mm) + clip.travel_mm + radius + wall
    longest = 0.0
    for mark in scale:
        corners = np.vstack([mark.base, mark.top])
        longest = max(longest, mount.half_width_mm - float(corners[:, 0].min()))
        assert corners[:, 2].min() > top or corners[:, 0].min() >= clip.slide_x_mm + radius + wall - 1e-9
    assert 5.0 < longest <= 7.21


@pytest.mark.parametrize(("along_deg", "off_mm", "blade"), [(30.2, 0.0, True), (30.2, 9.0, False), (42.0, 0.0, False)])
def test_no_web_is_parallel_to_a_screwdriver_hole(
    planned: Planned, along_deg: float, off_mm: float, *, blade: bool
) -> None:
    """PrusaSlicer 2.5 added support under a web's end at 30.2 deg to such a hole, and none at 44 deg and more."""
    _, holder, _, mount = planned
    away = holder.rig_from_mount[1:3, 2] / np.linalg.norm(holder.rig_from_mount[1:3, 2])
    beside = np.array([-away[1], away[0]])
    screws = transform(holder.rig_from_mount, np.column_stack([holder.holes_in_mount_mm, np.zeros(4)]))[:, 1:]
    middle = screws[np.argmax(screws @ beside)] + 10.0 * away + off_mm * beside
    turned = np.cos(np.radians(along_deg)) * away + np.sin(np.radians(along_deg)) * beside
    web = np.array([middle, middle + 5.0 * turned])
    webs = Webs(np.zeros((2, 2)), np.zeros((2, 2)), web[None])
    assert leaves_unprintable_web_ends(holder, webs, mount.section, HARDWARE) == blade


def test_the_mount_ends_where_no_screwdriver_hole_is_parallel_to_its_last_web() -> None:
    """If a mount ended in the middle of such a hole, PrusaSlicer 2.5 added support under the rest of the web."""
    holder, hardware = planned_on_screws(), with_screws()
    web, half_width = 1.2, 25.8
    away = holder.rig_from_mount[1:3, 2] / np.linalg.norm(holder.rig_from_mount[1:3, 2])
    up = np.array([away[1], -away[0]])
    end = head_end_mm(holder, half_width, web, hardware)
    screws = transform(holder.rig_from_mount, np.column_stack([holder.holes_in_mount_mm, np.zeros(4)]))[:, 1:] @ up
    head = max(float(head[1:] @ up) for head in holder.heads if abs(head[0]) < half_width)
    assert screws.max() < head <= end - web - DRIVER_HOLE_MM / 2.0 + 1e-9
    over = screws.max() + head_space_mm(hardware) + hardware.screw.insert_wall_mm
    assert over - web < head + DRIVER_HOLE_MM / 2.0
    assert head_end_mm(holder, 0.5, web, hardware) == pytest.approx(over)
    # A thick web meets the holes behind the holder's own screws.
    assert head_end_mm(holder, 0.5, 2.4, hardware) == pytest.approx(screws.max() + head_space_mm(hardware) + 2.4)
