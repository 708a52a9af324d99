"""Meshes by gmsh: the volume of the solid, the text format, and errors in one line."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from build123d import Box, Cylinder

from mirrorcam.cad.checks.elasticity import tetrahedra
from mirrorcam.cad.checks.elasticity.tetrahedra import gmsh_program, read_msh22, tetrahedra_of
from mirrorcam.cad.write.part_export import write_step
from mirrorcam.core.errors import InputError

MSH = """$MeshFormat
2.2 0 8
$EndMeshFormat
$Nodes
5
1 9 9 9
4 0 0 0
7 2 0 0
9 0 3 0
12 0 0 4
$EndNodes
$Elements
2
1 15 2 0 1 1
2 4 2 0 1 4 7 9 12
$EndElements
"""


def test_a_mesh_in_text_is_read_with_the_nodes_that_it_uses() -> None:
    mesh = read_msh22(MSH)
    assert mesh.points.shape == (4, 3)
    assert mesh.volume_mm3 == pytest.approx(2.0 * 3.0 * 4.0 / 6.0)


def test_a_solid_is_meshed_with_its_volume_in_mm(gmsh: str, tmp_path: Path) -> None:
    write_step(tmp_path / "part.step", Box(30.0, 20.0, 10.0) - Cylinder(4.0, 10.0))
    coarse, fine = (tetrahedra_of(tmp_path / "part.step", size) for size in (6.0, 3.0))
    assert len(fine.corners) > 1.5 * len(coarse.corners)
    assert fine.volume_mm3 == pytest.approx(6000.0 - np.pi * 160.0, rel=0.03)
    np.testing.assert_allclose(np.ptp(fine.points, axis=0), [30.0, 20.0, 10.0], atol=1e-6)
    again = tetrahedra_of(tmp_path / "part.step", 3.0)
    np.testing.assert_array_equal(again.points, fine.points)


def test_a_file_that_is_no_solid_is_refused(gmsh: str, tmp_path: Path) -> None:
    (tmp_path / "part.step").write_text("no solid")
    with pytest.raises(InputError, match=r"part\.step: gmsh could not mesh it"):
        tetrahedra_of(tmp_path / "part.step", 6.0)


def test_without_gmsh_the_extra_is_named(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(tetrahedra, "gmsh_program", lambda: None)
    with pytest.raises(InputError, match=r"gmsh is not installed.*mirrorcam\[fe\]"):
        tetrahedra_of(tmp_path / "part.step", 6.0)


def test_a_gmsh_that_does_not_start_counts_as_none(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """For example without a library of the system."""
    broken = tmp_path / "gmsh"
    broken.write_text("#!/bin/sh\nexit 127\n")
    broken.chmod(0o755)
    monkeypatch.setattr(shutil, "which", lambda *_, **__: str(broken))
    gmsh_program.cache_clear()
    try:
        assert gmsh_program() is None
    finally:
        gmsh_program.cache_clear()
