"""Devices larger than the bed, from layout to files."""

from __future__ import annotations

from pathlib import Path

import pytest

from mirrorcam.cad.build import build_parts
from mirrorcam.cad.plan.hardware import HARDWARE
from mirrorcam.optics.design.optimise import design
from mirrorcam.optics.geometry.design_spec import DesignSpec


@pytest.mark.slow
def test_a_device_in_pieces_passes_every_check(tmp_path: Path) -> None:
    """3 x 3 at scale 140 mm and a fold of 90 degrees: holder and mount are cut in two, each joined by two pins."""
    hardware = HARDWARE.replaced(printer=HARDWARE.printer.replaced(bed_mm=(170.0, 170.0, 250.0)))
    checks = build_parts(design(DesignSpec(scale_mm=140.0, fold_deg=90.0)), tmp_path, hardware, workers=2)
    assert {name for name, check in checks.items() if not check.passed} == set()
    assert {path.stem for path in (tmp_path / "parts").glob("*_[0-9].step")} == {
        "mirror_holder_1",
        "mirror_holder_2",
        "mount_1",
        "mount_2",
    }
