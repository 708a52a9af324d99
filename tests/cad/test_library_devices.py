"""The device of every camera of the library is built with all its files, and passes every check."""

from __future__ import annotations

from pathlib import Path

import pytest

from mirrorcam.cad.build import build_parts
from mirrorcam.cad.plan.back_table import back_of
from mirrorcam.cad.plan.hardware import HARDWARE
from mirrorcam.optics.design.optimise import design
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.camera_library import camera_names, read_profile
from mirrorcam.optics.geometry.design_spec import DesignSpec


@pytest.mark.slow
@pytest.mark.parametrize("name", camera_names())
def test_every_camera_of_the_library_gets_a_device_that_passes_every_check(name: str, tmp_path: Path) -> None:
    profile = read_profile(name)
    camera = profile.camera if profile.optics else Camera.c920()  # a board takes any lens
    hardware = HARDWARE.replaced(camera=profile.body, back=back_of("none"))
    checks = build_parts(design(DesignSpec(camera=camera, rows=2, cols=2)), tmp_path / "device", hardware)
    assert {key: metric for key, metric in checks.items() if not metric.passed} == {}
    assert checks["camera_clip.light_gap_mm"].value > 0.0
