"""Names of faces in STEP files, by the geometry that the file itself gives for each."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from build123d import Box, BuildPart, Cylinder, Locations, Mode, Part

from mirrorcam.cad.plan.part_plan import NamedFace
from mirrorcam.cad.write.face_names import name_faces
from mirrorcam.cad.write.part_export import write_step
from mirrorcam.core.values import FloatArray
from tests.cad.write.freecad import NEEDS_FREECAD, run_in_freecad, script_of_the_page

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
    """A plate 40 x 20 x 5 mm about the origin, with a hole amid it and a groove that halves its upper face."""
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
    with pytest.raises(ValueError, match=r"holds \d+ faces, expected 6"):
        name_faces((tmp_path / "plate.step").read_text(), Box(1.0, 1.0, 1.0), [])
