"""Fixtures of the finite element tests: small solids, and skips without the extra `fe`."""

from __future__ import annotations

from importlib.util import find_spec

import numpy as np
import pytest

from mirrorcam.cad.checks.elasticity.device_motions import DeviceMotions
from mirrorcam.cad.checks.elasticity.tetrahedra import Tetrahedra, gmsh_program
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.layout import Layout


@pytest.fixture
def gmsh() -> str:
    """The program gmsh; skips the test if it is not installed."""
    program = gmsh_program()
    if program is None:
        pytest.skip("gmsh is not installed (extra fe), or does not start")
    return program


@pytest.fixture
def bar() -> Tetrahedra:
    """A bar of 60 x 6 x 6 mm along x from the origin; skips the test if scikit-fem is not installed."""
    if find_spec("skfem") is None:
        pytest.skip("scikit-fem is not installed (extra fe)")
    from skfem import MeshTet

    mesh = MeshTet.init_tensor(np.linspace(0.0, 60.0, 13), np.linspace(0.0, 6.0, 3), np.linspace(0.0, 6.0, 3))
    return Tetrahedra(np.array(mesh.p.T), np.array(mesh.t.T, dtype=np.int64))


def _same(layout: Layout, motion: FloatArray) -> dict[str, FloatArray]:
    return dict.fromkeys(layout.mirror_names, motion)


@pytest.fixture
def turning(default_layout: Layout) -> DeviceMotions:
    """A device with mirrors that rotate about x through the pupil by 1 mrad under gravity along z (1000 MPa, 1 g/cm3).

    Half of the rotation is due to the weight of the plastic. Warmth moves the mirrors apart by their strain.
    """
    weight, strain, still = {}, {}, np.zeros(6)
    for name, mirror in zip(default_layout.mirror_names, default_layout.mirrors, strict=True):
        middle, turn = mirror.rig_from_plane[:3, 3], np.array([0.5, 0.0, 0.0])
        motion = np.zeros((6, 3))
        motion[:3, 2], motion[3:, 2] = np.cross(turn, middle), turn
        weight[name], strain[name] = motion, np.concatenate([middle, np.zeros(3)])
    return DeviceMotions(weight, weight, strain, _same(default_layout, still), _same(default_layout, still), 7e-5)
