"""The whole of a build: which files, the same bytes twice, nothing half-written, refusals in one line."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from build123d import Part

import cad.build
from cad.build import build
from cad.exports import write_step, write_stl
from optics.files import read_image
from optics.layout import Layout
from optics.values import InputError, Metric

Built = tuple[Layout, Path, dict[str, Metric]]
FILES = {
    "checks.json",
    "mirror_holder.png",
    "mirror_holder.step",
    "mirror_holder.stl",
    "mirror_holder.svg",
    "mirrors.dxf",
}


def test_the_default_layout_gives_all_files_and_passes(built_default: Built) -> None:
    _, folder, checks = built_default
    assert {file.name for file in folder.iterdir()} == FILES
    assert all(check.passed for check in checks.values())
    written = json.loads((folder / "checks.json").read_text())
    assert {name: entry["value"] for name, entry in written.items()} == {n: c.value for n, c in checks.items()}
    assert written["seat_offset_um"]["limit"] == 1.0
    assert checks["solid_mass_g"].value == pytest.approx(checks["volume_cm3"].value * 1.24)
    assert checks["print_length_mm"].value < 150.0


def test_the_same_layout_gives_the_same_bytes_in_another_process(built_pair: Built, tmp_path: Path) -> None:
    layout, folder, _ = built_pair
    layout.save(tmp_path / "layout.json")
    program = (
        "import sys; from pathlib import Path; from optics.layout import Layout; from cad.build import build;"
        "layout = Layout.load(Path(sys.argv[1])); build(layout, Path(sys.argv[2]))"
    )
    environment = os.environ | {"PYTHONHASHSEED": "7"}
    again = tmp_path / "again"
    subprocess.run(
        [sys.executable, "-c", program, str(tmp_path / "layout.json"), str(again)], check=True, env=environment
    )
    assert {file.name for file in again.iterdir()} == FILES
    different = [name for name in sorted(FILES) if (again / name).read_bytes() != (folder / name).read_bytes()]
    assert different == []


def test_the_picture_shows_part_mirrors_and_light(built_default: Built) -> None:
    _, folder, _ = built_default
    image = read_image(folder / "mirror_holder.png").astype(int)
    assert image.shape == (1100, 1500, 3)
    red, green, blue = image[..., 0], image[..., 1], image[..., 2]
    mirrors = (blue - red > 30) & (green > red)
    plastic = (np.abs(red - blue) < 40) & (blue < 130) & (blue > 40)
    light = (red > 200) & (blue < 60)
    assert mirrors.mean() > 0.08
    assert plastic.mean() > 0.04
    assert 0.0005 < light.mean() < 0.02
    # The corners are margin: the picture is not cropped.
    assert (image[:40].min(axis=-1) > 250).all()
    assert (image[-25:].min(axis=-1) > 250).all()


def test_the_drawing_has_dark_visible_and_light_hidden_lines(built_default: Built) -> None:
    layout, folder, _ = built_default
    text = (folder / "mirror_holder.svg").read_text()
    hidden, visible = (text.split(f'id="{name}"')[1].split("/>")[0] for name in ("hidden", "visible"))
    assert visible.count("M") > 100
    assert hidden.count("M") > 20
    assert 'stroke="#1b222d"' in visible
    assert layout.identity in text


def test_what_cannot_be_built_leaves_no_file(make_parabola: Callable[..., Layout], tmp_path: Path) -> None:
    with pytest.raises(InputError, match="printer bed"):
        build(make_parabola(3, 3, scale_mm=150.0), tmp_path / "parts")
    with pytest.raises(InputError, match="mm apart as cut from sheet"):
        build(make_parabola(1, 2, gap_mm=0.1), tmp_path / "parts")
    assert list(tmp_path.iterdir()) == []


def test_an_interrupted_build_leaves_the_old_files(
    built_pair: Built, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    layout, _, _ = built_pair
    (tmp_path / "mirror_holder.step").write_text("old")

    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("cad.checks.check_files", interrupt)
    with pytest.raises(KeyboardInterrupt):
        build(layout, tmp_path)
    assert [file.name for file in tmp_path.iterdir()] == ["mirror_holder.step"]
    assert (tmp_path / "mirror_holder.step").read_text() == "old"


def test_a_folder_that_is_a_file_is_refused(built_pair: Built, tmp_path: Path) -> None:
    layout, _, _ = built_pair
    (tmp_path / "parts").write_text("")
    with pytest.raises(InputError, match="parts: cannot be written: File exists"):
        build(layout, tmp_path / "parts")


def test_a_missing_extra_is_named_with_its_command(
    built_pair: Built, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    layout, _, _ = built_pair
    for name in [name for name in sys.modules if name.startswith("cad.") and name != "cad.build"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "build123d", None)
    with pytest.raises(InputError, match=r'^build123d is not installed.*: pip install -e "\.\[cad\]"$'):
        cad.build.build(layout, tmp_path)
    # What is missing for another reason is a bug, and is not blamed on the installation.
    monkeypatch.setitem(sys.modules, "build123d", type(sys)("build123d"))
    monkeypatch.setitem(sys.modules, "cad.exports", None)
    with pytest.raises(ImportError):
        cad.build.build(layout, tmp_path)


def test_writers_that_fail_say_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("cad.exports.export_step", lambda *_, **__: False)
    monkeypatch.setattr("cad.exports.export_stl", lambda *_: False)
    for write, name in ((write_step, "a.step"), (write_stl, "a.stl")):
        with pytest.raises(OSError, match=rf"{name}: the ST\w+ writer failed"):
            write(tmp_path / name, Part())
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
@pytest.mark.parametrize(
    ("rows", "cols", "scale_mm", "surface", "thickness_mm"),
    [(2, 2, 40.0, "second", 2.0), (2, 4, 100.0, "first", 3.0), (4, 4, 60.0, "second", 1.0), (7, 7, 80.0, "first", 1.0)],
)
def test_other_sizes_build_and_pass(
    make_parabola: Callable[..., Layout],
    tmp_path: Path,
    rows: int,
    cols: int,
    scale_mm: float,
    surface: str,
    thickness_mm: float,
) -> None:
    layout = make_parabola(rows, cols, scale_mm=scale_mm, surface=surface, thickness_mm=thickness_mm, gap_mm=2.0)
    checks = build(layout, tmp_path)
    assert {name for name, check in checks.items() if not check.passed} == set()
