"""A back of your own: a user's part becomes a part of the device, where it belongs; a bad file is refused in one line.

The wedge of the documentation is the device's back in these tests; the STEP file has a frame unrelated to the mount.
"""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from build123d import Box, Cylinder, Part, Plane, Pos, export_step

from mirrorcam.cad.assembly.device_plan import Device
from mirrorcam.cad.backs.adapter import MountFace
from mirrorcam.cad.backs.adapter_file import open_adapter
from mirrorcam.cad.backs.back import Back, carried_load
from mirrorcam.cad.backs.own_back import face_of
from mirrorcam.cad.backs.plan_backs import make_adapter, plan_back
from mirrorcam.cad.build import build_parts
from mirrorcam.cad.checks.load_checks import tipping_angle_deg
from mirrorcam.cad.guide.back_step import back_sentences
from mirrorcam.cad.plan.back_table import FileBack, back_of
from mirrorcam.cad.plan.hardware import HARDWARE, Hardware
from mirrorcam.cad.plan.seats import keep_outs
from mirrorcam.core.disk.files import read_model
from mirrorcam.core.errors import InputError
from mirrorcam.optics.geometry.layout import Layout

ROOT = Path(__file__).parents[3]
WEDGE = ROOT / "examples" / "backs" / "wedge.py"
IMPORTS = "from build123d import *\nfrom mirrorcam import Adapter, Fastener\n"
PLATE = "Pos(0, 0, -5) * Box(60, 40, 10)"


def planned(device: Device, file: Path) -> Back:
    hardware = device.hardware.replaced(back=back_of(str(file)))
    light = [volume for volumes in keep_outs(device.layout, device.hardware) for volume in volumes]
    return plan_back(device.clip, device.mount, hardware, tuple(light))


def returning(tmp_path: Path, adapter: str) -> Path:
    """A file whose function returns an expression."""
    path = tmp_path / "own.py"
    path.write_text(f"{IMPORTS}def adapter(face):\n    return {adapter}\n")
    return path


@pytest.fixture
def face(device: Device) -> MountFace:
    table, foot = FileBack(), device.mount.foot
    return face_of(table, foot, carried_load(device.mount, device.clip, device.hardware), (), device.hardware)[0]


def test_the_page_shows_the_tested_wedge() -> None:
    page = (ROOT / "docs" / "own_back.md").read_text(encoding="utf-8")
    (block,) = re.findall(r"```python\n(.*?)```", page, flags=re.DOTALL)
    assert block == WEDGE.read_text(encoding="utf-8")


def test_a_device_stands_on_the_wedge_and_looks_up(device: Device, face: MountFace) -> None:
    back = planned(device, WEDGE)
    assert back.look_deg == pytest.approx(15.0)
    assert back.stand is not None
    # The desk is level in the frame in which it stands: the wedge's lowest points are its base.
    made = make_adapter(back.parts[0].plan)
    assert made.is_valid
    corners = np.array([tuple(vertex) for vertex in made.vertices()]) @ back.rig_from_stand
    assert corners[:, 2].min() == pytest.approx(back.stand.z_mm)
    load = carried_load(device.mount, device.clip, device.hardware)
    assert tipping_angle_deg(back.stand, load.centre @ back.planned_from_stand) > 14.0
    # Only the holes of the screws are missing from the user's part.
    removed = open_adapter(WEDGE)(face).part.volume - made.volume
    assert removed == pytest.approx(4 * np.pi * (3.8**2 * 25.0 + 1.7**2 * 5.5), rel=0.15)
    sentences = back_sentences(replace(device, back=back))
    assert sentences[0] == "Screw the wedge to the foot of the mount from below, its longer end towards the back."
    assert "rubber feet" in sentences[1]
    assert re.search(r"^Not checked by the program: the stress .* Load the part with 1\.\d kg", sentences[-1])


def test_fasteners_are_items_in_their_place(device: Device, tmp_path: Path) -> None:
    nut = 'Fastener("nut", "M5", 4.7, Plane((20, 0, -10), z_dir=(0, 0, -1)))'
    back = planned(device, returning(tmp_path, f"Adapter({PLATE}, fasteners=({nut},))"))
    (item,) = back.items
    local = item.rig_from_item[:3, 3] @ back.rig_from_stand - device.mount.foot.screws.mean(axis=0)
    np.testing.assert_allclose(local, [20.0, 0.0, -10.0], atol=1e-9)
    np.testing.assert_allclose(item.exit_moves_mm[0] @ back.rig_from_stand, [0.0, 0.0, -25.0], atol=1e-9)


@pytest.mark.parametrize("up", [(0, 0, 1), (0, 0, -1), (1, 0, 0), (0, 1, 1)])
def test_the_holes_suit_the_print_orientation(device: Device, tmp_path: Path, up: tuple[int, int, int]) -> None:
    back = planned(device, returning(tmp_path, f"Adapter({PLATE}, print_up={up})"))
    assert (back.foot_form != "") == (up == (0, 0, 1))
    (part,) = back.parts
    lying = np.asarray(part.plan.corners @ part.bed_from_rig.T)
    solid = make_adapter(part.plan)
    on_bed = np.array([tuple(vertex) for vertex in solid.vertices()]) @ part.bed_from_rig.T
    np.testing.assert_allclose(lying.min(axis=0), on_bed.min(axis=0), atol=1e-5)


@pytest.mark.parametrize(
    ("program", "message"),
    [
        ("x = 1", r"own\.py: has no function adapter, expected adapter\(face\) that returns"),
        ("def adapter(face)", r"own\.py, line 1: SyntaxError"),
        ("import nothing_of_the_kind", r"own\.py, line 1: ModuleNotFoundError"),
        ("def adapter(face):\n    return 1 / 0", r"own\.py, line 2: ZeroDivisionError: division by zero"),
        ("def adapter(face): ...", r"returned None, expected a mirrorcam\.Adapter"),
        (f"{IMPORTS}def adapter(face): return Adapter(3)", "line 3: part is a int, expected a Part"),
        (f"{IMPORTS}def adapter(face): return Adapter(Box(1, 1, 1).faces()[0])", "part has 0 solids, expected one"),
        (f"{IMPORTS}def adapter(face): return Adapter({PLATE} + Pos(99, 0, 0) * Box(1, 1, 1))", "2 solids, expected"),
        (f"{IMPORTS}def adapter(face): return Adapter(Box(20, 40, 99))", r"no material under the head .* x = -17"),
        (f"{IMPORTS}def adapter(face): return Adapter({PLATE} + Pos(0, 60, 50) * Box(9, 99, 200))", "light enters"),
        (f"{IMPORTS}def adapter(face): return Adapter({PLATE}, stands_on=Plane((0, 0, -12)))", "no face on stands_on"),
        (
            f"{IMPORTS}def adapter(face): return Adapter({PLATE}, stands_on=Plane((0, 0, -8)))",
            "2.00 mm below stands_on",
        ),
        (f"{IMPORTS}Fastener('bolt', 'M5', 4, Plane.XY)", "line 3: kind of a fastener is 'bolt', expected one of"),
    ],
)
def test_a_bad_file_is_refused_in_one_line(device: Device, tmp_path: Path, program: str, message: str) -> None:
    path = tmp_path / "own.py"
    path.write_text(program)
    with pytest.raises(InputError, match=message) as raised:
        planned(device, path)
    assert "\n" not in str(raised.value)


def test_only_the_command_line_names_a_file(tmp_path: Path) -> None:
    table = tmp_path / "hardware.toml"
    table.write_text('[back]\nkind = "file"\nfile = "own.py"\n')
    with pytest.raises(InputError, match="only the command line may name one"):
        read_model(Hardware, table)
    with pytest.raises(InputError, match="is no file"):
        back_of(str(tmp_path / "missing.py"))


def step_file(path: Path, part: Part, names: list[str], *, at: Plane = Plane.XY) -> Path:
    """Write a part in a plane's frame, with a name for each of its faces, in their order."""
    export_step(at.from_local_coords(part), path)
    remaining = iter(names)
    text = re.sub(r"ADVANCED_FACE\('[^']*'", lambda _: f"ADVANCED_FACE('{next(remaining)}'", path.read_text())
    assert next(remaining, None) is None
    path.write_text(text)
    return path


@pytest.fixture
def plate(face: MountFace) -> Part:
    """A plate with holes at the screws, in the frame of the mount's face."""
    drilled: Part = Pos(0, 5, -5) * Box(60, 40, 10) - [Pos(x, y, -5) * Cylinder(1.7, 10) for x, y in face.screws_mm]
    return drilled


DIRECTIONS = {(0, 0, 1): "mount", (0, 1, 0): "front", (0, 0, -1): "desk"}


def names_of(part: Part) -> list[str]:
    """The names of a plate's faces."""
    return [
        f"screw_{number}" if face.radius else DIRECTIONS.get(tuple(round(x) for x in tuple(face.normal_at())), "")
        for number, face in enumerate(part.faces())
    ]


def test_a_step_file_is_placed_by_its_named_faces(plate: Part, face: MountFace, tmp_path: Path) -> None:
    at = Plane((100.0, -20.0, 7.0), x_dir=(0.0, 1.0, 1.0), z_dir=(1.0, 1.0, -1.0))
    adapter = open_adapter(step_file(tmp_path / "my_plate.step", plate, names_of(plate), at=at))(face)
    assert adapter.title == "My plate"
    np.testing.assert_allclose(tuple(adapter.part.center()), tuple(plate.center()), atol=1e-6)
    assert (adapter.part - plate).volume < 1e-3
    assert adapter.stands_on is not None
    np.testing.assert_allclose(tuple(adapter.stands_on.z_dir), [0.0, 0.0, 1.0], atol=1e-9)


def test_a_step_file_without_names_or_with_other_holes_is_refused(plate: Part, face: MountFace, tmp_path: Path) -> None:
    names = names_of(plate)
    for missing, message in (("mount", "no flat face named 'mount'"), ("screw", "0 round holes have a name")):
        path = step_file(tmp_path / "own.step", plate, ["" if name.startswith(missing) else name for name in names])
        with pytest.raises(InputError, match=message):
            open_adapter(path)
    wide = replace(face, screws_mm=tuple((1.1 * x, y) for x, y in face.screws_mm))
    with pytest.raises(InputError, match=r"holes 'screw' are 34\.00 x 9\.50 mm apart .* expected 37\.4 x 9\.5 mm"):
        open_adapter(step_file(tmp_path / "own.step", plate, names))(wide)
    (tmp_path / "own.step").write_text("no STEP")
    with pytest.raises(InputError, match="is no STEP file with a solid"):
        open_adapter(tmp_path / "own.step")


@pytest.mark.slow
def test_the_device_on_the_wedge_is_built_and_passes(default_layout: Layout, tmp_path: Path) -> None:
    checks = build_parts(default_layout, tmp_path, HARDWARE.replaced(back=back_of(str(WEDGE))), workers=2)
    assert {name: check for name, check in checks.items() if not check.passed} == {}
    assert checks["device.look_deg"].value == pytest.approx(15.0)
    assert checks["device.tips_at_deg"].value > 10.0
    assert (tmp_path / "source" / "wedge.py").read_bytes() == WEDGE.read_bytes()
    assert "; not checked: the stress in your part" in (tmp_path / "index.html").read_text(encoding="utf-8")
    assert "| MC-04 | Wedge |" in (tmp_path / "bom.md").read_text(encoding="utf-8")
