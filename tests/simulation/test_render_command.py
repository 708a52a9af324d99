"""`mirrorcam render`: what it refuses, what becomes of a set that is interrupted, and what verify finds."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mirrorcam import cli
from mirrorcam.core.disk.files import write_json
from mirrorcam.optics.geometry.boards import save_board
from mirrorcam.render_scenes.sets.dataset import Dataset, DepthRange
from mirrorcam.render_scenes.sets.set_request import SetRequest
from mirrorcam.render_scenes.settings import SENSORS, SurfaceFinish
from mirrorcam.simulation.render_command import depth_range_text
from mirrorcam.simulation.render_request import RenderRequest
from tests.command_line import assert_refused_here
from tests.small_set import contents

# Not by importing it: that would choose an LLVM.
pytestmark = pytest.mark.skipif(find_spec("mitsuba") is None, reason="rendering needs the extra render")
ROOT = Path(__file__).parents[2]
# The command that asks for the fixture `set_request`.
OPTIONS = "--frames 6 --base-frames 2 --renderer fast --seed 5 --board board.toml --out set"


@pytest.fixture
def folder(tmp_path: Path, set_request: SetRequest, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The working folder, with layout.json and board.toml."""
    set_request.layout.save(tmp_path / "layout.json")
    save_board(tmp_path / "board.toml", set_request.board)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def command(options: str, **settings: Any) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-m", "mirrorcam", "render", "layout.json", *options.split()],
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        encoding="utf-8",
        **settings,
    )


def test_settings_come_from_a_file_and_the_options_beside_it(set_request: SetRequest, tmp_path: Path) -> None:
    layout = set_request.layout
    assert RenderRequest().read(layout) == SetRequest(layout=layout)
    file = tmp_path / "settings.toml"
    lines = (
        'renderer = "fast"',
        "spp = 4",
        "maps = false",
        "[sensor]",
        "prnu_percent = 2.0",
        "[finish]",
        'bend = "cylinder"',
    )
    file.write_text("\n".join(lines))
    read = RenderRequest(settings=file).read(layout).settings
    assert (read.renderer, read.spp, read.maps, read.sensor.prnu_percent) == ("fast", 4, False, 2.0)
    assert read.finish == SurfaceFinish(bend="cylinder")
    given = RenderRequest.model_validate({"settings": file, "renderer": "mitsuba", "sensor": "poor"}).read(layout)
    assert given.settings == read.replaced(renderer="mitsuba", sensor=SENSORS["poor"])


@pytest.mark.slow
@pytest.mark.parametrize(("ending", "code"), [(signal.SIGKILL, -9), (signal.SIGINT, 130)])
def test_a_set_ended_in_the_middle_has_whole_files_and_is_continued(
    ending: signal.Signals, code: int, folder: Path, finished_set: Path
) -> None:
    whole = contents(finished_set)
    with command(f"{OPTIONS} --workers 2") as running:
        until = time.monotonic() + 60
        while not list((folder / "set" / "frames").glob("*.jpg")):
            assert running.poll() is None, running.communicate()
            assert time.monotonic() < until
            time.sleep(0.005)
        running.send_signal(ending)
        _, complaint = running.communicate(timeout=60)
    assert running.returncode == code
    assert complaint == ("mirrorcam: interrupted; finished files are complete\n" if code == 130 else "")
    kept = {name: content for name, content in contents(folder / "set").items() if "/." not in f"/{name}"}
    pictures = [name for name in kept if name.endswith(".jpg")]
    assert 1 <= len(pictures) < 8
    assert all(content == whole[name] for name, content in kept.items() if name != "dataset.json")
    written = {name: (folder / "set" / name).stat().st_mtime_ns for name in pictures}

    assert cli.main(["render", "verify", "set"]) == 1
    assert cli.main(["render", "layout.json", *OPTIONS.split(), "--workers", "1"]) == 0
    assert contents(folder / "set") == whole
    recorded = [name for name in pictures if (folder / "set" / name).stat().st_mtime_ns == written[name]]
    # At most the last picture was written but not yet recorded.
    assert len(recorded) >= len(pictures) - 1
    assert cli.main(["render", "verify", "set"]) == 0


def test_where_no_scheduler_answers_it_is_said_in_one_line(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("distributed", reason="a cluster needs the extra cluster")
    monkeypatch.setattr("mirrorcam.core.processes.cluster.SECONDS_TO_CONNECT", 0.5)
    arguments = ["render", "layout.json", *OPTIONS.split(), "--scheduler", "tcp://127.0.0.1:9"]
    assert_refused_here(
        arguments, capsys, "mirrorcam: --scheduler tcp://127.0.0.1:9: no Dask scheduler answers there: "
    )


@pytest.mark.slow
def test_it_says_what_the_frames_cover(folder: Path, finished_set: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["render", "layout.json", *OPTIONS.split(), "--workers", "1"]) == 0
    dataset = Dataset.load(folder / "set")
    percent = [f"{100 * part:.0f}" for part in dataset.coverage]
    rows = " / ".join(" ".join(percent[row : row + 3]) for row in (0, 3, 6))
    bare = f"{100 * dataset.base_coverage:.0f} % of base frames"
    capfd_out = capfd.readouterr().out
    assert f"corners cover {rows} % of the sub-images, {bare}" in capfd_out
    assert min(dataset.coverage) > 0.1
    assert f"every mirror shows boards from {max(r.nearest_mm for r in dataset.reaches)} to " in capfd_out
    assert contents(folder / "set") == contents(finished_set)


def test_verify_names_what_is_altered_and_what_is_missing(
    folder: Path, finished_set: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    for name, content in contents(finished_set).items():
        (folder / "set" / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / "set" / name).write_bytes(content)
    assert cli.main(["render", "verify", "set"]) == 0
    assert f"{len(Dataset.load(finished_set).files)} files as rendered" in capfd.readouterr().out
    altered = bytearray(contents(finished_set)["truth/maps/frames/0001.exr"])
    altered[-1] ^= 1
    (folder / "set" / "truth" / "maps" / "frames" / "0001.exr").write_bytes(altered)
    (folder / "set" / "frames" / "0002.jpg").unlink()
    assert cli.main(["render", "verify", "set"]) == 1
    said = capfd.readouterr().out
    assert "set/truth/maps/frames/0001.exr is altered" in said
    assert "set/frames/0002.jpg is missing" in said
    assert said.count("\n") == 2
    # What is gone is rendered again; what was changed is somebody's work.
    assert cli.main(["render", "layout.json", *OPTIONS.split(), "--workers", "1"]) == 2
    assert "0001.exr: was changed since it was written, expected it unchanged or removed" in capfd.readouterr().err
    (folder / "set" / "truth" / "maps" / "frames" / "0001.exr").unlink()
    assert cli.main(["render", "layout.json", *OPTIONS.split(), "--workers", "1"]) == 0
    assert contents(folder / "set") == contents(finished_set)


def test_verify_counts_what_has_not_been_rendered(
    folder: Path, finished_set: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    dataset = Dataset.load(finished_set)
    some = {name: digest for name, digest in dataset.files.items() if name in ("layout.json", "frames/0000.jpg")}
    for name in some:
        (folder / "set" / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / "set" / name).write_bytes((finished_set / name).read_bytes())
    dataset.replaced(files=some).save(folder / "set")
    assert cli.main(["render", "verify", "set"]) == 1
    assert "7 files not rendered yet, frames/0001.jpg first" in capfd.readouterr().out


@pytest.mark.slow
def test_poses_of_a_file_are_those_of_the_set(folder: Path, finished_set: Path) -> None:
    poses = json.loads((finished_set / "truth" / "poses.json").read_text(encoding="utf-8"))["frames"][1:3]
    write_json(folder / "poses.json", {"poses": poses})
    options = "--poses poses.json --base-frames 0 --renderer fast --board board.toml --workers 1"
    assert cli.main(["render", "layout.json", *options.split(), "--out", "two"]) == 0
    assert json.loads((folder / "two" / "truth" / "poses.json").read_text(encoding="utf-8"))["frames"] == poses
    assert Dataset.load(folder / "two").frame_names == ("frames/0000.jpg", "frames/0001.jpg")


@pytest.mark.slow
def test_a_motion_through_poses_of_a_file_is_a_video(folder: Path, finished_set: Path) -> None:
    import cv2

    poses = json.loads((finished_set / "truth" / "poses.json").read_text(encoding="utf-8"))["frames"][1:4]
    write_json(folder / "poses.json", {"poses": poses, "poses_hz": 4.0})
    (folder / "settings.toml").write_text('renderer = "fast"\nvideo = "avi"\nmaps = false\n')
    options = "--poses poses.json --rate-hz 12 --base-frames 0 --board board.toml --settings settings.toml"
    assert cli.main(["render", "layout.json", *options.split(), "--workers", "1", "--out", "moving"]) == 0
    # Two steps between poses at 4 poses and 12 frames a second.
    dataset = Dataset.load(folder / "moving")
    assert dataset.frames == 7
    assert "video.avi" in dataset.files
    truth = np.array(json.loads((folder / "moving" / "truth" / "poses.json").read_text(encoding="utf-8"))["frames"])
    np.testing.assert_allclose(truth[::3], poses, atol=1e-9)
    video = cv2.VideoCapture(str(folder / "moving" / "video.avi"))
    assert video.get(cv2.CAP_PROP_FPS) == 12.0
    assert video.get(cv2.CAP_PROP_FRAME_COUNT) == 7.0


def poses_with(value: float, row: int, column: int) -> dict[str, object]:
    pose = np.eye(4)
    pose[row, column] = value
    return {"poses": [np.eye(4).tolist(), pose.tolist()]}


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        ("--sensor c910", "--sensor 'c910': expected ideal, c920, poor, webcam or a .toml file"),
        ("--sensor none.toml", "none.toml: no such file"),
        ("--sensor both.toml", "both.toml: jpeg_quality and h264_crf: expected at most one of the two"),
        ("--as-built tilt=0.3", "--as-built 'tilt=0.3': tilt is not a tolerance, expected tilt_deg, offset_mm"),
        ("--as-built tilt_deg=-1", "tilt_deg: Input should be greater than or equal to 0"),
        ("--as-built tilt_deg", "tilt_deg: Input should be a valid number"),
        ("--as-built offset_mm=100", "reduce the tolerances"),
        ("--poses nan.json", "nan.json: poses: holds a value that is NaN or infinite"),
        ("--poses scaled.json", "scaled.json: pose 1 has a matrix that is not a rotation"),
        ("--poses mirrored.json", "mirrored.json: pose 1 has a matrix that is not a rotation"),
        ("--poses sheared.json", "sheared.json: pose 1 has the last row"),
        ("--poses unseen.json", "none of 2 poses shows a corner of the board in a mirror"),
        ("--rate-hz 30 --frames 1", "rate_hz: one pose is not a motion"),
        ("--rate-hz 0", "--rate-hz '0': Input should be greater than or equal to 0.01"),
        ("--settings mp4.toml", "video mp4: a video shows a motion, expected --rate-hz with it"),
        ("--settings avi.toml --rate-hz 9 --sensor ideal", "video avi"),
        ("--settings bent.toml --renderer fast", "renderer fast: mirrors are smooth and flat, expected sag_mm 0"),
        ("--settings wide.toml", "wide.toml: spp: Input should be less than or equal to 65536"),
        ("--settings none.toml", "none.toml: no such file"),
        ("--parts .", ".: no assembly.glb and no .stl files, expected a folder that `mirrorcam cad` wrote"),
        ("--parts mine --renderer fast", "renderer fast"),
        ("--workers 0", "--workers '0': expected 1 to 1024"),
        ("--workers 2 --scheduler tcp://x:1", "--workers and --scheduler: expected one of the two"),
        ("--out mine", "mine: has 'truth' but no dataset.json, expected a new or empty folder"),
        ("--out layout.json", "layout.json: is a file, expected a folder"),
    ],
)
def test_bad_input_is_refused_in_one_line_and_nothing_is_written(
    folder: Path, options: str, complaint: str, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / "nan.json").write_text('{"poses": [[[1, 0, 0, NaN], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]]}')
    write_json(folder / "scaled.json", poses_with(2.0, 0, 0))
    write_json(folder / "mirrored.json", poses_with(-1.0, 0, 0))
    write_json(folder / "sheared.json", poses_with(0.5, 3, 0))
    write_json(folder / "unseen.json", poses_with(9.0, 0, 3))
    (folder / "both.toml").write_text("jpeg_quality = 90\nh264_crf = 20\n", encoding="utf-8")
    (folder / "bent.toml").write_text("[finish]\nsag_mm = 0.1\n", encoding="utf-8")
    (folder / "wide.toml").write_text("spp = 100000\n", encoding="utf-8")
    for name in ("mp4", "avi"):
        (folder / f"{name}.toml").write_text(f'video = "{name}"\n', encoding="utf-8")
    (folder / "mine" / "truth").mkdir(parents=True)
    before = contents(folder)
    arguments = ["render", "layout.json", "--board", "board.toml", "--base-frames", "0", *options.split()]
    assert_refused_here(arguments, capsys, complaint)
    assert contents(folder) == before
    assert not (folder / "output").exists()


def test_a_full_disk_ends_it_in_one_line_without_a_part_of_a_picture(
    folder: Path, finished_set: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    resource = pytest.importorskip("resource", reason="only POSIX limits the size of files")
    limit = 12_000  # for one file, which is less than a frame

    def small_file_limit() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))

    assert len(contents(finished_set)["frames/0000.jpg"]) > limit
    options = f"{OPTIONS} --workers 1"
    # Python does not notice that it has written a part of its bytecode, and fails when it reads that.
    monkeypatch.setenv("PYTHONDONTWRITEBYTECODE", "1")
    with command(options, preexec_fn=small_file_limit) as running:
        _, said = running.communicate(timeout=60)
    assert (running.returncode, said.count("\n")) == (2, 1)
    assert "cannot be written: File too large" in said
    assert not [name for name in contents(folder / "set") if name.endswith(".jpg") or "/." in f"/{name}"]


NAMES = tuple(f"{row}-{column}" for row in range(3) for column in range(3))


def test_a_mirror_that_shows_no_board_is_named(finished_set: Path) -> None:
    dataset = Dataset.load(finished_set)
    none = DepthRange(nearest_mm=0, farthest_mm=0, tilt_deg=0)
    blind = dataset.replaced(reaches=(none, *dataset.reaches[1:7], none, dataset.reaches[8]))
    assert depth_range_text(blind, NAMES) == "mirror 0-0, 2-1 shows too few corners in every frame"
    near = DepthRange(nearest_mm=250, farthest_mm=400, tilt_deg=50)
    far = DepthRange(nearest_mm=300, farthest_mm=500, tilt_deg=40)
    both = dataset.replaced(reaches=(near, far))
    assert (
        depth_range_text(both, NAMES[:2]) == "every mirror shows boards from 300 to 400 mm away and tilted by up to 40°"
    )
