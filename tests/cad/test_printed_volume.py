"""The plastic of a print: closed bodies in closed form, and a holder as PrusaSlicer prints it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from manifold3d import Manifold

from mirrorcam.cad.assembly.device_plan import Device
from mirrorcam.cad.checks.exported_mesh import read_3mf, solid_of
from mirrorcam.cad.plan.hardware import HARDWARE, PRINT_SETTINGS
from mirrorcam.cad.printed_volume import CLOSED_MM, printed_mm3
from mirrorcam.cad.write.slicer import find_slicer
from mirrorcam.core.values import Metric
from mirrorcam.optics.geometry.layout import Layout


def test_a_box_has_walls_and_floors_of_plastic_and_infill_inside() -> None:
    box = Manifold.cube((30.0, 20.0, 10.0))
    infill = (30.0 - 1.8) * (20.0 - 1.8) * (10.0 - 2.0 * CLOSED_MM)
    assert printed_mm3(box, 0.9) == pytest.approx(6000.0 - 0.9 * infill, rel=0.05)
    assert PRINT_SETTINGS.plastic_mm(10.0, 0.9) == pytest.approx(1.8 + 0.82)


def test_thin_walls_and_small_posts_are_solid() -> None:
    for size in ((30.0, 1.6, 10.0), (4.0, 4.0, 10.0), (30.0, 30.0, 2.0)):
        assert printed_mm3(Manifold.cube(size), 0.9) == pytest.approx(np.prod(size))
    assert PRINT_SETTINGS.plastic_mm(1.6, 0.9) == 1.6


@pytest.mark.slow
@pytest.mark.skipif(find_slicer() is None, reason="PrusaSlicer is not installed")
def test_the_holder_is_as_heavy_as_the_slicer_prints_it(
    device: Device, built_default: tuple[Layout, Path, dict[str, Metric]]
) -> None:
    sliced_g = built_default[2]["mirror_holder.print_g"].value
    grams = device.holder.printed_mm3 / 1000.0 * HARDWARE.printer.plastic_g_per_cm3
    assert grams == pytest.approx(sliced_g, rel=0.1)


@pytest.mark.slow
@pytest.mark.skipif(find_slicer() is None, reason="PrusaSlicer is not installed")
def test_a_device_is_as_heavy_as_the_slicer_prints_it(built_default: tuple[Layout, Path, dict[str, Metric]]) -> None:
    _, folder, checks = built_default
    sliced_g = sum(check.value for name, check in checks.items() if name.endswith(".print_g"))
    printer = HARDWARE.printer
    bodies = [solid_of(read_3mf(path)) for path in sorted((folder / "parts").glob("*.3mf"))]
    grams = sum(printed_mm3(body, printer.wall_mm) for body in bodies) / 1000.0 * printer.plastic_g_per_cm3
    assert len(bodies) >= 5
    assert grams == pytest.approx(sliced_g, rel=0.1)
