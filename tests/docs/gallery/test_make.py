"""The gallery: its list, its command, what it writes of a run, and, slow, two small devices as it makes them."""

from __future__ import annotations

import json
import zipfile
from pathlib import Path

import numpy as np
import pytest

from docs.gallery.devices import DeviceList, GalleryDevice, Work, WorkOfDevice
from docs.gallery.make import (
    BEGIN,
    END,
    LIST,
    Gallery,
    main,
    overview,
    record_of,
    table_of,
    with_record,
)
from docs.gallery.page import NBSP
from mirrorcam.cad.assembly.device_plan import plan_device
from mirrorcam.cad.plan.hardware import require_same_camera
from mirrorcam.core.disk.files import read_model, write_text
from mirrorcam.core.errors import InputError
from mirrorcam.core.images.pictures import read_image, write_image
from mirrorcam.optics.design.optimise import design
from tests.docs.gallery.gallery_cards import CARDS
from tests.run.test_run_page import outline

DEVICES = read_model(DeviceList, LIST).devices


def small(name: str, adapter: str) -> str:
    """A small device, as the list writes it."""
    return (
        f'[[devices]]\nname = "{name}"\ntitle = "{name}"\npurpose = "for a test"\ncamera = "pi_camera_3"\n'
        f'[devices.design]\nrows = 1\ncols = 2\nscale_mm = 50\n[devices.hardware.back]\nkind = "{adapter}"\n'
    )


def gallery() -> Gallery:
    stages = {"design": Work(seconds=1.0, processor_s=2.0), "cad": Work(seconds=3.0, processor_s=40.5)}
    work = {"nine-views": WorkOfDevice(stages=stages)}
    return Gallery(machine="a machine", date="2026-11-25", commit="0", slicer="none", cards=CARDS, work=work)


def test_there_are_twelve_devices_of_many_kinds() -> None:
    assert len(DEVICES) == 12
    specs = [device.spec for device in DEVICES]
    assert len({spec.arrangement.text for spec in specs}) >= 6
    assert len({spec.scale_mm for spec in specs}) >= 6
    assert len({device.camera for device in DEVICES}) >= 8
    assert len({device.hardware.back.kind for device in DEVICES}) >= 7
    assert {spec.surface for spec in specs} == {"first", "second"}
    assert {device.hardware.screw.kind for device in DEVICES} == {"insert", "nut"}
    assert {device.hardware.holder.mirrors for device in DEVICES} == {"glue", "screws"}
    assert {spec.refractive_index for spec in specs} == {1.49, 1.52}
    assert {spec.shape for spec in specs} == {"rectangles", "free"}


@pytest.mark.parametrize("device", DEVICES, ids=lambda device: device.name)
def test_every_device_has_the_camera_that_it_is_designed_for(device: GalleryDevice) -> None:
    require_same_camera(device.spec.camera, device.made_with.camera)
    assert device.purpose.isprintable()


@pytest.mark.slow
@pytest.mark.parametrize("name", ["two-views", "arm-grasping"])
def test_small_devices_of_the_list_can_be_planned(name: str) -> None:
    device = next(device for device in DEVICES if device.name == name)
    plan = plan_device(design(device.spec), device.made_with)
    assert plan.hardware.back.kind == device.hardware.back.kind


def test_the_table_has_a_row_for_each_device() -> None:
    head, rule, *rows = table_of(gallery()).splitlines()
    assert len(rows) == len(CARDS)
    assert {row.count("|") for row in (head, rule, *rows)} == {head.count("|")}
    assert "403 g | 91 EUR | 17:57 h | 60% | 0.089 mm at 300 mm | 184 | 42 s |" in rows[0].replace(NBSP, " ")
    assert rows[1].endswith("| - |")


def test_the_record_of_a_page_is_replaced_and_nothing_else() -> None:
    page = f"before\n\n{BEGIN}\n\n| old |\n\n{END}\n\nafter\n"
    once = with_record(page, "| new |\n")
    assert once == f"before\n\n{BEGIN}\n\n| new |\n\n{END}\n\nafter\n"
    assert with_record(once, "| new |\n") == once
    with pytest.raises(InputError, match="expected a record between"):
        with_record("no marks", "| new |\n")


def test_a_record_says_where_it_was_made() -> None:
    text = record_of(gallery())
    assert "on a machine with a machine, of commit 0, with none, in 1 min of processor time" in text
    assert table_of(gallery()) in text
    assert "![The three devices" in text


def test_pictures_stand_in_rows(tmp_path: Path) -> None:
    paths = [tmp_path / f"{number}.png" for number in range(6)]
    for number, path in enumerate(paths):
        write_image(path, np.full((72, 128, 3), 30 * number, np.uint8))
    image = overview(paths)
    assert image.shape == (360, 1280, 3)
    assert (image[200, 330] == 150).all()
    assert (image[200, 1000] == 255).all()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--only", "no-such"), "no-such: expected names"),
        (("--only", "two-views", "--record"), "expected all devices"),
        (("--devices", "nowhere.toml"), "no such file"),
    ],
)
def test_what_cannot_be_done_is_refused_before_work(
    arguments: tuple[str, ...], message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([str(tmp_path / "out"), *arguments]) == 2
    told = capsys.readouterr().err
    assert message in told
    assert told.count("\n") == 1
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_two_small_devices_are_made_once(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_text(tmp_path / "list.toml", small("on-tripod", "tripod") + small("on-desk", "none"))
    arguments = [str(tmp_path / "out"), "--devices", str(tmp_path / "list.toml"), "--workers", "2"]
    assert main(arguments) == 0
    out = tmp_path / "out"
    written = json.loads((out / "gallery.json").read_text(encoding="utf-8"))
    assert [card["name"] for card in written["cards"]] == ["on-tripod", "on-desk"]
    page = outline((out / "index.html").read_text(encoding="utf-8"))
    assert all((out / target).is_file() for target in page.targets)
    for card in written["cards"]:
        assert 0.0 < card["mass_g"] < 1000.0
        assert all(20.0 < length < 400.0 for length in card["size_mm"])
        assert read_image(out / card["name"] / "picture" / "device.jpg").shape == (720, 1279, 3)
        root = out / card["name"]
        with zipfile.ZipFile(root / "files" / f"{card['name']}.zip") as archive:
            names = {name.partition("/")[2] for name in archive.namelist()}
        inside = outline((root / "cad" / "index.html").read_text(encoding="utf-8"))
        linked = {target for target in inside.targets if not target.startswith(("#", "data:", "http"))}
        assert linked <= names
    assert main([*arguments, "--only", "on-desk"]) == 0
    assert len(json.loads((out / "gallery.json").read_text(encoding="utf-8"))["cards"]) == 2
    zips = [path.read_bytes() for path in sorted(out.rglob("*.zip"))]
    capsys.readouterr()
    assert main(arguments) == 0
    assert capsys.readouterr().out.count("nothing changed, kept") == 2
    assert [path.read_bytes() for path in sorted(out.rglob("*.zip"))] == zips
