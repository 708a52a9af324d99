"""Meshes read back from files, and the errors found in them."""

from __future__ import annotations

from pathlib import Path
from zipfile import ZipFile

import numpy as np
import pytest
import trimesh

from mirrorcam.cad.checks.exported_mesh import MODEL_3MF, check_mesh, is_manifold, read_3mf, read_stl, solid_of
from mirrorcam.cad.plan.hardware import HARDWARE
from mirrorcam.cad.plan.part_plan import BuiltPart, PartPlan
from mirrorcam.cad.write.threemf import write_3mf
from mirrorcam.core.values import Metric


def failed(checks: dict[str, Metric]) -> set[str]:
    return {name for name, check in checks.items() if not check.passed}


def checked(mesh: trimesh.Trimesh) -> dict[str, Metric]:
    return check_mesh(mesh, solid_of(mesh))


def package(path: Path, *, unit: str = "millimeter", item: str = "", body: str | None = None) -> Path:
    """A 3MF file of one tetrahedron with an edge of 1 along every axis."""
    vertices = "".join(f'<vertex x="{x}" y="{y}" z="{z}"/>' for x, y, z in ((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)))
    faces = ((0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 3, 2))
    triangles = "".join(f'<triangle v1="{a}" v2="{b}" v3="{c}"/>' for a, b, c in faces)
    mesh = f"<mesh><vertices>{vertices}</vertices><triangles>{triangles}</triangles></mesh>"
    model = (
        f'<model unit="{unit}" xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02"><resources>'
        f'<object id="1" type="model">{mesh if body is None else body}</object></resources>'
        f"<build>{item}</build></model>"
    )
    with ZipFile(path, "w") as archive:
        archive.writestr(MODEL_3MF, model)
    return path


def test_a_3mf_file_holds_the_mesh_of_the_stl_file_as_it_prints(
    block: PartPlan, built_block: BuiltPart, tmp_path: Path
) -> None:
    path = tmp_path / "block.3mf"
    write_3mf(path, built_block.stl, block, HARDWARE.printer)
    printed, drawn = read_3mf(path), read_stl(built_block.stl)
    assert printed.volume == pytest.approx(drawn.volume)
    np.testing.assert_allclose(printed.extents, (60.0, 10.0, 30.0), atol=1e-5)
    np.testing.assert_allclose(printed.bounds.mean(axis=0), (110.0, 110.0, 15.0), atol=1e-5)
    assert failed(checked(printed)) == set()


def test_every_build_item_is_read_in_its_place(tmp_path: Path) -> None:
    """The matrix is for row vectors: a quarter turn about z takes x to y, then the object moves by (10, 20, 30)."""
    turned = '<item objectid="1" transform="0 1 0 -1 0 0 0 0 1 10 20 30"/>'
    mesh = read_3mf(package(tmp_path / "two.3mf", item=f'<item objectid="1"/>{turned}'))
    assert len(mesh.faces) == 8
    np.testing.assert_allclose(mesh.vertices[5], (10.0, 21.0, 30.0))
    assert checked(mesh)["mesh_pieces"].value == 2


def test_3mf_content_that_is_never_written_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="unit inch, expected millimeter"):
        read_3mf(package(tmp_path / "inch.3mf", unit="inch"))
    with pytest.raises(ValueError, match="object 1 has no mesh of its own"):
        read_3mf(package(tmp_path / "parts.3mf", item='<item objectid="1"/>', body="<components/>"))


def test_a_hole_a_second_piece_and_an_inside_out_mesh_are_found(built_block: BuiltPart) -> None:
    sound = read_stl(built_block.stl)
    assert failed(checked(sound)) == set()
    open_mesh = sound.copy()
    open_mesh.update_faces(np.arange(len(sound.faces)) != 7)
    assert failed(checked(open_mesh)) == {"mesh_watertight", "mesh_manifold"}
    assert not is_manifold(solid_of(open_mesh))
    beside = sound.copy()
    beside.apply_translation((100.0, 0.0, 0.0))
    both = trimesh.Trimesh(
        np.concatenate([sound.vertices, beside.vertices]), np.concatenate([sound.faces, beside.faces + 8])
    )
    assert failed(checked(both)) == {"mesh_pieces"}
    inside_out = sound.copy()
    inside_out.invert()
    assert "mesh_watertight" in failed(checked(inside_out))
