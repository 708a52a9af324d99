"""Meshes from files: the same surface from every format, and broken files refused in one line."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest

from mirrorcam.core.errors import InputError
from mirrorcam.render_scenes.mesh_shapes import Triangles, leaves, read_mesh
from mirrorcam.render_scenes.variant import SCALAR, use_variant

CORNERS = np.array([[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 3.0, 0.0], [0.0, 0.0, 4.0]])
FACES = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])


@pytest.fixture(scope="module", autouse=True)
def variant() -> None:
    use_variant(SCALAR)


def binary_stl() -> bytes:
    facets = [struct.pack("<12fH", 0.0, 0.0, 0.0, *CORNERS[face].ravel(), 0) for face in FACES]
    return b"binary".ljust(80) + struct.pack("<I", len(facets)) + b"".join(facets)


def ascii_stl() -> bytes:
    facets = "".join(
        "facet normal 0 0 0\nouter loop\n"
        + "".join(f"vertex {x} {y} {z:.3e}\n" for x, y, z in CORNERS[face])
        + "endloop\nendfacet\n"
        for face in FACES
    )
    return f"solid part\n{facets}endsolid part\n".encode()


def obj() -> bytes:
    points = "".join(f"v {x} {y} {z}\n" for x, y, z in CORNERS)
    return (points + "".join(f"f {a + 1} {b + 1} {c + 1}\n" for a, b, c in FACES)).encode()


def ply() -> bytes:
    head = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
    head += "element face 4\nproperty list uchar int vertex_indices\nend_header\n"
    points = "".join(f"{x} {y} {z}\n" for x, y, z in CORNERS)
    return (head + points + "".join(f"3 {a} {b} {c}\n" for a, b, c in FACES)).encode()


def volume(mesh: Triangles) -> float:
    a, b, c = (mesh.points[mesh.faces[:, k]] for k in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0)


@pytest.mark.parametrize(
    ("name", "content"),
    [("a.stl", binary_stl()), ("b.stl", ascii_stl()), ("c.OBJ", obj()), ("d.ply", ply())],
    ids=["binary STL", "ASCII STL", "OBJ", "PLY"],
)
def test_every_format_gives_the_same_closed_surface(tmp_path: Path, name: str, content: bytes) -> None:
    path = tmp_path / name
    path.write_bytes(content)
    mesh = read_mesh(path)
    assert mesh.faces.shape == (4, 3)
    assert volume(mesh) == pytest.approx(2.0 * 3.0 * 4.0 / 6.0)  # outward: positive
    assert np.array_equal(np.unique(mesh.points, axis=0), np.unique(CORNERS, axis=0))


@pytest.mark.parametrize(
    ("name", "content", "complaint"),
    [
        ("a.stl", binary_stl()[:-1], "not a valid STL, or a truncated one"),
        ("a.stl", ascii_stl()[:-20], "not a valid STL, or a truncated one"),
        ("a.stl", ascii_stl().replace(b"vertex 2.0", b"vertex two", 1), "not a valid STL: could not convert"),
        ("a.stl", ascii_stl().replace(b"vertex 2.0", b"corner 2.0", 1), "11 corners, expected three for each triangle"),
        ("a.stl", b"solid none\nendsolid none\n", "contains no triangle, expected a surface"),
        ("a.stl", ascii_stl().replace(b"vertex 2.0", b"vertex nan", 1), "contains a point that is not finite"),
        ("a.stl", b"", "not a valid STL, or a truncated one"),
        ("a.ply", ply()[:60], "not a valid PLY"),
        ("a.obj", b"v 0 0 0\nf 1 2 3\n", "not a valid OBJ"),
        ("a.step", b"ISO-10303-21;", "not a readable mesh, expected .stl, .ply, .obj"),
    ],
)
def test_broken_meshes_are_refused_in_one_line(tmp_path: Path, name: str, content: bytes, complaint: str) -> None:
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(InputError) as caught:
        read_mesh(path)
    assert complaint in str(caught.value)
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)


def test_a_mesh_that_is_not_there_is_said_so(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"gone\.ply: no such file$"):
        read_mesh(tmp_path / "gone.ply")


def test_leaves_fill_their_cube_and_follow_from_their_seed() -> None:
    one, again, other = leaves(40.0, 1), leaves(40.0, 1), leaves(40.0, 2)
    assert np.array_equal(one.points, again.points)
    assert not np.array_equal(one.points, other.points)
    assert np.ptp(one.points, axis=0).min() > 30.0
    assert np.abs(one.points).max() < 40.0
    assert one.faces.max() == len(one.points) - 1
    assert one.colours is not None
    assert one.colours.shape == one.points.shape
