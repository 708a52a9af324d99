"""Errors in degrees and pixels of motions that are known, and the robot's table of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mirrorcam.cad.checks.elasticity.device_motions import DeviceMotions
from mirrorcam.cad.checks.elasticity.errors import LEFT_BY_TABLE, WARMER_K, errors_of, gravity_table
from mirrorcam.cad.checks.elasticity.plastics import PLASTICS, Plastic
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.layout_in_pose import layout_in_pose

PLAIN = Plastic("plain", 1000.0, 1.0, 50e-6, 60.0, 0.5, 0.0, "of this test")


def test_a_turn_of_all_mirrors_moves_all_images_alike(default_layout: Layout, turning: DeviceMotions) -> None:
    errors = errors_of(default_layout, turning, 500.0, PLAIN)
    assert errors.gravity.deg == pytest.approx(np.degrees(1e-3))
    # Mirrors double a turn; at the edges of the picture the tangent is longer.
    straight = 2e-3 * default_layout.camera.fy_px
    assert 0.8 * straight < errors.gravity.px < 1.8 * straight
    assert errors.gravity.apart_px < 0.02 * errors.gravity.px
    assert errors.creep == errors.gravity.times(0.5)
    assert errors.corrected == errors.gravity.times(LEFT_BY_TABLE)


def test_modulus_and_density_act_as_in_closed_form(default_layout: Layout, turning: DeviceMotions) -> None:
    plain, dense, stiff = (
        errors_of(default_layout, turning, 500.0, plastic)
        for plastic in (PLAIN, replace(PLAIN, density_g_per_cm3=3.0), replace(PLAIN, modulus_mpa=4000.0))
    )
    assert dense.gravity.deg == pytest.approx(2.0 * plain.gravity.deg)
    assert stiff.gravity.deg == pytest.approx(plain.gravity.deg / 4.0)
    assert stiff.warmth == plain.warmth


def test_warmth_scales_the_device_and_turns_nothing(default_layout: Layout, turning: DeviceMotions) -> None:
    """A point seen at a depth moves as if it were nearer by the strain, of which the parallax tells."""
    warmth = errors_of(default_layout, turning, 500.0, PLAIN).warmth
    assert warmth.deg == 0.0
    centres = default_layout.virtual_centres_in_rig_mm
    farthest = np.linalg.norm(centres, axis=1).max()
    assert 0.0 < warmth.px < 3.0 * WARMER_K * 50e-6 * farthest / 400.0 * default_layout.camera.fx_px


def test_the_robots_table_moves_a_layout_as_the_motions_say(default_layout: Layout, turning: DeviceMotions) -> None:
    table = gravity_table(default_layout, turning, PLASTICS[0])
    gravity = np.array([0.1, -0.3, 0.9])
    bent = layout_in_pose(default_layout, table, gravity)
    for name, before, after in zip(default_layout.mirror_names, default_layout.mirrors, bent.mirrors, strict=True):
        moved = after.virtual_centre_in_rig_mm - before.virtual_centre_in_rig_mm
        np.testing.assert_allclose(moved, table.mirrors[name].plane_mm @ gravity, atol=2e-4)
        assert np.linalg.norm(moved) > 1e-2
