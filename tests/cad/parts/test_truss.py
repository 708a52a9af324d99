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
    FOOT_GRIP_MM,
    foot_plate_mm,
    foot_screws,
    foot_stack,
    foot_z_mm,
    truss,
    webs_between,
)
from mirrorcam.cad.plan.fasteners import stack
from mirrorcam.cad.plan.hardware import HARDWARE
from mirrorcam.cad.plan.prisms import volume_mm3
from mirrorcam.core.errors import InputError
from mirrorcam.optics.geometry.layout import Layout


def test_the_clip_at_its_lowest_leaves_the_window_for_the_cable_over_the_foots_plate() -> None:
    clip = plan_clip(HARDWARE)
    top_of_plate = foot_z_mm(clip, FOOT_DEPTH_MM, HARDWARE) + foot_plate_mm(FOOT_DEPTH_MM, HARDWARE)
    assert clip.bottom_mm - clip.travel_mm - top_of_plate > HARDWARE.mount.cable_window_mm[1]


@pytest.mark.parametrize("kind", ["insert", "nut"])
@pytest.mark.parametrize("grip_mm", [1.6, 5.5])
def test_the_screws_of_a_back_hold_in_the_threads_of_the_plate(kind: str, grip_mm: float) -> None:
    hardware = HARDWARE.replaced(screw=HARDWARE.screw.replaced(kind=kind))
    held = foot_stack(grip_mm, hardware)
    assert held.wall_mm == stack(FOOT_GRIP_MM, hardware).wall_mm <= foot_plate_mm(FOOT_DEPTH_MM, hardware)
    least = hardware.screw.engaged_mm if kind == "insert" else hardware.screw.nut_height_mm
    assert held.engaged_mm >= least - 1e-9
    # There is plastic under an insert, and the hollow of the truss over a nut.
    assert held.length_mm - grip_mm < (hardware.screw.insert_depth_mm if kind == "insert" else held.wall_mm + 1.0)


def test_screws_that_no_length_holds_are_refused() -> None:
    with pytest.raises(InputError, match=r"M3 screws through 40 mm engage 0\.0 mm of the thread"):
        foot_stack(40.0, HARDWARE)


def test_four_screws_enter_the_foots_lower_face_mirror_images_in_x() -> None:
    clip = plan_clip(HARDWARE)
    screws = foot_screws(clip, 30.0, HARDWARE)
    assert screws.shape == (4, 3)
    np.testing.assert_array_equal(screws[:, 2], np.full(4, foot_z_mm(clip, 30.0, HARDWARE)))
    assert {tuple(screw) for screw in screws} == {tuple(screw * [-1.0, 1.0, 1.0]) for screw in screws}
    assert (clip.slide_y_mm - screws[:, 1] > 0.0).all()
    assert (clip.slide_y_mm - screws[:, 1] < FOOT_DEPTH_MM).all()


def test_a_deep_mount_has_a_thick_plate_that_reaches_further_down() -> None:
    clip, depths = plan_clip(HARDWARE), (FOOT_DEPTH_MM, 45.0, 60.0)
    plates = [foot_plate_mm(depth, HARDWARE) for depth in depths]
    assert plates == pytest.approx([stack(FOOT_GRIP_MM, HARDWARE).wall_mm, 15.0, 20.0])
    tops = [foot_z_mm(clip, depth, HARDWARE) + plate for depth, plate in zip(depths, plates, strict=True)]
    assert tops == pytest.approx([tops[0]] * 3)


Planned = tuple[Layout, HolderPlan, ClipPlan, MountPlan]


@pytest.fixture(scope="module")
def planned(default_layout: Layout, device: Device) -> Planned:
    holder, clip = device.holder, plan_clip(HARDWARE)
    return default_layout, holder, clip, plan_mount(default_layout, holder, clip, HARDWARE)


@pytest.mark.slow
def test_the_predicted_volume_is_that_of_the_pieces(planned: Planned) -> None:
    """Skins and webs along the middle, and the foot's plate, apart from bends and short panels."""
    _, holder, clip, mount = planned
    for profile in profiles(holder, clip, HARDWARE):
        if profile.section.depth_mm > 2.0 * mount.section.depth_mm:
            continue
        skins, webs = truss(profile.inner, profile.outer, profile.section, HARDWARE)
        volume = sum(volume_mm3(piece) for piece in (*skins, *webs))
        assert profile.volume_mm3 == pytest.approx(volume, rel=0.15)


@pytest.mark.slow
def test_no_web_above_the_slide_enters_its_screwdriver_holes(planned: Planned) -> None:
    """In a deep mount, which leans back, the web from corner to corner formerly ended thin at the upper holes."""
    _, holder, clip, _ = planned
    highest = driver_holes_top_mm(clip, HARDWARE)
    depths = set()
    for profile in profiles(holder, clip, HARDWARE):
        corners = profile.inner[1, 1], profile.outer[1, 1]
        assert min(corners) - profile.section.web_mm / 2.0 > highest
        depths.add(profile.section.depth_mm)
    assert max(depths) == HARDWARE.mount.deepest_mm


def test_webs_run_from_skin_to_skin_and_begin_over_the_cables_window(planned: Planned) -> None:
    _, holder, clip, mount = planned
    profile = next(p for p in profiles(holder, clip, HARDWARE) if p.section == mount.section)
    lines = webs_between(profile.inner, profile.outer, profile.section, HARDWARE)
    skins = [LineString(line) for line in (lines.inner, lines.outer)]
    for web in lines.webs:
        ends = [min(skin.distance(Point(end)) for skin in skins) for end in web]
        assert max(ends) < 1e-9
        assert {int(np.argmin([skin.distance(Point(end)) for skin in skins])) for end in web} == {0, 1}
    window = foot_plate_mm(profile.section.depth_mm, HARDWARE) + HARDWARE.mount.cable_window_mm[1]
    assert lines.webs[..., 1].min() - profile.inner[0, 1] == pytest.approx(window + profile.section.web_mm / 2.0)
