"""Devices of a gallery: what their list may say, and stages that are done once, again where something changed."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from docs.gallery import devices as device_gallery
from docs.gallery.devices import DeviceList, GalleryDevice, is_finished, make_device, processor_s, work_of
from mirrorcam.core.disk.files import model_from, write_metrics, write_text
from mirrorcam.core.errors import InputError
from mirrorcam.core.values import Metric
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.render_scenes.reference import product_picture

LICENCE = "the text of a licence"
PASSED = {"device.clash_mm3": Metric(value=0.0, unit="mm3", limit=0.0), "device.mass_g": Metric(value=9.0, unit="g")}


def device(**changes: Any) -> GalleryDevice:
    values = {"name": "nine-views", "title": "Nine views", "purpose": "for a test of C920s", "camera": "c920"}
    return GalleryDevice(**(values | changes))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"name": "../up"}, "name"),
        ({"name": "Nine Views"}, "name"),
        ({"purpose": "A device."}, "purpose"),
        ({"camera": "no_such_camera"}, "no_such_camera"),
        ({"camera": "board_38"}, "its lens is not specified"),
        ({"pattern": "star5"}, "expected a name like hex7"),
        ({"design": {"rows": 40}}, "rows"),
        ({"hardware": {"back": {"kind": "balloon"}}}, "back"),
        ({"colour": "red"}, "colour"),
    ],
)
def test_an_entry_that_is_not_valid_is_refused(changes: dict[str, Any], message: str) -> None:
    entry = {"name": "nine-views", "title": "Nine views", "purpose": "for a test", "camera": "c920"} | changes
    with pytest.raises(InputError, match=message) as refused:
        model_from(DeviceList, Path("list.toml"), {"devices": [entry]})
    assert "\n" not in str(refused.value)


def test_a_name_that_is_there_twice_is_refused() -> None:
    entry = {"name": "nine-views", "title": "Nine views", "purpose": "for a test", "camera": "c920"}
    with pytest.raises(InputError, match="names a device twice"):
        model_from(DeviceList, Path("list.toml"), {"devices": [entry, entry]})


def test_camera_and_pattern_are_those_that_are_named() -> None:
    found = device(camera="pi_hq_m12", pattern="hex7")
    assert found.spec.arrangement.text == "hex7"
    assert found.spec.camera.name == found.made_with.camera.name == "Raspberry Pi HQ, M12 8 mm"


@pytest.fixture
def built(monkeypatch: pytest.MonkeyPatch, default_layout: Layout) -> list[str]:
    """Steps that take minutes replaced by quick ones; returns the list that each adds its name to."""
    done: list[str] = []

    def design(spec: object, folder: Path) -> None:
        done.append("design")
        default_layout.save(folder / "layout.json")

    def parts(layout: Layout, folder: Path, *_: object, **__: object) -> None:
        done.append("cad")
        for name in ("index.html", "guide.md", "parts/mount.3mf", "parts/.hidden.json", "assembly.glb"):
            write_text(folder / name, name)
        write_metrics(folder / "checks.json", PASSED)

    def checked(*arguments: Any, **named: Any) -> dict[str, Metric]:
        parts(*arguments, **named)
        return PASSED

    def picture(*_: object, **__: object) -> Any:
        done.append("picture")
        return np.full((72, 128, 3), 100, np.uint8)

    monkeypatch.setattr(device_gallery, "write_design", design)
    monkeypatch.setattr(device_gallery, "build_parts", checked)
    monkeypatch.setattr(product_picture, "product_picture", picture)
    return done


@pytest.mark.slow
def test_a_finished_device_is_kept_and_what_is_lost_is_made_again(built: list[str], tmp_path: Path) -> None:
    assert make_device(device(), tmp_path, LICENCE).startswith("design in ")
    root = tmp_path / "nine-views"
    first = (root / "files" / "nine-views.zip").read_bytes()
    assert make_device(device(), tmp_path, LICENCE) == "nothing changed, kept"
    assert built == ["design", "cad", "picture"]
    assert is_finished(device(), tmp_path, LICENCE)
    (root / "picture" / "device.jpg").unlink()
    assert not is_finished(device(), tmp_path, LICENCE)
    assert make_device(device(), tmp_path, LICENCE).startswith("picture in ")
    assert built == ["design", "cad", "picture", "picture"]
    assert (root / "files" / "nine-views.zip").read_bytes() == first
    assert {*work_of(root).stages} == {"design", "cad", "picture", "files"}
    assert work_of(root).total("seconds") < 60.0


def test_another_request_is_another_device(built: list[str], tmp_path: Path) -> None:
    make_device(device(), tmp_path, LICENCE)
    nuts = device(hardware=device().hardware.replaced(screw={"kind": "nut"}))
    assert make_device(nuts, tmp_path, LICENCE).startswith("cad in ")
    assert built == ["design", "cad", "picture", "cad"]
    assert make_device(nuts, tmp_path, LICENCE) == "nothing changed, kept"
    assert make_device(nuts, tmp_path, "another licence").startswith("files in ")


def test_an_interrupted_run_is_resumed(built: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def cut_off(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as during:
        during.setattr(product_picture, "product_picture", cut_off)
        with pytest.raises(KeyboardInterrupt):
            make_device(device(), tmp_path, LICENCE)
    assert not (tmp_path / "nine-views" / "picture").exists()
    make_device(device(), tmp_path, LICENCE)
    assert built == ["design", "cad", "picture"]


def test_files_of_others_stay(built: list[str], tmp_path: Path) -> None:
    make_device(device(), tmp_path, LICENCE)
    root = tmp_path / "nine-views"
    write_text(root / "notes.txt", "mine")
    write_text(root / "cad" / "notes.txt", "mine")
    (root / "picture" / "device.jpg").unlink()
    make_device(device(), tmp_path, LICENCE)
    assert (root / "notes.txt").read_text() == (root / "cad" / "notes.txt").read_text() == "mine"
    write_text(root / "cad" / "guide.md", "mine")
    with pytest.raises(InputError, match=r"guide\.md: was changed"):
        make_device(device(), tmp_path, LICENCE)
    assert (root / "cad" / "guide.md").read_text() == "mine"


def test_a_device_that_fails_a_check_is_refused(
    built: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    failed = {"mount.support_filament_mm": Metric(value=3.5, unit="mm", limit=0.0)}
    monkeypatch.setattr(device_gallery, "build_parts", lambda *_, **__: PASSED | failed)
    with pytest.raises(InputError, match=r"1 checks failed: mount.support_filament_mm is 3.5, limit 0"):
        make_device(device(), tmp_path, LICENCE)
    assert not (tmp_path / "nine-views" / "cad").exists()


def test_the_zip_file_holds_what_a_maker_needs(built: list[str], tmp_path: Path) -> None:
    make_device(device(), tmp_path, LICENCE)
    with zipfile.ZipFile(tmp_path / "nine-views" / "files" / "nine-views.zip") as archive:
        names = {name.removeprefix("nine-views/") for name in archive.namelist()}
        readme = archive.read("nine-views/README.txt").decode()
        layout = archive.read("nine-views/layout.json")
        assert archive.read("nine-views/LICENSE.txt").decode() == LICENCE
    assert names == {
        *("README.txt", "LICENSE.txt", "layout.json", "device.jpg", "index.html", "guide.md", "checks.json"),
        *("assembly.glb", "parts/mount.3mf"),
    }
    assert layout == (tmp_path / "nine-views" / "design" / "layout.json").read_bytes()
    assert "Nine views: a light field camera of 9 views" in readme
    assert "For a test of C920s." in readme
    assert "Open index.html" in readme
    assert "first-surface glass, 3 mm" in readme
    assert "{" not in readme


def test_processors_work_for_this_process() -> None:
    before = processor_s()
    while processor_s() - before < 0.02:
        np.linalg.svd(np.ones((60, 60)))
    assert processor_s() > before
