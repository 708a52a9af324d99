"""The truss: its plastic in closed form."""

from __future__ import annotations

import numpy as np
import pytest
from shapely import LineString, Point

from mirrorcam.cad.assembly.device_plan import Device
from mirrorcam.cad.holder.holder_body import HolderPlan
from mirrorcam.cad.parts.clip import ClipPlan, plan_clip
from mirrorcam.cad.parts.foot import foot_plate_mm
from mirrorcam.cad.parts.mount import MountPlan, plan_mount, profiles
from mirrorcam.cad.parts.mount_openings import over_drivers_mm
from mirrorcam.cad.parts.truss import truss, webs_between
from mirrorcam.cad.plan.hardware import HARDWARE
from mirrorcam.cad.plan.prisms import volume_mm3
from mirrorcam.optics.geometry.layout import Layout

Planned = tuple[Layout, HolderPlan, ClipPlan, MountPlan]


@pytest.fixture(scope="module")
def planned(default_layout: Layout, device: Device) -> Planned:
    holder, clip = device.holder, plan_clip(HARDWARE)
    return default_layout, holder, clip, plan_mount(default_layout, holder, clip, HARDWARE)


def test_plastic_is_foreseen_as_the_pieces_have_it(planned: Planned) -> None:
    """Skins and webs along the middle, and the foot's plate: but for what bends and short panels add."""
    _, holder, clip, mount = planned
    for profile in profiles(holder, clip, HARDWARE):
        if profile.section.depth_mm > 2.0 * mount.section.depth_mm:
            continue
        skins, webs = truss(profile.inner, profile.outer, profile.section, HARDWARE)
        volume = sum(volume_mm3(piece) for piece in (*skins, *webs))
        assert profile.volume_mm3 == pytest.approx(volume, rel=0.15)


def test_no_web_over_the_slide_runs_into_the_holes_for_its_driver(planned: Planned) -> None:
    """In a deep mount, which leans back, the web from corner to corner once ended as a blade in the upper holes."""
    _, holder, clip, _ = planned
    highest = over_drivers_mm(clip, HARDWARE)
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
