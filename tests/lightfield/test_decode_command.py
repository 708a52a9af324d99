"""`mirrorcam decode` of videos and cameras: streamed, gone on with, and honest about what was lost."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import cv2
import numpy as np
import pytest

from mirrorcam import cli
from mirrorcam.core.disk.output_folder import HIDDEN
from mirrorcam.core.images.pictures import read_image, write_image
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.light_field.decoder import Decoder
from mirrorcam.optics.light_field.frame_checks import layout_identity_of
from mirrorcam.optics.light_field.io.formats.mcap import StoredBag
from mirrorcam.optics.light_field.io.formats.npz import load_npz
from mirrorcam.optics.light_field.io.formats.registry import open_light_field
from mirrorcam.optics.light_field.io.zarr_store import StoredLightFields
from tests.command_line import results
from tests.core.video.camera_bags import START_NS, STEP_NS, raw, write_bag
from tests.core.video.videos import cut, damage, pictures, write_h264, write_mjpeg
from tests.optics.layouts import faceted_parabola

COUNT = 30


@pytest.fixture(scope="module")
def layout() -> Layout:
    camera = Camera(width_px=320, height_px=192, fx_px=230.0, fy_px=230.0, cx_px=159.5, cy_px=95.5)
    return faceted_parabola(camera, DesignSpec(camera=camera), fill=0.9).replaced(kind="calibrated")


@pytest.fixture
def here(tmp_path: Path, layout: Layout, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with layout.json and video.mp4, in which commands run."""
    layout.save(tmp_path / "layout.json")
    write_h264(tmp_path / "video.mp4", pictures(COUNT, 320, 192))
    monkeypatch.chdir(tmp_path)
    return tmp_path


def content(folder: Path) -> dict[str, bytes]:
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file() and HIDDEN not in path.parts
    }


def refused(arguments: str, capfd: pytest.CaptureFixture[str]) -> str:
    """The one line with which a command is refused."""
    capfd.readouterr()
    assert cli.main(f"decode {arguments} --layout layout.json".split()) == 2
    said = capfd.readouterr().err
    assert said.count("\n") == 1, said
    return said


def test_a_video_becomes_one_zarr_group_and_a_picture(
    here: Path, layout: Layout, capfd: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(["decode", "video.mp4", "--layout", "layout.json", "--out", "out"]) == 0
    captured = capfd.readouterr()
    assert captured.err == ""
    assert "30 frames" in captured.out
    assert "skipped" not in captured.out
    assert results(here / "out") == ["video.zarr", "video_drift.json", "video_views.png"]
    stored = StoredLightFields(here / "out" / "video.zarr")
    assert stored.numbers == tuple(range(COUNT))
    assert stored[3].layout_identity == layout.identity
    assert stored.about["source"]["file"] == "video.mp4"
    height, width = stored[0].samples.shape[2:4]
    assert read_image(here / "out" / "video_views.png").shape == (3 * height + 6, 3 * width + 6, 3)
    before = content(here)
    assert cli.main(["decode", "video.mp4", "--layout", "layout.json", "--out", "out"]) == 0
    assert "exists already, from the same frames" in capfd.readouterr().out
    assert content(here) == before
    assert "exists and holds something else" in refused("video.mp4 --field union --out out", capfd)
    assert content(here) == before


@pytest.mark.parametrize("to", ["hci", "stanford"])
def test_a_video_becomes_a_folder_of_pictures_per_frame(here: Path, to: str) -> None:
    arguments = f"decode video.mp4 --layout layout.json --to {to} --limit 4 --out out"
    assert cli.main(arguments.split()) == 0
    folders = sorted(path.name for path in (here / "out" / "video").iterdir())
    assert folders == ["000000", "000001", "000002", "000003", "frames.json"]
    assert cli.main(["decode", "video.mp4", "--layout", "layout.json", "--limit", "4", "--out", "out"]) == 0
    for number in range(4):
        found = open_light_field(here / "out" / "video" / folders[number])
        expected = open_light_field(here / "out" / "video.zarr", frame=number)
        assert np.array_equal(found.samples, expected.samples)
        assert np.allclose(found.positions_mm, expected.positions_mm)


def test_what_is_damaged_is_skipped_named_and_counted(here: Path, capfd: pytest.CaptureFixture[str]) -> None:
    damage(here / "video.mp4", 14)
    write_mjpeg(here / "webcam.avi", pictures(COUNT, 320, 192))
    damage(here / "webcam.avi", 5)
    cut(here / "webcam.avi", 0.8)
    assert cli.main(["decode", "video.mp4", "webcam.avi", "--layout", "layout.json", "--out", "out"]) == 1
    said = capfd.readouterr().out
    assert "video: skipped 1 of 30 frames, each is damaged: 14" in said
    assert "video: skipped 5 of 30 frames, each depends on a damaged one: 15 to 19" in said
    assert re.search(r"webcam: skipped [12] of 2\d frames, each is damaged: 5", said)
    assert re.search(r"webcam: ends after 2\d of 30 frames; the file is cut off", said)
    stored = StoredLightFields(here / "out" / "video.zarr")
    assert stored.numbers == (*range(14), *range(20, 30))
    assert list(stored.lost) == [14, 15, 16, 17, 18, 19]


@pytest.mark.slow
def test_an_interrupted_run_is_gone_on_with(here: Path, layout: Layout) -> None:
    count = 400
    write_mjpeg(here / "long.avi", pictures(40, 320, 192) * (count // 40))
    arguments = [sys.executable, "-m", "mirrorcam", "decode", "long.avi", "--layout", "layout.json", "--out"]
    for number, stop in enumerate((signal.SIGINT, signal.SIGKILL)):
        process = subprocess.Popen([*arguments, "cut"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        journal = here / "cut" / "long.zarr.partial" / "journal.jsonl"
        deadline = time.monotonic() + 60
        while not (journal.exists() and journal.read_bytes().count(b"\n") > 30 * (number + 1)):
            assert process.poll() is None
            assert time.monotonic() < deadline
            time.sleep(0.005)
        process.send_signal(stop)
        said, complaint = process.communicate(timeout=60)
        if stop == signal.SIGINT:
            assert process.returncode == 130
            assert complaint == "mirrorcam: interrupted; finished files are complete\n"
            assert "the same command resumes" in said
        assert 30 <= len(StoredLightFields(journal.parent)) < count
    assert cli.main(["decode", "long.avi", "--layout", "layout.json", "--out", "cut"]) == 0
    assert cli.main(["decode", "long.avi", "--layout", "layout.json", "--out", "whole"]) == 0
    assert len(StoredLightFields(here / "whole" / "long.zarr")) == count
    # Whether mirrors moved is told from frames that the last run has read.
    cut, whole = (
        {name: data for name, data in content(here / part).items() if name != "long_drift.json"}
        for part in ("cut", "whole")
    )
    assert cut == whole


def test_bad_videos_are_refused_in_one_line_before_anything_is_written(
    here: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    write_h264(here / "small.mp4", pictures(3))
    (here / "words.mp4").write_text("no video", encoding="utf-8")
    before = sorted(here.rglob("*"))
    assert "small.mp4: 160x96 px, expected 320x192 of layout.json's camera" in refused("video.mp4 small.mp4", capfd)
    assert "words.mp4: not a video that can be opened" in refused("words.mp4", capfd)
    assert "nowhere.mp4: no such file" in refused("nowhere.mp4", capfd)
    assert "expected frames, videos, or --live" in refused("video.mp4 --live 0", capfd)
    assert "two frames are called 'video'" in refused("video.mp4 video.avi", capfd)
    assert "camera 9 cannot be opened" in refused("--live 9", capfd)
    assert "the plane at 1 mm lies nearer than mirror" in refused("video.mp4 --reference-depth-mm 1", capfd)
    assert sorted(here.rglob("*")) == before


def test_a_video_without_a_good_frame_is_refused(here: Path, capfd: pytest.CaptureFixture[str]) -> None:
    write_mjpeg(here / "bad.avi", pictures(1, 320, 192))
    damage(here / "bad.avi", 0)
    assert "bad.avi: no frame could be decoded" in refused("bad.avi --out out", capfd)
    assert not (here / "out").exists()


def test_a_video_without_a_good_frame_does_not_keep_others_from_being_decoded(
    here: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    write_mjpeg(here / "bad.avi", pictures(1, 320, 192))
    damage(here / "bad.avi", 0)
    assert cli.main(["decode", "bad.avi", "video.mp4", "--layout", "layout.json", "--out", "out"]) == 1
    said = capfd.readouterr().out
    assert "bad: skipped 1 of 1 frames, each is damaged: 0" in said
    assert "bad.avi: no frame could be decoded, expected at least one; skipped" in said
    assert results(here / "out") == ["video.zarr", "video_drift.json", "video_views.png"]
    assert "bad.avi: no frame could be decoded" in refused("video.mp4 --out other --equalise bad.avi", capfd)


def test_frames_of_another_layout_are_refused_by_their_manifest(
    here: Path, layout: Layout, capfd: pytest.CaptureFixture[str]
) -> None:
    for schema, name in (("mirrorcam.dataset/1", "dataset.json"), ("mirrorcam.scene/1", "scene.json")):
        (here / "set" / "frames").mkdir(parents=True, exist_ok=True)
        write_image(here / "set" / "frames" / "0000.png", pictures(1, 320, 192)[0])
        manifest = here / "set" / name
        manifest.write_text(json.dumps({"schema": schema, "layout_identity": "feedfeedfeedfeed"}), encoding="utf-8")
        assert "was taken with layout feedfeedfeedfeed, expected" in refused("set/frames/0000.png", capfd)
        manifest.write_text(json.dumps({"schema": schema, "layout_identity": layout.identity}), encoding="utf-8")
        assert cli.main(f"decode set/frames/0000.png --layout layout.json --out out_{name}".split()) == 0
        manifest.write_text("of another program", encoding="utf-8")
        assert layout_identity_of(here / "set" / "frames" / "0000.png") is None
        manifest.unlink()


def test_a_design_is_decoded_and_called_one(here: Path, layout: Layout, capfd: pytest.CaptureFixture[str]) -> None:
    layout.replaced(kind="nominal").save(here / "layout.json")
    assert cli.main(["decode", "video.mp4", "--layout", "layout.json", "--limit", "2", "--out", "out"]) == 0
    assert "layout.json is a nominal layout, not a calibrated one" in capfd.readouterr().out


def test_views_are_made_equally_bright(here: Path, layout: Layout) -> None:
    gain = np.exp(np.random.default_rng(3).uniform(-0.3, 0.0, 9))
    gain[4] = 1.0
    sheet = np.zeros((192, 320, 3))
    for index, factor in enumerate(gain):
        left, top = np.floor(layout.outline_px(index).min(axis=0)).astype(int)
        right, bottom = np.ceil(layout.outline_px(index).max(axis=0)).astype(int)
        sheet[max(top, 0) : bottom + 1, max(left, 0) : right + 1] = 180 * factor
    write_image(here / "sheet.png", np.rint(sheet).astype(np.uint8))
    assert cli.main(["decode", "sheet.png", "--layout", "layout.json", "--equalise", "sheet.png", "--out", "out"]) == 0
    equal = load_npz(here / "out" / "sheet.npz")
    assert np.abs(equal.samples[equal.valid].astype(int) - 180).max() <= 2
    again = "decode video.mp4 --layout layout.json --equalise out/equalisation.json --limit 2 --out out"
    assert cli.main(again.split()) == 0
    plain = StoredLightFields(here / "out" / "video.zarr")
    assert np.allclose(np.array(plain.about["equalisation"])[..., 0] * gain.reshape(3, 3), 1.0, atol=0.01)


class Camera3Frames:
    """A camera that gives three frames; then Ctrl-C is pressed."""

    def __init__(self, number: int) -> None:
        self.left = pictures(3, 320, 192)

    def isOpened(self) -> bool:  # noqa: N802  # OpenCV's name
        return True

    def set(self, what: int, value: float) -> None:
        pass

    def read(self) -> tuple[bool, np.ndarray]:
        if not self.left:
            raise KeyboardInterrupt
        return True, self.left.pop(0)[..., ::-1]

    def release(self) -> None:
        pass


def test_a_camera_is_recorded_until_it_is_interrupted(
    here: Path, layout: Layout, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(cv2, "VideoCapture", Camera3Frames)
    assert cli.main(["decode", "--live", "0", "--layout", "layout.json", "--out", "out"]) == 130
    assert "3 frames" in capfd.readouterr().out
    stored = StoredLightFields(here / "out" / "device0.zarr")
    assert stored.numbers == (0, 1, 2)
    assert np.array_equal(stored[1].samples, Decoder(layout).decode(pictures(3, 320, 192)[1]).samples)
    # What is there stays there.
    assert "device0.zarr: exists and holds something else" in refused("--live 0 --out out", capfd)
    assert cli.main(["decode", "--live", "0", "--limit", "2", "--layout", "layout.json", "--out", "other"]) == 0
    assert StoredLightFields(here / "other" / "device0.zarr").numbers == (0, 1)


def test_what_to_know_of_a_video_is_printed_once(here: Path, capfd: pytest.CaptureFixture[str]) -> None:
    write_h264(here / "odd.mp4", pictures(3, 320, 192), interlaced=True, matrix=(0, 1, -1, 0))
    assert cli.main(["decode", "odd.mp4", "--layout", "layout.json", "--out", "out"]) == 0
    printed = capfd.readouterr().out
    assert printed.count("odd.mp4 is interlaced: ") == 1
    assert printed.count("odd.mp4 is displayed rotated by 90° by players: ") == 1


@pytest.mark.skipif(os.name == "nt", reason="such names are none of a file on Windows")
@pytest.mark.parametrize("name", ["2026-11-26T10:30:05.mp4", "concat:video.mp4"])
@pytest.mark.parametrize("option", [(), ("--live",)])
def test_a_name_that_looks_like_an_address_is_a_file(here: Path, option: tuple[str, ...], name: str) -> None:
    write_h264(here / name, pictures(2, 320, 192))
    assert cli.main(["decode", *option, name, "--layout", "layout.json", "--out", "out"]) == 0
    stem = "stream" if option else name.removesuffix(".mp4")
    assert len(StoredLightFields(here / "out" / f"{stem}.zarr")) == 2


def test_a_playlist_is_refused_whatever_its_name(here: Path, capfd: pytest.CaptureFixture[str]) -> None:
    (here / "list.mp4").write_text("ffconcat version 1.0\nfile video.mp4\n")
    for arguments in ("list.mp4", "--live list.mp4", "video.mp4 --equalise list.mp4"):
        assert "list.mp4: not a video in a supported format" in refused(arguments, capfd)


def test_a_recording_by_its_address_is_decoded_like_a_camera(here: Path, capfd: pytest.CaptureFixture[str]) -> None:
    address = f"file://{here / 'video.mp4'}"
    assert cli.main(["decode", "--live", address, "--layout", "layout.json", "--out", "out"]) == 0
    assert f"out{os.sep}stream.zarr written: {COUNT} frames" in capfd.readouterr().out
    stored = StoredLightFields(here / "out" / "stream.zarr")
    assert stored.about["source"]["device"] == address
    assert stored.times_s == pytest.approx([number / 25 for number in range(COUNT)])
    for arguments, message in (
        ("--live=", "--live '': expected a number from 0 to 255, or an address"),
        ("--live 256", "--live 256: expected a number from 0 to 255, or an address"),
        ("--live rtsp://me:secret@127.0.0.1:1/x", "rtsp://127.0.0.1:1/x cannot be opened: Connection refused"),
        ("video.mp4 --epi", "--epi: expected at least one picture among the frames"),
    ):
        assert message in refused(arguments, capfd)


def test_a_video_becomes_a_bag_that_other_commands_read(here: Path, capfd: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("rosbags", reason="needs rosbags, of the extra robot")
    arguments = "video.mp4 --to mcap --limit 2 --no-depth --out bags"
    assert cli.main(f"decode {arguments} --layout layout.json".split()) == 0
    assert results(here / "bags") == ["video.mcap", "video_drift.json"]
    assert cli.main(["refocus", "bags/video.mcap", "--out", "focused"]) == 0
    assert any(name.startswith("video_000001_focus_") for name in results(here / "focused"))
    assert "video.mcap: exists, and recordings are never replaced" in refused(f"{arguments} --force", capfd)


def test_a_raw_bag_of_the_camera_is_decoded_like_its_pictures(here: Path, layout: Layout) -> None:
    pytest.importorskip("rosbags", reason="needs rosbags, of the extra robot")
    shown = pictures(3, 320, 192)
    write_bag(here / "raw", [raw(picture[..., ::-1], "bgr8", "/camera/image_raw") for picture in shown])
    assert cli.main(["decode", "raw", "--layout", "layout.json", "--out", "out"]) == 0
    stored, decoder = StoredLightFields(here / "out" / "raw.zarr"), Decoder(layout)
    for light_field, picture in zip(stored[:], shown, strict=True):
        assert np.array_equal(light_field.samples, decoder.decode(picture).samples)
    arguments = ["decode", "raw:/camera/image_raw", "--to", "mcap", "--no-depth"]
    assert cli.main([*arguments, "--layout", "layout.json", "--out", "bags"]) == 0
    bag = StoredBag(here / "bags" / "image_raw.mcap")
    assert bag.stamps_ns == tuple(START_NS + number * STEP_NS for number in range(3))


def test_an_epipolar_plane_image_is_written_of_each_picture(here: Path) -> None:
    write_image(here / "grey.png", np.full((192, 320, 3), 90, np.uint8))
    arguments = "grey.png video.mp4 --limit 2 --epi --out out"
    assert cli.main(f"decode {arguments} --layout layout.json".split()) == 0
    written = [name for name in results(here / "out") if "_epi" in name]
    assert written == ["grey_epi.npz", "grey_epi.png"]
    light_field = load_npz(here / "out" / "grey.npz")
    with np.load(here / "out" / "grey_epi.npz") as arrays:
        assert (arrays["axis"], arrays["line"]) == ("s", light_field.height_px // 2)
        assert arrays["samples"].shape == (3, light_field.width_px, 3)
        np.testing.assert_allclose(arrays["samples"][arrays["weights"] > 0.5], 90 / 255, atol=1e-3)
