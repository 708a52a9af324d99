"""Solids of backs: every type of plan has a maker, which reproduces the part from the same numbers.

Common properties of all kinds of backs.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from mirrorcam.cad.assembly.device_plan import Device
from mirrorcam.cad.backs.blocks import BlocksPlan
from mirrorcam.cad.backs.plan_backs import MAKERS, make_blocks, plan_back
from mirrorcam.cad.build import build_parts
from mirrorcam.cad.plan.back_table import BACKS, back_of
from mirrorcam.cad.plan.hardware import HARDWARE
from mirrorcam.cad.plan.prisms import box
from mirrorcam.optics.geometry.layout import Layout


def test_blocks_are_joined_and_cut() -> None:
    pieces = (box((0.0, 0.0, 0.0), (10.0, 10.0, 10.0)), box((5.0, 0.0, 0.0), (20.0, 10.0, 10.0)))
    part = make_blocks(BlocksPlan("part", pieces, (box((2.0, 2.0, -1.0), (4.0, 4.0, 11.0)),)))
    assert part.label == "part"
    assert abs(part.volume - (2000.0 - 40.0)) < 1e-6


def test_every_plan_has_a_maker() -> None:
    assert {plan.__name__ for plan in MAKERS} == {"RingPlan", "BlocksPlan", "OwnPlan"}


@pytest.mark.parametrize("screws", ["insert", "nut"])
@pytest.mark.parametrize("kind", list(BACKS))
def test_every_kind_is_fastened_by_the_four_screws_of_the_foot(kind: str, screws: str, device: Device) -> None:
    hardware = device.hardware.replaced(
        back=back_of(kind),
        screw=device.hardware.screw.replaced(kind=screws),
    )
    back = plan_back(device.clip, device.mount, hardware)
    assert back.kind == kind
    foot = device.mount.foot
    np.testing.assert_allclose(back.foot_heads + back.foot.grip_mm * foot.up_in_rig, foot.screws_in_rig, atol=1e-9)
    assert back.critical_sections
    names = [part.name for part in back.parts]
    assert len(set(names)) == len(names)
    assert all(
        re.fullmatch(r"adapter_[a-z]+", name) and type(part.plan.plan) in MAKERS
        for name, part in zip(names, back.parts, strict=True)
    )
    for joint in back.joints:
        assert set(joint.joins) <= {*names, "mount"}
        assert len(joint.nut_exits_mm) == len(joint.heads)
    for item in back.items:
        assert set(item.joins) <= set(names)


def test_only_backs_for_arms_have_a_robot_link(device: Device) -> None:
    arms = set()
    for kind in BACKS:
        back = plan_back(device.clip, device.mount, device.hardware.replaced(back=back_of(kind)))
        if back.robot is not None:
            arms.add(kind)
    assert arms == {"iso9409", "gen3", "gen2"}


@pytest.mark.slow
@pytest.mark.parametrize("kind", list(BACKS))
def test_every_back_of_the_default_device_is_built_and_passes(
    kind: str, default_layout: Layout, tmp_path: Path
) -> None:
    checks = build_parts(default_layout, tmp_path, HARDWARE.replaced(back=back_of(kind)), workers=2)
    assert {name: check for name, check in checks.items() if not check.passed} == {}
    assert (tmp_path / "robot").exists() == (kind in ("iso9409", "gen3", "gen2"))
    guide = (tmp_path / "guide.md").read_text(encoding="utf-8")
    if kind not in ("gen2", "gen3"):
        assert "Kinova" not in guide
