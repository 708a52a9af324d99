"""The hardware that a device is built from, and its folder: files in the way are refused before the work."""

from __future__ import annotations

from pathlib import Path

import pytest

from mirrorcam.cad.plan.back_table import Gen2Back
from mirrorcam.cad.plan.hardware import HARDWARE
from mirrorcam.core.values import InputError
from mirrorcam.device.device_folder import device_folder, read_hardware
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


@pytest.mark.parametrize(
    ("name", "back"),
    [
        *((name, "none") for name in ("parts/mount.stl", "drawings/camera_clip.pdf", "pictures", "bom.csv/x")),
        *((name, "none") for name in ("parts/.mount.json", "pictures/exploded.png")),
        *(("robot", "gen2"), ("robot/meshes/mirror_holder_hull.stl", "gen2"), ("robot/meshes/mirrors.stl", "iso9409")),
    ],
)
@pytest.mark.parametrize("force", [False, True])
def test_what_is_in_the_way_is_refused_before_the_work(name: str, back: str, force: bool, tmp_path: Path) -> None:
    hardware = read_hardware(adapter=back)
    (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
    (tmp_path / name).write_text("mine")
    if force and name.count("/") and not name.startswith("bom"):
        with device_folder(tmp_path, hardware, elastic=False, force=True):
            pass
    else:
        refusal = r"was not written by this command|is a file or a link|is a folder"
        with (
            pytest.raises(InputError, match=refusal),
            device_folder(tmp_path, hardware, elastic=False, force=force),
        ):
            pytest.fail("the work begins")
    assert (tmp_path / name).read_text() == "mine"


def test_what_another_device_would_have_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "elasticity.md").write_text("mine")
    (tmp_path / "robot").write_text("mine")
    with device_folder(tmp_path, HARDWARE, elastic=False, force=False) as folder:
        (folder / "checks.json").write_text("{}")
    assert sorted(path.name for path in tmp_path.glob("[!.]*")) == ["checks.json", "elasticity.md", "robot"]
