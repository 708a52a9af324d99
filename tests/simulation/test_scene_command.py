"""`mirrorcam scene`: what it makes, what it refuses, and what becomes of a scene that is interrupted."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from importlib.util import find_spec
from pathlib import Path

import pytest

from mirrorcam import cli
from mirrorcam.core.disk.output_folder import HIDDEN
from mirrorcam.core.errors import InputError
from mirrorcam.core.images.pictures import read_image
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.simulation.render_request import mesh_from_text
from tests.command_line import assert_refused_here

# Not by importing it: that would choose an LLVM.
pytestmark = pytest.mark.skipif(find_spec("mitsuba") is None, reason="rendering needs the extra render")
OPTIONS = ("layout.json", "--out", "tabletop", "--seed", "2", "--depths-mm", "320", "450")


def contents(folder: Path) -> dict[str, bytes]:
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file() and HIDDEN not in path.parts
    }


@pytest.fixture
def here(fold_90_layout: Layout, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder to work in, with a layout of views square to the camera before a sensor of 240 x 136 pixels."""
    full = fold_90_layout.camera
    focal = {"fx_px": full.fx_px / 8.0, "fy_px": full.fy_px / 8.0}
    camera = Camera(width_px=240, height_px=136, cx_px=119.5, cy_px=67.5, **focal)
    fold_90_layout.replaced(camera=camera).save(tmp_path / "layout.json")
    text = "v 0 0 0\nv 10 0 0\nv 0 60 0\nv 0 0 9\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
    (tmp_path / "a.obj").write_text(text, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.slow
def test_a_scene_that_is_killed_is_continued_to_the_same_bytes(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["scene", *OPTIONS]) == 0
    assert "scene.json written" in capsys.readouterr().out
    whole = contents(here / "tabletop")
    assert "frames/0000.jpg" in whole
    assert "truth/disparity/2_2.exr" in whole

    look = read_image(here / "tabletop/truth/overview.jpg").astype(int)
    assert look.shape[0] == 480
    # Below, right: how near things are. The desk's front is red, the wall behind it blue.
    assert look[-5, -60, 0] > look[-5, -60, 2] + 40
    assert look[252, -60, 2] > look[252, -60, 0]
    (here / "tabletop").rename(here / "whole")
    process = subprocess.Popen([sys.executable, "-m", "mirrorcam", "scene", *OPTIONS], stdout=subprocess.DEVNULL)
    begun = time.monotonic()
    while not (here / "tabletop/truth/views").exists() and process.poll() is None and time.monotonic() < begun + 60.0:
        time.sleep(0.005)
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    left = contents(here / "tabletop")
    finished = {name for name in left if not Path(name).name.startswith(".") and name != "scene.json"}
    assert 0 < len(finished) < len(whole) - 1
    assert all(left[name] == whole[name] for name in finished)
    assert cli.main(["scene", *OPTIONS]) == 0
    assert contents(here / "tabletop") == whole


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        (["none.json"], "none.json: no such file"),
        (["layout.json", "--depths-mm", "500", "300"], "depths 500, 300 mm: expected one or more, ascending"),
        (["layout.json", "--depths-mm", "60"], "depth 60 mm: an object there would touch the camera"),
        (["layout.json", "--sensor", "best"], "--sensor 'best': expected ideal, c920, poor, webcam or a .toml file"),
        (["layout.json", "--as-built", "tilt=1"], "--as-built 'tilt=1': tilt is not a tolerance"),
        (["layout.json", "--mesh", "gone.stl"], "gone.stl: no such file"),
        (["layout.json", "--mesh", "layout.json"], "layout.json: not a readable mesh, expected .stl, .ply, .obj"),
        (["layout.json", "--mesh", "a.obj:0,0,90"], "a.obj: reaches to a depth of 60 mm, expected no less than 67"),
        (["layout.json", "--mesh", "a.stl:1,2,far"], "--mesh a.stl:1,2,far: expected FILE or FILE:x,y,z"),
        (["layout.json", "--mesh", "a.stl:1,2,nan"], "--mesh a.stl:1,2,nan: expected FILE or FILE:x,y,z"),
    ],
)
def test_bad_input_is_refused_in_one_line_and_leaves_nothing(
    here: Path, capsys: pytest.CaptureFixture[str], options: list[str], complaint: str
) -> None:
    assert_refused_here(["scene", *options, "--out", "tabletop"], capsys, complaint)
    assert not (here / "tabletop").exists()


def test_a_mesh_may_have_a_place() -> None:
    placed = mesh_from_text("parts/a.stl:10,-30.5,350")
    assert placed.file == Path("parts/a.stl")
    assert placed.position_in_view_mm is not None
    assert placed.position_in_view_mm.tolist() == [10.0, -30.5, 350.0]
    alone = mesh_from_text("odd:name.ply")
    assert alone.file == Path("odd:name.ply")
    assert alone.position_in_view_mm is None
    with pytest.raises(InputError, match=r"^--mesh a\.stl:1,2,x: expected FILE or FILE:x,y,z in mm, view axes$"):
        mesh_from_text("a.stl:1,2,x")
