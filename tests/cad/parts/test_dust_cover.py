"""The dust cover: over everything on the holder, clear of the mount, held by the flange."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.cad.assembly.catalogue import parts_of
from mirrorcam.cad.assembly.device_plan import Device
from mirrorcam.cad.parts.dust_cover import CATCH_MM, CLEAR_MM, CoverPlan, plan_cover
from mirrorcam.cad.parts.part_solids import make_cover
from mirrorcam.cad.plan.hardware import HARDWARE
from mirrorcam.cad.plan.prisms import volume_mm3
from mirrorcam.cad.plan.seats import mirror_prism
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.transforms import inverse, transform


@pytest.fixture
def device(covered_device: Device) -> Device:
    return covered_device


@pytest.fixture
def cover(device: Device) -> CoverPlan:
    assert device.cover is not None
    return device.cover


def on_back(device: Device, points: FloatArray) -> FloatArray:
    return transform(inverse(device.holder.rig_from_mount), points)


def test_it_covers_mirrors_and_holder_with_space_over_the_highest(device: Device, cover: CoverPlan) -> None:
    fronts = np.vstack([mirror_prism(mirror).top for mirror in device.layout.mirrors])
    covered = np.vstack([fronts, device.holder.corners_in_rig])
    ceiling = on_back(device, cover.inner.base)[:, 2]
    assert np.ptp(ceiling) < 1e-9
    assert on_back(device, covered)[:, 2].min() - ceiling[0] == pytest.approx(CLEAR_MM)
    inside, offsets = cover.inner.half_spaces
    sides = np.abs(inside @ device.holder.rig_from_mount[:3, 2]) < 1e-6
    gaps = offsets[sides] - (device.holder.flange.base @ inside[sides].T).max(axis=0)
    np.testing.assert_allclose(gaps, HARDWARE.fit.slide_mm, atol=1e-6)


def test_its_walls_are_as_thick_as_a_wall(device: Device, cover: CoverPlan) -> None:
    """By volume: a hollow box minus its notches, plus two catches with a section of half a square."""
    solid = make_cover(cover)
    assert len(solid.solids()) == 1
    assert solid.is_valid
    base, top = (on_back(device, end)[0, 2] for end in (cover.outer.base, cover.outer.top))
    assert on_back(device, cover.inner.base)[0, 2] - base == pytest.approx(HARDWARE.printer.wall_mm)
    shell = volume_mm3(cover.outer) - volume_mm3(cover.inner) * (top - on_back(device, cover.inner.base)[0, 2]) / (
        on_back(device, cover.inner.top)[0, 2] - on_back(device, cover.inner.base)[0, 2]
    )
    missing = shell - solid.volume
    wide = 2.0 * (device.mount.half_width_mm + CLEAR_MM)
    # The wall is straight at the mount, and oblique over a part of the other side.
    notches = 2.0 * wide * HARDWARE.printer.wall_mm * (HARDWARE.holder.floor_mm + cover.rim_mm)
    catches = 2.0 * 12.0 * CATCH_MM**2
    assert notches - catches < missing < 1.05 * notches - catches


def test_its_catches_reach_behind_the_flange_beside_the_mount(device: Device, cover: CoverPlan) -> None:
    assert len(cover.catches) == 2
    for catch in cover.catches:
        corners = on_back(device, np.vstack([catch.base, catch.top]))
        assert np.abs(corners[:, 0]).min() > device.mount.half_width_mm
        assert -0.2 < corners[:, 2].min() < 0.0 < corners[:, 2].max() <= cover.rim_mm
        # It does not overlap the flange, and extends over its edge.
        normals, offsets = device.holder.flange.half_spaces
        assert (corners[:, 2] > 0.0).any()
        points = np.vstack([catch.base, catch.top])
        sides = np.abs(normals @ device.holder.rig_from_mount[:3, 2]) < 1e-6
        assert (points @ normals[sides].T - offsets[sides]).max(axis=1).min() < -0.2


def test_it_prints_on_its_front_and_comes_off_along_the_light(device: Device, cover: CoverPlan) -> None:
    (part,) = (part for part in parts_of(device) if part.name == "dust_cover")
    corners = transform(part.print_from_rig, np.vstack([cover.outer.base, cover.outer.top]))
    assert corners[:, 2].min() == pytest.approx(0.0, abs=1e-9)
    np.testing.assert_allclose(transform(part.print_from_rig, cover.outer.base)[:, 2], 0.0, atol=1e-9)
    first, second = cover.way_mm
    assert first @ device.holder.rig_from_mount[:3, 2] < -np.ptp(corners[:, 2]) + cover.rim_mm
    assert second @ device.layout.view_from_rig[2] > 0.0


def test_a_cover_larger_than_the_bed_is_omitted(default_layout: Layout, device: Device) -> None:
    small = HARDWARE.replaced(printer=HARDWARE.printer.replaced(bed_mm=(90.0, 90.0, 250.0)))
    assert plan_cover(default_layout, device.holder, device.mount, small) is None
