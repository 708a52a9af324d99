"""The folder of a device: the names of its files, and what is refused before the work."""

from __future__ import annotations

from fnmatch import fnmatchcase
from pathlib import Path

import pytest

from mirrorcam.cad.assembly.catalogue import EXPLODE
from mirrorcam.cad.assembly.device_plan import plan_device
from mirrorcam.cad.backs.plan_backs import plan_back
from mirrorcam.cad.mirrors.stock_sheets import plan_sheets
from mirrorcam.cad.plan.back_table import BACKS, back_of
from mirrorcam.cad.plan.hardware import HARDWARE
from mirrorcam.core.values import InputError
from mirrorcam.device.device_folder import FILES, write_device
from mirrorcam.optics.geometry.layout import Layout


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
        *("parts/mount.stl", "drawings/camera_clip.pdf", "robot", "pictures", "bom.csv/x", "parts/.mount.json"),
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
