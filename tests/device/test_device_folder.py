"""The hardware that a device is built from, and its folder: files in the way are refused before the work."""

from __future__ import annotations

from pathlib import Path

import pytest

from mirrorcam.cad.plan.back_table import back_of
from mirrorcam.cad.plan.hardware import HARDWARE
from mirrorcam.core.errors import InputError
from mirrorcam.device.device_folder import device_folder


@pytest.mark.parametrize(
    ("name", "back"),
    [
        *((name, "none") for name in ("parts/mount.stl", "drawings/camera_clip.pdf", "pictures", "bom.csv/x")),
        ("pictures/exploded.png", "none"),
        *(("robot", "gen2"), ("robot/meshes/mirror_holder_hull.stl", "gen2"), ("robot/meshes/mirrors.stl", "iso9409")),
    ],
)
@pytest.mark.parametrize("force", [False, True])
def test_what_is_in_the_way_is_refused_before_the_work(name: str, back: str, force: bool, tmp_path: Path) -> None:
    hardware = HARDWARE.replaced(back=back_of(back))
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
