"""What the camera sees at the steps that take pictures: all of the board, and later every mirror."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import manifold3d
import pytest

from mirrorcam.cad.assembly.build_steps import STEPS, Step
from mirrorcam.cad.assembly.catalogue import bought_items
from mirrorcam.cad.assembly.device_plan import Device
from mirrorcam.cad.checks.device_checks import ASSEMBLY, read_glb
from mirrorcam.cad.checks.exported_mesh import solid_of
from mirrorcam.cad.checks.step_views import check_step_views
from mirrorcam.core.values import Metric
from mirrorcam.optics.geometry.layout import Layout

BASE, FRAMES = "device.base_pictures_hidden", "device.frames_pictures_hidden"
Built = tuple[Layout, Path, dict[str, Metric]]
Solids = dict[str, manifold3d.Manifold]


@pytest.fixture(scope="module")
def solids(built_default: Built) -> Solids:
    return {name: solid_of(mesh) for name, mesh in read_glb(built_default[1] / ASSEMBLY).items()}


def hidden(device: Device, solids: Solids, steps: tuple[Step, ...] = STEPS) -> dict[str, float]:
    checks = check_step_views(device.layout, bought_items(device), solids, steps)
    assert all(check.limit == 0.0 for check in checks.values())
    return {name: check.value for name, check in checks.items()}


def test_the_guide_takes_its_pictures_when_the_view_is_free(device: Device, solids: Solids) -> None:
    assert hidden(device, solids) == {BASE: 0.0, FRAMES: 0.0}


def test_the_bare_mount_hides_the_board(device: Device, solids: Solids) -> None:
    """The order of an older guide: at its last step the holder came off, and the clip stayed on the mount."""
    kept = [replace(step, pictures="") for step in STEPS if step.name not in ("mirrors", "holder", "calibrate")]
    share = hidden(device, solids, (*kept, Step("calibrate", pictures="base")))[BASE]
    assert share == pytest.approx(0.417, abs=0.03)


def test_a_piece_before_a_mirror_and_a_missing_mirror_hide_its_part_of_the_frame(
    device: Device, solids: Solids
) -> None:
    name, mirror = device.layout.mirror_names[4], device.layout.mirrors[4]
    missing = {key: solid for key, solid in solids.items() if key != f"mirror_{name}"}
    without = hidden(device, missing)[FRAMES]
    assert 0.03 < without < 0.2
    between = mirror.outline_in_rig_mm.mean(axis=0) / 2.0
    block = manifold3d.Manifold.cube((2.0, 2.0, 2.0), center=True).translate(tuple(between))
    stray = hidden(device, solids | {"mount_2": block})
    assert 0.0 < stray[FRAMES] < without
    assert stray[BASE] == 0.0
