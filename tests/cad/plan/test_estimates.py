"""Estimates of a device from its layout: against a build, by their laws, and without the CAD kernel."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from benchmarks.device_estimates import BuiltDevice, read_devices
from mirrorcam.cad.plan.estimates import DeviceMeasures, estimate_device
from mirrorcam.cad.plan.hardware import HARDWARE, MIRROR_DENSITIES
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror_gaps import area_mm2

ALLOWED = 3.0
"""Error of an estimate in units of its standard deviation."""


@pytest.fixture(scope="module")
def built(default_layout: Layout) -> BuiltDevice:
    """The default device as built."""
    return next(device for device in read_devices().values() if device.layout == default_layout.identity)


def scaled(layout: Layout, factor: float) -> Layout:
    """A layout with all mirrors farther from the pupil by a factor, of the same thickness."""
    mirrors = [
        mirror.replaced(
            virtual_centre_in_rig_mm=factor * mirror.virtual_centre_in_rig_mm,
            outline_in_rig_mm=factor * mirror.outline_in_rig_mm,
        )
        for mirror in layout.mirrors
    ]
    return layout.replaced(mirrors=tuple(mirrors))


def test_estimates_agree_with_a_build_within_their_errors(default_layout: Layout, built: BuiltDevice) -> None:
    found = estimate_device(default_layout)
    assert max(found.size_mm) == pytest.approx(max(built.size_mm), abs=ALLOWED * found.size_error_mm)
    assert found.mass_g == pytest.approx(built.mass_g, abs=ALLOWED * found.mass_error_g)
    assert found.plastic_g == pytest.approx(built.plastic_g, abs=ALLOWED * found.plastic_error_g)
    assert found.print_h == pytest.approx(built.print_h, abs=ALLOWED * found.print_error_h)
    assert found.price_eur == pytest.approx(built.price_eur, abs=ALLOWED * found.price_error_eur)
    assert found.camera_eur == HARDWARE.prices.of_item("Logitech C920")


def test_a_larger_device_costs_more_of_everything(default_layout: Layout) -> None:
    estimates = [estimate_device(scaled(default_layout, factor)) for factor in (0.8, 1.0, 1.3)]
    for name in ("mass_g", "plastic_g", "print_h", "price_eur"):
        values = [getattr(estimate, name) for estimate in estimates]
        assert values == sorted(values)
    heights, depths = ([estimate.size_mm[axis] for estimate in estimates] for axis in (1, 2))
    assert heights == sorted(heights)
    assert depths == sorted(depths)


def test_the_size_covers_mirrors_and_camera(default_layout: Layout) -> None:
    measures = DeviceMeasures(default_layout, HARDWARE.for_layout(default_layout))
    mirrors_low, mirrors_high, camera_low, camera_high = measures.extremes_mm
    width, height, depth = measures.size_mm
    extent = np.maximum(mirrors_high, camera_high) - np.minimum(mirrors_low, camera_low)
    assert ([width, depth, height] > extent).all()


def test_mirrors_weigh_their_volume_and_cost_their_sheet(default_layout: Layout) -> None:
    measures = DeviceMeasures(default_layout, HARDWARE.for_layout(default_layout))
    mirrors_cm3 = sum(area_mm2(mirror) * mirror.thickness_mm / 1000.0 for mirror in default_layout.mirrors)
    assert measures.mirrors_g == pytest.approx(MIRROR_DENSITIES["glass"] * mirrors_cm3)
    dear = HARDWARE.replaced(prices=HARDWARE.prices.replaced(mirror_per_100_cm2={"first-surface glass mirror": 10.0}))
    change = DeviceMeasures(default_layout, dear.for_layout(default_layout)).mirrors_eur - measures.mirrors_eur
    assert change == pytest.approx((10.0 - 8.0) * 6.0)


def test_the_body_of_the_layouts_camera_is_taken_unless_one_is_given(default_layout: Layout) -> None:
    body = HARDWARE.camera.replaced(mass_g=HARDWARE.camera.mass_g + 50.0)
    heavier = estimate_device(default_layout, HARDWARE.replaced(camera=body))
    assert heavier.mass_g == pytest.approx(estimate_device(default_layout).mass_g + 50.0)


def test_it_takes_no_cad_kernel() -> None:
    code = "import sys, mirrorcam.cad.plan.estimates; print({'build123d', 'manifold3d', 'trimesh'} & set(sys.modules))"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "set()\n"
