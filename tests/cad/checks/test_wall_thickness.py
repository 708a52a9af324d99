"""The thinnest wall of shapes whose walls are known."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from mirrorcam.cad.checks.exported_mesh import solid_of
from mirrorcam.cad.checks.wall_thickness import THICK_MM, thinnest_floor_mm, thinnest_wall_mm
from mirrorcam.optics.geometry.transforms import rigid


def wall_mm(mesh: trimesh.Trimesh) -> float:
    return thinnest_wall_mm(mesh, solid_of(mesh))


@given(st.floats(0.3, 6.0), st.floats(8.0, 40.0), st.floats(8.0, 40.0), st.integers(0, 2**32 - 1))
def test_a_plate_is_as_thick_as_it_is_however_it_lies(thickness: float, width: float, length: float, seed: int) -> None:
    mesh = trimesh.creation.box((width, length, thickness))
    mesh.apply_transform(rigid(Rotation.random(random_state=seed % 2**31).as_matrix(), np.zeros(3)))
    assert wall_mm(mesh) == pytest.approx(thickness, abs=1e-6)


def test_the_sharp_edge_of_a_wedge_is_no_wall() -> None:
    corners = [(0, 0, 0), (20, 0, 0), (0, 20, 0), (0, 0, 11), (20, 0, 11), (0, 20, 11)]
    assert wall_mm(trimesh.convex.convex_hull(np.array(corners, dtype=np.float64))) == pytest.approx(11.0, abs=1e-6)


def test_a_tube_is_as_thick_as_its_wall() -> None:
    """Facets of n sides bring inner and outer wall nearer by at most the outer one's sagitta r (1 - cos(pi / n))."""
    inner, outer, sides = 31.5, 32.6, 90
    tube = trimesh.creation.annulus(inner, outer, 8.0, sections=sides)
    assert outer - inner - outer * (1.0 - np.cos(np.pi / sides)) - 1e-6 <= wall_mm(tube) <= outer - inner + 1e-6


@pytest.mark.parametrize(("fin_mm", "found"), [(0.9, True), (0.4, True), (2.0, False)])
def test_a_fin_on_a_block_is_found_by_its_thickness(fin_mm: float, found: bool) -> None:
    block = solid_of(trimesh.creation.box((30.0, 20.0, 4.0)))
    fin = solid_of(trimesh.creation.box((10.0, fin_mm, 8.0)))
    both = (block + fin.translate((0.0, 0.0, 5.0))).to_mesh64()
    mesh = trimesh.Trimesh(np.array(both.vert_properties)[:, :3], np.array(both.tri_verts))
    assert wall_mm(mesh) == pytest.approx(fin_mm, abs=1e-6)
    assert (wall_mm(mesh) < 1.2) == found


def test_a_wall_smaller_than_a_dot_is_not_taken_for_one() -> None:
    """A crumb of 0.3 x 0.3 mm on a block, 0.3 mm high: its four sides see each other, over 0.36 mm2 in all."""
    block = solid_of(trimesh.creation.box((10.0, 10.0, 4.0)))
    crumb = solid_of(trimesh.creation.box((0.3, 0.3, 0.5)))
    both = (block + crumb.translate((0.0, 0.0, 2.05))).to_mesh64()
    mesh = trimesh.Trimesh(np.array(both.vert_properties)[:, :3], np.array(both.tri_verts))
    assert wall_mm(mesh) > 3.9


def test_a_floor_is_told_from_a_wall_by_the_way_that_it_prints() -> None:
    """An open box with a floor of 0.6 mm and walls of 2 mm, and a plate that is level, upright or neither."""
    outer, inner = (
        solid_of(trimesh.creation.box((30.0, 20.0, 10.0))),
        solid_of(trimesh.creation.box((26.0, 16.0, 10.0))),
    )
    both = (outer - inner.translate((0.0, 0.0, 0.6))).to_mesh64()
    tray = trimesh.Trimesh(np.array(both.vert_properties)[:, :3], np.array(both.tri_verts))
    up, along = np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0])
    assert thinnest_floor_mm(tray, solid_of(tray), up) == pytest.approx(0.6, abs=1e-6)
    assert thinnest_wall_mm(tray, solid_of(tray), up) == pytest.approx(2.0, abs=1e-6)
    # Printed on its end, the floor is a wall.
    assert thinnest_wall_mm(tray, solid_of(tray), along) == pytest.approx(0.6, abs=1e-6)
    ball = trimesh.creation.icosphere(radius=20.0)
    assert thinnest_floor_mm(ball, solid_of(ball), up) == THICK_MM
