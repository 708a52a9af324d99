"""`mirrorcam calibrate`: which options go together, what it refuses, and an exit code that tells of alarms."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from mirrorcam import cli
from mirrorcam.core.disk.output_folder import results_folder
from mirrorcam.core.images.pictures import write_image
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.boards import Charuco, Checkerboard, default_board, save_board
from mirrorcam.optics.geometry.calibrated_camera import CalibratedCamera
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.render_scenes.sets.render_set import render_set
from mirrorcam.render_scenes.sets.set_request import SetRequest
from mirrorcam.render_scenes.settings import RenderSettings
from tests.command_line import assert_refused_here
from tests.optics.calibration.sound_calibration import nominal_layout, sound_calibration
from tests.optics.layouts import faceted_parabola
from tests.optics.synthetic import posed

EITHER = "expected --layout FILE, or --direct-view N"


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        ("--base base.png", "--base needs --layout FILE or --direct-view N"),
        ("--model joint+bend", "model: bend needs mirrors"),
        ("--layout layout.json --camera c920", "--camera is of pictures without mirrors"),
        ("--direct-view 2 --layout layout.json", EITHER),
        ("--layout layout.json --model joint+turn", "model: turn needs a direct view"),
        ("--layout layout.json --model pinhole", "unknown word 'pinhole' of a model, expected auto"),
        ("--direct-view 145", "--direct-view '145': Input should be less than or equal to 144"),
        ("--layout nowhere.json", "no such file"),
    ],
)
def test_options_that_do_not_go_together_are_refused_in_one_line(
    arguments: str,
    expected: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert_refused_here(["calibrate", "picture.png", "--board", "board.toml", *arguments.split()], capfd, expected)
    assert list(tmp_path.iterdir()) == []


def test_pictures_without_a_corner_are_refused(
    tmp_path: Path, default_layout: Layout, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    default_layout.save(tmp_path / "layout.json")
    save_board(tmp_path / "board.toml", default_board())
    for name in ("one.png", "two.png", "base.png"):
        write_image(tmp_path / name, np.zeros((1080, 1920, 3), dtype=np.uint8))
    arguments = "calibrate one.png two.png --base base.png --layout layout.json --board board.toml --out calibrated"
    before = set(tmp_path.rglob("*"))
    assert_refused_here(arguments.split(), capfd, "no corner of the board found in any of 2 frames")
    # What was found in the pictures is kept, so that they are not searched again with better ones.
    kept = results_folder(tmp_path / "calibrated")
    assert {path for path in tmp_path.rglob("*") if path.is_file()} - before == set(kept.iterdir())


@pytest.mark.parametrize("option", ["--base b.png", "--live-hint"])
def test_corners_take_the_place_of_pictures(
    option: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    corners = "calibrate --corners a.csv --layout layout.json --board board.toml"
    assert_refused_here(f"{corners} {option}".split(), capfd, "--corners")
    both = "calibrate a.png --corners a.csv --layout layout.json --board board.toml"
    assert_refused_here(both.split(), capfd, "expected pictures, or --corners FILE")
    nominal_layout().save(tmp_path / "layout.json")
    save_board(tmp_path / "board.toml", default_board())
    (tmp_path / "a.csv").write_text("picture,view,corner,x_px,y_px\na,0-0,0,1,2\na,9-0,0,1,2\n")
    assert_refused_here(
        corners.split(), capfd, "a.csv, line 3: view '9-0', expected direct or a mirror from 0-0 to 1-1"
    )
    assert not (tmp_path / "output").exists()


@pytest.mark.parametrize("alarms", [(), ("the mirrors bend",)])
def test_an_alarm_is_printed_and_ends_it_with_1(
    alarms: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    sound = sound_calibration()
    assert sound.diagnostics is not None
    found = replace(sound, notes=("a note",), diagnostics=replace(sound.diagnostics, alarms=alarms))
    written: list[Path] = []
    files = "mirrorcam.calibration.calibration_files"
    monkeypatch.setattr(f"{files}.calibrate_files", lambda *arguments, **options: found)
    monkeypatch.setattr(f"{files}.write_calibration", lambda result, folder, command: written.append(folder))
    arguments = ["calibrate", "picture.png", "--board", "board.toml", "--layout", "layout.json", "--out", str(tmp_path)]
    assert cli.main(arguments) == len(alarms)
    printed = capfd.readouterr().out
    assert "a note" in printed
    assert ("alarm: the mirrors bend" in printed) == bool(alarms)
    assert "mirror 0" not in printed  # figures of single mirrors are in the report
    assert [folder.is_relative_to(tmp_path) for folder in written] == [True]


CAMERA = Camera(name="small", width_px=960, height_px=540, fx_px=680.0, fy_px=680.0, cx_px=479.5, cy_px=269.5)


def layout_of(rows: int, cols: int) -> Layout:
    return faceted_parabola(CAMERA, DesignSpec(camera=CAMERA, rows=rows, cols=cols), fill=0.92)


@pytest.fixture(scope="module")
def six_mirrors(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A set of a device of 2 x 3 mirrors."""
    folder = tmp_path_factory.mktemp("six") / "set"
    board = Charuco(cols=12, rows=8, square_mm=24.0, marker_mm=18.0)
    settings = RenderSettings(renderer="fast", maps=False)
    request = SetRequest(layout=layout_of(2, 3), board=board, frames=7, base_frames=5, seed=1, settings=settings)
    render_set(request, folder)
    return folder


@pytest.mark.slow
@pytest.mark.parametrize("same_places", [True, False])
def test_a_layout_of_four_mirrors_for_a_device_of_six_ends_with_1(
    six_mirrors: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str], *, same_places: bool
) -> None:
    own = layout_of(2, 3)
    four = own.replaced(cols=2, mirrors=tuple(own.mirrors[number] for number in (0, 1, 3, 4)))
    (four if same_places else layout_of(2, 2)).save(tmp_path / "layout.json")
    pictures = [str(six_mirrors / "frames"), "--base", str(six_mirrors / "base")]
    options = ["--board", str(six_mirrors / "board.toml"), "--out", str(tmp_path / "out")]
    assert cli.main(["calibrate", *pictures, *options, "--layout", str(six_mirrors / "layout.json")]) == 0
    assert cli.main(["calibrate", *pictures, *options, "--layout", str(tmp_path / "layout.json")]) == 1
    alarm = re.compile("alarm: boards in [67] of 7 frames belong to no mirror of the layout")
    cause = "the frames seem to show 2 x 3, the layout has 2 x 2 mirrors"
    (line,) = (line for line in capfd.readouterr().out.splitlines() if alarm.search(line))
    assert cause in line
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert "Do not use it" in page
    assert cause in page
    metrics = json.loads((tmp_path / "out" / "metrics.json").read_text(encoding="utf-8"))
    assert metrics["alarms"]["value"] >= 1
    assert metrics["frames_with_unknown_mirrors"]["value"] >= 6, "a wrong mirror may explain one board by chance"


def board_picture(board: Checkerboard, pose: FloatArray) -> NDArray[np.uint8]:
    """A picture of a board by a pinhole camera of 640 x 480 px, by its homography."""
    per_square = 40
    sheet = cv2.copyMakeBorder(board.image(per_square), 40, 40, 40, 40, cv2.BORDER_CONSTANT, value=255)
    mm_per_px = board.square_mm / per_square
    # The middle of the sheet's pixel (40, 40) is half a pixel inside the print's outer corner.
    board_from_sheet = np.array([[mm_per_px, 0, -39.5 * mm_per_px], [0, mm_per_px, -39.5 * mm_per_px], [0, 0, 1]])
    matrix = np.array([[600.0, 0, 319.5], [0, 600.0, 239.5], [0, 0, 1]])
    homography = matrix @ pose[:3, [0, 1, 3]] @ board_from_sheet
    grey = cv2.warpPerspective(sheet, homography, (640, 480), flags=cv2.INTER_AREA, borderValue=128)
    return np.asarray(cv2.GaussianBlur(grey, (0, 0), 0.7), dtype=np.uint8)


def test_a_camera_without_mirrors_is_calibrated_from_its_pictures(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    board, random = Checkerboard(cols=8, rows=5, square_mm=20.0), np.random.default_rng(2)
    save_board(tmp_path / "board.toml", board)
    for number in range(8):
        centre = np.array([*random.uniform(-45.0, 45.0, 2), random.uniform(220.0, 320.0)])
        pose = posed(board, centre, random.uniform(-30.0, 30.0, 3), direct=True)
        write_image(tmp_path / "pictures" / f"{number}.png", board_picture(board, pose))
    box = ((-20.0, -15.0, -10.0), (20.0, 15.0, 3.0))
    nominal = Camera(width_px=640, height_px=480, fx_px=500.0, fy_px=500.0, cx_px=320.0, cy_px=240.0, body_mm=box)
    (tmp_path / "nominal.json").write_text(nominal.model_dump_json())
    options = "--board board.toml --model joint --camera nominal.json --out mine"
    code = cli.main(["calibrate", "pictures", *options.split()])
    printed = capfd.readouterr().out
    assert code in (0, 1), printed
    assert {path.name for path in (tmp_path / "mine").iterdir()} >= {"camera.json", "report.html", "corners.csv"}
    camera = CalibratedCamera.load(tmp_path / "mine" / "camera.json").camera
    assert camera.fx_px == pytest.approx(600.0, rel=0.01)
    assert camera.cx_px == pytest.approx(319.5, abs=6.0)
    assert camera.body_mm == box
    assert "Uncertainty of the camera" in (tmp_path / "mine" / "report.html").read_text()
    assert cli.main(["camera", "export", "mine/camera.json", "--out", "exported"]) == 0
    exported = cv2.FileStorage(str(tmp_path / "exported" / "opencv.yaml"), cv2.FILE_STORAGE_READ)
    matrix = exported.getNode("views").at(0).getNode("camera_matrix").mat()
    np.testing.assert_allclose(matrix, camera.matrix)
    capfd.readouterr()
    few = ["calibrate", "pictures/0.png", "pictures/1.png", "--board", "board.toml", "--out", "few"]
    assert_refused_here(few, capfd, "seen in 2 different views, expected 3 or more")
    same = ["calibrate", "pictures/0.png", "pictures/0.png", "pictures/0.png", "--board", "board.toml", "--out", "same"]
    assert_refused_here(same, capfd, "seen in 1 different view, expected 3 or more")
    assert_refused_here(["camera", "export", "mine/camera.json", "--pictures", "pictures"], capfd, "needs a layout")
