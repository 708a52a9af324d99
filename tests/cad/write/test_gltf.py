"""The GLB, read back: metres and +Y up, every piece a node with what a page needs to know."""

from __future__ import annotations

import json
import struct
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from mirrorcam.cad.assembly.pieces import Piece, mesh_of
from mirrorcam.cad.plan.part_plan import BuiltPart
from mirrorcam.cad.plan.seats import mirror_prism
from mirrorcam.cad.write.gltf import GLTF_FROM_RIG, linear, write_glb
from mirrorcam.optics.geometry.layout import Layout
from tests.hostile_names import ACCEPTED


@pytest.fixture(scope="module")
def pieces(default_layout: Layout, built_block: BuiltPart) -> tuple[Piece, ...]:
    mirrors = tuple(
        Piece(
            name=f"mirror_0-{index}",
            kind="mirror",
            number=f"M0-{index}",
            title=f"Mirror 0-{index}",
            rgb=(0.8, 0.9, 1.0),
            explode_mm=30.0 * mirror.normal_in_rig,
            mesh=mesh_of(mirror_prism(mirror)),
            mass=built_block.mass,
        )
        for index, mirror in enumerate(default_layout.mirrors[:2])
    )
    block = Piece(
        name="block",
        kind="part",
        number="MC-99",
        title="Block",
        rgb=built_block.rgb,
        explode_mm=built_block.explode_mm,
        mesh=trimesh.load_mesh(built_block.stl),
        mass=built_block.mass,
    )
    return block, *mirrors


@pytest.fixture(scope="module")
def written(pieces: tuple[Piece, ...], tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("gltf") / "assembly.glb"
    write_glb(path, pieces)
    return path


def tree_of(path: Path) -> dict[str, Any]:
    data = path.read_bytes()
    magic, version, length, size, kind = struct.unpack("<4sIII4s", data[:20])
    assert (magic, version, length, kind) == (b"glTF", 2, len(data), b"JSON")
    return dict(json.loads(data[20 : 20 + size]))


def test_it_is_in_metres_with_y_up_and_looks_along_z(written: Path, pieces: tuple[Piece, ...]) -> None:
    scene = trimesh.load_scene(written)
    for piece in pieces:
        matrix, geometry = scene.graph[piece.name]
        found = trimesh.transform_points(scene.geometry[geometry].vertices, matrix)
        rig = piece.mesh.vertices
        # Up in the device is the rig's z, the scene is along its y; x follows for a right-handed frame.
        expected = np.column_stack([-rig[:, 0], rig[:, 2], rig[:, 1]]) / 1000.0
        np.testing.assert_allclose(found.min(axis=0), expected.min(axis=0), atol=1e-7)
        np.testing.assert_allclose(found.max(axis=0), expected.max(axis=0), atol=1e-7)
    assert np.linalg.det(GLTF_FROM_RIG[:3, :3]) == pytest.approx(1e-9)


def test_every_piece_is_a_node_below_the_device(written: Path, pieces: tuple[Piece, ...]) -> None:
    tree = tree_of(written)
    nodes = {node["name"]: node for node in tree["nodes"]}
    assert [tree["nodes"][index]["name"] for index in tree["scenes"][0]["nodes"]] == ["device"]
    assert [tree["nodes"][index]["name"] for index in nodes["device"]["children"]] == [p.name for p in pieces]
    np.testing.assert_allclose(np.array(nodes["device"]["matrix"]).reshape(4, 4).T, GLTF_FROM_RIG)
    for piece in pieces:
        extras = nodes[piece.name]["extras"]
        assert set(extras) == {"kind", "number", "title", "explode_mm"}
        assert (extras["kind"], extras["number"], extras["title"]) == (piece.kind, piece.number, piece.title)
        np.testing.assert_allclose(extras["explode_mm"], piece.explode_mm, atol=1e-4)
        assert "matrix" not in nodes[piece.name]


def test_a_reader_finds_any_title_as_it_is(pieces: tuple[Piece, ...], tmp_path: Path) -> None:
    titled = [replace(pieces[0], name=f"piece_{number}", title=title) for number, title in enumerate(ACCEPTED)]
    write_glb(tmp_path / "titles.glb", titled)
    found = {node["name"]: node.get("extras", {}).get("title") for node in tree_of(tmp_path / "titles.glb")["nodes"]}
    assert [found[piece.name] for piece in titled] == list(ACCEPTED)
    assert set(trimesh.load_scene(tmp_path / "titles.glb").graph.nodes_geometry) == {piece.name for piece in titled}


def test_mirrors_are_metal_and_colours_are_linear(written: Path, pieces: tuple[Piece, ...]) -> None:
    tree = tree_of(written)
    for piece in pieces:
        (node,) = (node for node in tree["nodes"] if node["name"] == piece.name)
        (primitive,) = tree["meshes"][node["mesh"]]["primitives"]
        finish = tree["materials"][primitive["material"]]["pbrMetallicRoughness"]
        assert (finish["metallicFactor"] == 1.0) == (piece.kind == "mirror")
        np.testing.assert_allclose(finish["baseColorFactor"], [*linear(np.array(piece.rgb)), 1.0], atol=1e-6)
    np.testing.assert_allclose(linear(np.array([0.0, 0.5, 1.0])), [0.0, 0.2140, 1.0], atol=1e-4)


def test_flat_faces_look_flat(written: Path) -> None:
    block = trimesh.load_scene(written).geometry["block"]
    # Three of six flat faces meet in each of eight corners: each corner is there once per face.
    assert len(block.vertices) == 24
    assert sorted({tuple(normal) for normal in np.round(block.vertex_normals).astype(int).tolist()}) == sorted(
        [(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)]
    )


def test_normals_are_units_even_where_a_facet_has_no_area(pieces: tuple[Piece, ...], tmp_path: Path) -> None:
    # A square of which one side is split by a point on it: one facet is a line.
    corners = np.array([[0.0, 0.0, 0.0], [9.0, 0.0, 0.0], [9.0, 9.0, 0.0], [0.0, 9.0, 0.0], [4.0, 0.0, 0.0]])
    mesh = trimesh.Trimesh(corners, [[0, 1, 2], [0, 2, 3], [0, 4, 1]], process=False)
    write_glb(tmp_path / "flat.glb", [replace(pieces[0], mesh=mesh)])
    found = trimesh.load_scene(tmp_path / "flat.glb", process=False).geometry["block"]
    assert len(found.faces) == 3
    np.testing.assert_allclose(np.linalg.norm(found.vertex_normals, axis=1), 1.0, atol=1e-6)


def test_bytes_say_what_they_are_for(written: Path) -> None:
    tree = tree_of(written)
    for mesh in tree["meshes"]:
        (primitive,) = mesh["primitives"]
        for accessor, target in ((primitive["indices"], 34963), (primitive["attributes"]["NORMAL"], 34962)):
            assert tree["bufferViews"][tree["accessors"][accessor]["bufferView"]]["target"] == target


def test_the_same_pieces_give_the_same_bytes_and_no_path(
    written: Path, pieces: tuple[Piece, ...], tmp_path: Path
) -> None:
    write_glb(tmp_path / "again.glb", pieces)
    assert (tmp_path / "again.glb").read_bytes() == written.read_bytes()
    assert str(tmp_path.parent.parent).encode() not in written.read_bytes()
    assert b"block.stl" not in written.read_bytes()
