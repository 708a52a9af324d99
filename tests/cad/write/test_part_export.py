"""Files of a part, read back, and what it weighs, against closed forms."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh
from build123d import Box, Cylinder, Location, import_step

from mirrorcam.cad.plan.part_plan import BuiltPart, PartPlan
from mirrorcam.cad.write.part_export import STL_TOLERANCE_MM, mass_properties, write_step, write_stl
from mirrorcam.core.values import InputError


def test_a_box_weighs_what_the_formula_says(block: PartPlan, built_block: BuiltPart) -> None:
    width, length, height = 60.0, 30.0, 10.0
    mass = width * length * height * 1.24e-3
    found = built_block.mass
    assert found.volume_mm3 == pytest.approx(width * length * height, rel=1e-12)
    assert found.mass_g == pytest.approx(mass, rel=1e-12)
    np.testing.assert_allclose(found.centre_in_rig_mm, [31.0, 17.0, 8.0], atol=1e-9)
    expected = mass / 12.0 * np.diag([length**2 + height**2, width**2 + height**2, width**2 + length**2])
    np.testing.assert_allclose(found.inertia_g_mm2, expected, rtol=1e-9, atol=1e-6)


def test_inertia_is_about_the_centre_of_mass_and_turns_with_the_part() -> None:
    turned = mass_properties(Location((500.0, -40.0, 7.0), (0.0, 0.0, 30.0)) * Box(60.0, 30.0, 10.0), 2.0)
    upright = mass_properties(Box(60.0, 30.0, 10.0), 2.0)
    cosine, sine = np.cos(np.radians(30.0)), np.sin(np.radians(30.0))
    turn = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
    np.testing.assert_allclose(turned.inertia_g_mm2, turn @ upright.inertia_g_mm2 @ turn.T, rtol=1e-6, atol=1e-3)
    np.testing.assert_allclose(turned.centre_in_rig_mm, [500.0, -40.0, 7.0], atol=1e-9)


@pytest.mark.parametrize("radius_mm", [3.0, 31.5, 150.0])
def test_no_facet_is_further_from_the_part_than_stated(tmp_path: Path, radius_mm: float) -> None:
    write_stl(tmp_path / "rod.stl", Cylinder(radius_mm, 20.0))
    mesh = trimesh.load_mesh(tmp_path / "rod.stl")
    flanks = np.abs(mesh.face_normals[:, 2]) < 0.5
    # Seen along the rod its flank is a chord, furthest from the circle where it is nearest to the axis.
    nearest = (mesh.face_normals * mesh.triangles_center).sum(axis=1)[flanks]
    assert 0.0 < radius_mm - nearest.min() <= STL_TOLERANCE_MM


def test_a_second_write_gives_the_same_bytes(block: PartPlan, built_block: BuiltPart, tmp_path: Path) -> None:
    solid = block.make(block.plan)
    write_step(tmp_path / "again.step", solid)
    write_stl(tmp_path / "again.stl", solid)
    assert (tmp_path / "again.step").read_bytes() == built_block.step.read_bytes()
    assert (tmp_path / "again.stl").read_bytes() == built_block.stl.read_bytes()


def test_the_step_file_holds_the_part_where_it_belongs(block: PartPlan, built_block: BuiltPart) -> None:
    shape = import_step(built_block.step)
    assert shape.label == "block"
    (solid,) = shape.solids()
    box = solid.bounding_box()
    np.testing.assert_allclose([tuple(box.min), tuple(box.max)], [block.plan.low, block.plan.high], atol=1e-6)


class FullDisk:
    """A mesh writer that cannot write."""

    ASCIIMode = True

    def Write(self, *_: object) -> bool:  # noqa: N802  # the kernel's name
        return False


def test_writers_that_fail_say_so_and_leave_no_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("mirrorcam.cad.write.part_export.export_step", lambda *_, **__: False)
    monkeypatch.setattr("mirrorcam.cad.write.part_export.StlAPI_Writer", FullDisk)
    for write, name in ((write_step, "a.step"), (write_stl, "a.stl")):
        with pytest.raises(InputError, match=rf"{name}: cannot be written: the ST\w+ writer failed"):
            write(tmp_path / name, Box(1.0, 1.0, 1.0))
    assert list(tmp_path.iterdir()) == []
