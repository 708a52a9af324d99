"""The table of dimensions that a device is built from: a file, with another camera or other fasteners."""

from __future__ import annotations

from fnmatch import fnmatchcase
from pathlib import Path

import pytest

from mirrorcam.cad.assembly.catalogue import EXPLODE
from mirrorcam.cad.assembly.device_plan import plan_device
from mirrorcam.cad.backs.plan_backs import plan_back
from mirrorcam.cad.mirrors.stock_sheets import plan_sheets
from mirrorcam.cad.plan.back_table import BACKS, Gen2Back, back_of
from mirrorcam.cad.plan.hardware import HARDWARE
from mirrorcam.core.values import InputError
from mirrorcam.device.device_folder import FILES, read_hardware, write_device
from mirrorcam.optics.geometry.camera_library import read_body, read_camera
from mirrorcam.optics.geometry.layout import Layout


def test_what_is_not_named_stays_as_it_is() -> None:
    assert read_hardware() == HARDWARE
    other = read_hardware(camera="board_38", fasteners="nut")
    assert other.camera.name != HARDWARE.camera.name
    assert other.screw.kind == "nut"
    assert other.replaced(camera=HARDWARE.camera, screw=HARDWARE.screw) == HARDWARE


def test_the_body_is_that_of_the_layouts_camera_unless_another_is_stated(
    default_layout: Layout, tmp_path: Path
) -> None:
    other = default_layout.replaced(camera=read_camera("d435"))
    assert read_hardware(layout=default_layout) == HARDWARE
    assert read_hardware(layout=other) == HARDWARE.replaced(camera=read_body("d435"))
    assert read_hardware(layout=other, camera="brio").camera == read_body("brio")
    unknown = other.replaced(camera=other.camera.replaced(name="mine"))
    assert read_hardware(layout=unknown) == HARDWARE
    table = tmp_path / "hardware.toml"
    table.write_text('[screw]\nkind = "nut"\n', encoding="utf-8")
    assert read_hardware(table, layout=other).camera == read_body("d435")
    table.write_text('camera = "oak_d"\n', encoding="utf-8")
    assert read_hardware(table, layout=other).camera == read_body("oak_d")


def test_a_file_replaces_dimensions_and_a_bad_one_is_refused(tmp_path: Path) -> None:
    table = tmp_path / "hardware.toml"
    table.write_text('[screw]\nkind = "nut"\n', encoding="utf-8")
    assert read_hardware(table).screw.kind == "nut"
    assert read_hardware(table, fasteners="insert").screw.kind == "insert"
    table.write_text("[screw]\nsort = 3\n", encoding="utf-8")
    with pytest.raises(InputError, match=r"hardware\.toml: screw\.sort"):
        read_hardware(table)


def test_the_back_is_the_one_that_is_named(tmp_path: Path) -> None:
    assert read_hardware().back.kind == "none"
    assert read_hardware(adapter="gen2").back == Gen2Back()
    table = tmp_path / "hardware.toml"
    table.write_text('[back]\nkind = "gen2"\ndiameter_mm = 65\n', encoding="utf-8")
    assert read_hardware(table).back == read_hardware(table, adapter="gen2").back == Gen2Back(diameter_mm=65.0)
    assert read_hardware(table, adapter="none") == HARDWARE
    table.write_text('[back]\nkind = "shelf"\n', encoding="utf-8")
    with pytest.raises(InputError, match=r"hardware\.toml: back"):
        read_hardware(table)
    with pytest.raises(InputError, match=r"adapter shelf: expected one of none, "):
        read_hardware(adapter="shelf")


def test_the_files_of_every_part_are_known_before_it_is_built(default_layout: Layout) -> None:
    device = plan_device(default_layout, HARDWARE)
    backs = [plan_back(device.clip, device.mount, HARDWARE.replaced(back=back_of(kind))) for kind in BACKS]
    printed = {part.name for back in backs for part in back.parts}
    names = [f"parts/{part}.step" for part in (*EXPLODE, *printed, "mirror_holder_2")]
    names += [f"mirrors/{sheet.stem}.dxf" for sheet in plan_sheets(default_layout, HARDWARE.cutting)]
    assert len(names) > 6
    assert [name for name in names if not any(fnmatchcase(name, pattern) for pattern in FILES)] == []


@pytest.mark.parametrize(
    "name",
    [
        *("parts/mount.stl", "drawings/camera_clip.pdf", "robot", "pictures", "bom.csv/x"),
        *("pictures/exploded.png", "robot/meshes/mirror_holder_hull.stl", "robot/meshes/mirrors.stl"),
    ],
)
@pytest.mark.parametrize("force", [False, True])
def test_what_is_in_the_way_is_refused_before_the_work(
    name: str, force: bool, default_layout: Layout, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    built: list[Path] = []
    monkeypatch.setattr("mirrorcam.cad.build.build_parts", lambda layout, folder, *rest, **named: built.append(folder))
    (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
    (tmp_path / name).write_text("mine")
    if force and name.count("/") and not name.startswith("bom"):
        write_device(default_layout, tmp_path, force=True)
        assert built
    else:
        with pytest.raises(InputError, match=r"was not written by this command|is a file or a link|is a folder"):
            write_device(default_layout, tmp_path, force=force)
        assert not built
    assert (tmp_path / name).read_text() == "mine"
