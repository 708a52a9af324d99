"""The whole device by finite elements: against laws of statics, and the mount's stated tilt."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.cad.assembly.device_plan import Device
from mirrorcam.cad.elasticity.device_motions import DeviceMotions, device_motions
from mirrorcam.optics.geometry.layout import Layout


def test_motions_of_a_plastic_are_sums_of_parts(default_layout: Layout, turning: DeviceMotions) -> None:
    name = default_layout.mirror_names[0]
    gravity = turning.under_gravity(2000.0, 3.0)[name]
    np.testing.assert_allclose(gravity, (3.0 + 1.0) / 2000.0 * turning.plastic_weight[name])
    strain = turning.of_strain(2e-3, 5.0)[name]
    np.testing.assert_allclose(strain, 2e-3 * turning.plastic_strain[name])


@pytest.fixture(scope="module")
def solved(device: Device) -> DeviceMotions:
    pytest.importorskip("skfem", reason="scikit-fem is not installed (extra fe)")
    return device_motions(device, 8.0)


@pytest.mark.slow
def test_where_all_expands_alike_the_device_only_grows(device: Device, solved: DeviceMotions, gmsh: str) -> None:
    """But for the screws, whose discs keep their size: mirrors move off the camera by the strain, and hardly turn."""
    for name, mirror in zip(device.layout.mirror_names, device.layout.mirrors, strict=True):
        motion = solved.of_strain(1e-3, 1e-3)[name]
        middle = mirror.rig_from_plane[:3, 3]
        assert np.linalg.norm(motion[:3] - 1e-3 * middle) < 0.2 * np.linalg.norm(1e-3 * middle)
        assert np.linalg.norm(motion[3:]) < 1e-4


@pytest.mark.slow
def test_mirrors_turn_nearly_as_one_body(solved: DeviceMotions, gmsh: str) -> None:
    turns = np.array([motion[3:] for motion in solved.under_gravity(2300.0, 1.24).values()])
    assert np.degrees(np.linalg.norm(turns, axis=(1, 2)).max()) < 0.3
    assert np.abs(turns - turns.mean(axis=0)).max() < 0.1 * np.abs(turns).max()
