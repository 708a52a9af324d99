"""The truss: its plastic in closed form."""

from __future__ import annotations

import pytest

from mirrorcam.cad.assembly.device_plan import Device
from mirrorcam.cad.holder.holder_body import HolderPlan
from mirrorcam.cad.parts.clip import ClipPlan, plan_clip
from mirrorcam.cad.parts.mount import MountPlan, plan_mount, stiff_profiles
from mirrorcam.cad.parts.truss import truss
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
    for profile in stiff_profiles(holder, clip, mount.load_g, mount.load_at, HARDWARE):
        skins, webs = truss(profile.inner, profile.outer, profile.section, HARDWARE)
        volume = sum(volume_mm3(piece) for piece in (*skins, *webs))
        assert profile.volume_mm3 == pytest.approx(volume, rel=0.15)
