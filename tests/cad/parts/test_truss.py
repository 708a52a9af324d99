"""The foot of the mount: below the clip's lowest position, thick enough for the screws in it.

The truss: its plastic in closed form.
"""

from __future__ import annotations

import numpy as np
import pytest
from shapely import LineString, Point

from mirrorcam.cad.assembly.device_plan import Device
from mirrorcam.cad.holder.holder_body import HolderPlan
from mirrorcam.cad.parts.clip import ClipPlan, plan_clip
from mirrorcam.cad.parts.mount import MountPlan, plan_mount, profiles
from mirrorcam.cad.parts.mount_openings import driver_holes_top_mm
from mirrorcam.cad.parts.truss import (
    FOOT_DEPTH_MM,
    foot_line,
    foot_of,
    foot_plate_mm,
    foot_stack,
    lean_of,
    truss,
    webs_between,
)
from mirrorcam.cad.plan.fasteners import head_space_mm
from mirrorcam.cad.plan.hardware import HARDWARE, PRINT_SETTINGS
from mirrorcam.cad.plan.prisms import volume_mm3
from mirrorcam.core.errors import InputError
from mirrorcam.optics.geometry.layout import Layout

LEANS_DEG = (-30.0, 0.0, 30.0, 60.0)


@pytest.mark.parametrize("lean", LEANS_DEG)
@pytest.mark.parametrize("depth_mm", [FOOT_DEPTH_MM, 45.0])
def test_plate_and_window_are_below_the_clip_and_the_screwdriver_holes(lean: float, depth_mm: float) -> None:
    clip = plan_clip(HARDWARE)
    line = foot_line(clip, depth_mm, lean, HARDWARE)
    assert lean_of(line) == pytest.approx(lean)
    assert line[:, 0] == pytest.approx([clip.slide_y_mm, clip.slide_y_mm - depth_mm])
    # Both skins are upright in the rig frame, and meet plate and window over a length that grows with the lean.
    above = (foot_plate_mm(depth_mm, HARDWARE) + HARDWARE.mount.cable_window_mm[1]) / np.cos(np.deg2rad(lean))
    assert line[0, 1] + above < clip.bottom_mm - clip.travel_mm
    drivers = min(clip.slide_z_mm) - clip.travel_mm - head_space_mm(HARDWARE)
    assert line[1, 1] + above <= drivers + 1e-9


@pytest.mark.parametrize("kind", ["insert", "nut"])
@pytest.mark.parametrize("grip_mm", [1.6, 5.5])
def test_the_screws_of_a_back_hold_in_the_threads_of_the_plate(kind: str, grip_mm: float) -> None:
    hardware = HARDWARE.replaced(screw=HARDWARE.screw.replaced(kind=kind), back=HARDWARE.back.replaced(grip_mm=grip_mm))
    held = foot_stack(hardware)
    assert held.wall_mm <= foot_plate_mm(FOOT_DEPTH_MM, hardware)
    least = hardware.screw.engaged_mm if kind == "insert" else hardware.screw.nut_height_mm
    assert held.engaged_mm >= least - 1e-9
    # There is plastic under an insert, and a nut at the end of its screw.
    tip_mm = held.length_mm - grip_mm - held.washer_mm
    assert tip_mm < (hardware.screw.insert_depth_mm if kind == "insert" else held.wall_mm + 1e-9)


def test_screws_that_no_length_holds_are_refused() -> None:
    with pytest.raises(InputError, match=r"M3 screws through 40 mm engage 0\.0 mm of the thread"):
        foot_stack(HARDWARE.replaced(back=HARDWARE.back.replaced(grip_mm=40.0)))


@pytest.mark.parametrize("lean", LEANS_DEG)
def test_four_screws_enter_the_foots_level_face_and_stay_inside_the_mount(lean: float) -> None:
    line = foot_line(plan_clip(HARDWARE), 34.0, lean, HARDWARE)
    foot = foot_of(line, 28.0, HARDWARE)
    assert foot is not None
    assert {tuple(screw) for screw in foot.screws} == {tuple(screw * [-1.0, 1.0, 1.0]) for screw in foot.screws}
    in_rig, plate = foot.screws_in_rig, foot_plate_mm(34.0, HARDWARE)
    # They are on the face between its ends, and normal to it they stay between the skins up to the plate's top.
    along = (line[1] - line[0]) / np.linalg.norm(line[1] - line[0])
    assert np.abs((in_rig[:, 1:] - line[0]) @ [-along[1], along[0]]).max() < 1e-9
    for end in (in_rig, in_rig + plate * foot.up_in_rig):
        assert (line[0, 0] - end[:, 1] > 2.0).all()
        assert (end[:, 1] - line[1, 0] > 2.0).all()
    # Level as the device stands.
    assert np.ptp(foot.screws[:, 2]) == 0.0
    np.testing.assert_allclose(foot.up_in_rig, [0.0, along[1], -along[0]], atol=1e-12)


def test_a_foot_without_room_for_its_screws_is_none() -> None:
    clip = plan_clip(HARDWARE)
    assert foot_of(foot_line(clip, FOOT_DEPTH_MM, 0.0, HARDWARE), 28.0, HARDWARE) is not None
    assert foot_of(foot_line(clip, FOOT_DEPTH_MM, 30.0, HARDWARE), 28.0, HARDWARE) is None


Planned = tuple[Layout, HolderPlan, ClipPlan, MountPlan]


@pytest.fixture(scope="module")
def planned(default_layout: Layout, device: Device) -> Planned:
    holder, clip = device.holder, plan_clip(HARDWARE)
    return default_layout, holder, clip, plan_mount(default_layout, holder, clip, HARDWARE)


@pytest.mark.slow
def test_the_predicted_volume_is_that_of_the_pieces(planned: Planned) -> None:
    """Skins and webs along the middle, webs across, and the foot's plate with infill, apart from short panels."""
    _, holder, clip, mount = planned
    for profile in profiles(holder, clip, 30.0, HARDWARE):
        if profile.section.depth_mm > 2.0 * mount.section.depth_mm:
            continue
        skins, webs = truss(profile.inner, profile.outer, profile.section, HARDWARE)
        thickness = foot_plate_mm(profile.section.depth_mm, HARDWARE)
        infill = 1.0 - PRINT_SETTINGS.plastic_mm(thickness, HARDWARE.printer.wall_mm) / thickness
        volume = sum(volume_mm3(piece) for piece in (*skins, *webs)) - infill * volume_mm3(skins[-1])
        assert profile.volume_mm3 == pytest.approx(volume, rel=0.15)


@pytest.mark.slow
def test_no_web_above_the_slide_enters_its_screwdriver_holes(planned: Planned) -> None:
    """In a deep mount, which leans back, the web from corner to corner formerly ended thin at the upper holes."""
    _, holder, clip, _ = planned
    highest = driver_holes_top_mm(clip, HARDWARE)
    depths = set()
    for profile in profiles(holder, clip, 30.0, HARDWARE):
        corners = profile.inner[1, 1], profile.outer[1, 1]
        assert min(corners) - profile.section.web_mm / 2.0 > highest
        depths.add(profile.section.depth_mm)
    assert max(depths) == HARDWARE.mount.deepest_mm


def test_webs_run_from_skin_to_skin_and_begin_over_the_cables_window(planned: Planned) -> None:
    _, holder, clip, mount = planned
    profile = next(p for p in profiles(holder, clip, 30.0, HARDWARE) if p.section == mount.section)
    lines = webs_between(profile.inner, profile.outer, profile.section, HARDWARE)
    skins = [LineString(line) for line in (lines.inner, lines.outer)]
    for web in lines.webs:
        ends = [min(skin.distance(Point(end)) for skin in skins) for end in web]
        assert max(ends) < 1e-9
        assert {int(np.argmin([skin.distance(Point(end)) for skin in skins])) for end in web} == {0, 1}
    window = foot_plate_mm(profile.section.depth_mm, HARDWARE) + HARDWARE.mount.cable_window_mm[1]
    heights = (lines.webs - profile.inner[0]) @ profile.foot.up_in_rig[1:]
    assert heights.min() == pytest.approx(window + profile.section.web_mm / 2.0)
