"""Names of faces in STEP files, against the geometry of each face in the file.

Files of a part, read back, and its mass properties, against closed forms.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
import trimesh
from build123d import Box, BuildPart, Cylinder, Location, Locations, Mode, Part, import_step

from mirrorcam.cad.plan.part_plan import BuiltPart, NamedFace, PartPlan
from mirrorcam.cad.write.part_export import STL_TOLERANCE_MM, mass_properties, name_faces, write_step, write_stl
from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from tests.cad.write.freecad import run_in_freecad, script_of_the_page
from tests.cad.write.needs_freecad import NEEDS_FREECAD

UP, RIGHT = np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0])
ENTITY = re.compile(r"^#(\d+) = ([A-Z0-9_]+)\((.*?)\);$", re.MULTILINE | re.DOTALL)


def named_planes(text: str) -> dict[str, tuple[FloatArray, FloatArray]]:
    """Point and normal (3,), outward, of the plane of each named face, from the entities of a STEP file."""
    bodies = {int(number): (kind, body.replace("\n", "")) for number, kind, body in ENTITY.findall(text)}

    def numbers(entity: int) -> FloatArray:
        return np.array([float(each) for each in re.findall(r"-?\d+\.\d*(?:E[+-]?\d+)?", bodies[entity][1])])

    planes = {}
    for kind, body in bodies.values():
        if kind != "ADVANCED_FACE" or body.startswith("''"):
            continue
        face = re.match(r"'([^']+)',\([^)]*\),\s*#(\d+),\s*\.([TF])\.", body)
        assert face is not None
        name, surface, same = face.groups()
        assert bodies[int(surface)][0] == "PLANE"
        placement = int(re.findall(r"#(\d+)", bodies[int(surface)][1])[0])
        point, normal, _ = (int(each) for each in re.findall(r"#(\d+)", bodies[placement][1]))
        planes[name] = (numbers(point), numbers(normal) * (1.0 if same == "T" else -1.0))
    return planes


def plate() -> Part:
    """A plate 40 x 20 x 5 mm about the origin, with a central hole and a groove that halves its upper face."""
    with BuildPart() as part:
        Box(40.0, 20.0, 5.0)
        Cylinder(2.0, 20.0, mode=Mode.SUBTRACT)
        with Locations((0.0, 0.0, 2.5)):
            Box(40.0, 3.0, 2.0, mode=Mode.SUBTRACT)
    assert part.part is not None
    return part.part


def test_names_are_on_the_faces_that_they_are_for(tmp_path: Path) -> None:
    faces = (
        NamedFace("under", np.array([0.0, 0.0, -2.5]), -UP),
        NamedFace("over", np.array([0.0, 0.0, 2.5]), UP),
        NamedFace("right", np.array([20.0, 0.0, 0.0]), RIGHT),
        NamedFace("nowhere", np.array([21.0, 0.0, 0.0]), RIGHT),
    )
    write_step(tmp_path / "plate.step", plate(), faces)
    planes = named_planes((tmp_path / "plate.step").read_text())
    assert sorted(planes) == ["over_1", "over_2", "right", "under"]
    for face in faces[:3]:
        for name, (point, normal) in planes.items():
            if name.startswith(face.name):
                assert (point - face.point) @ face.normal == pytest.approx(0.0, abs=1e-9)
                np.testing.assert_allclose(normal, face.normal, atol=1e-9)


def test_faces_within_an_outline(tmp_path: Path) -> None:
    half = np.array([(-20.0, 0.0, 2.5), (20.0, 0.0, 2.5), (20.0, 10.0, 2.5), (-20.0, 10.0, 2.5)])
    write_step(tmp_path / "plate.step", plate(), [NamedFace("far", half.mean(axis=0), UP, half)])
    assert list(named_planes((tmp_path / "plate.step").read_text())) == ["far"]


@NEEDS_FREECAD
def test_in_freecad_the_script_of_the_page_labels_the_faces(tmp_path: Path) -> None:
    faces = [NamedFace("under", np.array([0.0, 0.0, -2.5]), -UP), NamedFace("over", np.array([0.0, 0.0, 2.5]), UP)]
    (tmp_path / "parts").mkdir()
    path = tmp_path / "parts" / "mirror_holder.step"
    write_step(path, plate(), [*faces, NamedFace("right", np.array([20.0, 0.0, 0.0]), RIGHT)])
    listed = """
found = {
    thing.Label: (list(thing.Shape.CenterOfMass), list(thing.Shape.normalAt(0.0, 0.0)))
    for thing in document.Objects[1:]
}
"""
    found = run_in_freecad(script_of_the_page() + listed, tmp_path)
    planes = named_planes(path.read_text(encoding="utf-8"))
    assert sorted(found) == sorted(planes) == ["over_1", "over_2", "right", "under"]
    for name, (point, normal) in planes.items():
        middle, outward = np.array(found[name])
        assert (middle - point) @ normal == pytest.approx(0.0, abs=1e-9)
        np.testing.assert_allclose(outward, normal, atol=1e-9)


def test_a_file_of_another_solid_is_refused(tmp_path: Path) -> None:
    write_step(tmp_path / "plate.step", plate())
    with pytest.raises(ValueError, match=r"has \d+ faces, expected 6"):
        name_faces((tmp_path / "plate.step").read_text(), Box(1.0, 1.0, 1.0), [])


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
    # Along the rod its flank is a chord, which is furthest from the circle at its point nearest to the axis.
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
