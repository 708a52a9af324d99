"""`mirrorcam cad`: what it refuses, which checks it prints, and its exit code."""

from __future__ import annotations

from pathlib import Path

import pytest

from mirrorcam import cli
from mirrorcam.core.errors import InputError
from mirrorcam.core.values import Metric
from mirrorcam.optics.geometry.layout import Layout
from tests.command_line import assert_refused_here


@pytest.mark.parametrize(("arguments", "expected"), [("", "LAYOUT"), ("nowhere.json", "nowhere.json: no such file")])
def test_without_a_layout_it_is_refused_in_one_line(
    arguments: str,
    expected: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert_refused_here(["cad", *arguments.split()], capfd, expected)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        ("--body nikon", "camera 'nikon': expected one of arducam_b0196, board_38, brio, c920, c922, d435"),
        ("--body nikon.toml", "nikon.toml: no such file"),
        ("--hardware mine.toml", "mine.toml: no such file"),
        ("--mounting nut", "--mounting 'nut': Input should be 'glue', 'tape' or 'screws'"),
        ("--workers 0", "--workers '0': expected 1 to 1024"),
    ],
)
def test_bad_options_are_refused_in_one_line(
    default_layout: Layout,
    tmp_path: Path,
    arguments: str,
    expected: str,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    default_layout.save(tmp_path / "layout.json")
    assert_refused_here(["cad", "layout.json", *arguments.split()], capfd, expected)
    assert [path.name for path in tmp_path.iterdir()] == ["layout.json"]


@pytest.mark.parametrize(
    ("name", "adapter"),
    [
        *((name, "none") for name in ("parts/mount.stl", "drawings/camera_clip.pdf", "pictures", "bom.csv/x")),
        ("pictures/exploded.png", "none"),
        *(("robot", "gen2"), ("robot/meshes/mirror_holder_hull.stl", "gen2"), ("robot/meshes/mirrors.stl", "iso9409")),
        *(("robot", "none"), ("elasticity.md", "none")),
    ],
)
@pytest.mark.parametrize("force", [False, True])
def test_files_of_others_are_refused_before_the_work(
    name: str,
    adapter: str,
    force: bool,
    small_layout: Layout,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    def build_parts(*arguments: object, **options: object) -> None:
        raise InputError("the work begins")

    monkeypatch.setattr("mirrorcam.cad.build.build_parts", build_parts)
    small_layout.save(tmp_path / "layout.json")
    other = tmp_path / "out" / name
    other.parent.mkdir(parents=True)
    other.write_text("mine")
    arguments = ["cad", str(tmp_path / "layout.json"), "--adapter", adapter, "--out", str(tmp_path / "out")]
    assert cli.main([*arguments, *(["--force"] if force else [])]) == 2
    is_own = adapter == "none" and name in ("robot", "elasticity.md")  # files of another device
    can_be_forced = force and "/" in name and not name.startswith("bom")
    assert ("the work begins" in capfd.readouterr().err) == (is_own or can_be_forced)
    assert other.read_text() == "mine"


def test_a_missing_extra_is_named_with_the_command_that_installs_it(
    tmp_path: Path, small_layout: Layout, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    small_layout.save(tmp_path / "layout.json")
    found = {"build123d": None}
    monkeypatch.setattr("mirrorcam.core.extras.find_spec", lambda module: found.get(module, object()))
    assert cli.main(["cad", "layout.json"]) == 2
    assert capfd.readouterr().err == (
        'mirrorcam: build123d not installed, needed for this command: pip install "mirrorcam[cad]"\n'
    )


@pytest.mark.parametrize(("camera", "said"), [("board_38", True), ("c920", False)])
def test_a_body_that_cannot_be_compared_with_the_layout_is_named(
    default_layout: Layout,
    camera: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
    *,
    said: bool,
) -> None:
    monkeypatch.chdir(tmp_path)
    default_layout.save(tmp_path / "layout.json")
    monkeypatch.setattr("mirrorcam.cad.build.build_parts", lambda *_, **__: {})
    assert cli.main(["cad", "layout.json", "--body", camera]) == 0
    line = "states no field_of_view_deg: cannot compare it with the layout's, 70.4 x 43.3 deg"
    assert (line in " ".join(capfd.readouterr().out.split())) == said


@pytest.mark.parametrize(
    ("size_mm", "code", "words"),
    [(1.0, 0, "3 checks passed, 1 figure without a limit"), (0.5, 1, "1 of 3 checks failed, 1 figure without")],
)
def test_it_prints_what_fails_and_the_device_as_a_whole(
    size_mm: float,
    code: int,
    words: str,
    small_layout: Layout,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    checks = {
        "device.parts": Metric(value=7.0, unit="1"),
        "device.clearance_mm": Metric(value=2.0, unit="mm", limit=1.0, lower_is_better=False),
        "holder.seat_error_mm": Metric(value=0.0, unit="mm", limit=0.001),
        "holder.wall_mm": Metric(value=size_mm, unit="mm", limit=0.8, lower_is_better=False),
    }
    monkeypatch.setattr("mirrorcam.device.cad_command.require", lambda *extras: None)
    monkeypatch.setattr("mirrorcam.cad.build.build_parts", lambda *given, **options: checks)
    small_layout.save(tmp_path / "layout.json")
    assert cli.main(["cad", str(tmp_path / "layout.json"), "--out", str(tmp_path / "cad")]) == code
    printed = capfd.readouterr().out
    assert words in printed
    table = [line for line in printed.splitlines() if "pass" in line.split()[-1:] or "FAIL" in line]
    assert len(table) == 1 + code
    assert "seat" not in printed.lower()
    assert ("FAIL" in printed) == bool(code)
