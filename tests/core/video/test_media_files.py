"""Of a local video, the one file that was named is opened, whatever it holds and however it is called."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path

import pytest

from benchmarks.robustness.external_data import with_external_data
from benchmarks.robustness.native_opens import AUDITED, watched_opens
from benchmarks.robustness.playlists import LISTS
from mirrorcam.core.errors import InputError
from mirrorcam.core.video.animation import write_loop
from mirrorcam.core.video.background_recorder import FrameRecorder
from mirrorcam.core.video.camera_addresses import open_camera
from mirrorcam.core.video.frames import Frame
from mirrorcam.core.video.media_files import FORMATS, MediaFile, opened
from mirrorcam.core.video.video import Video
from tests.core.video.videos import number_in, pictures, write_h264, write_mjpeg

LIKE_ADDRESSES = (
    *("2026-11-26T10:30:05.mkv", "concat:other.mkv", "subfile,,start,0,end,0,,:other.mkv", "file:other.mkv"),
    *("crypto:other.mkv", "pipe:0.mkv", "http:other.mkv", "-.mkv", "a%02d.mkv", "a ! b.mkv", "data:video,other.mkv"),
)
POSIX = pytest.mark.skipif(os.name == "nt", reason="such names are none of a file on Windows")


def frame_numbers(video: Video) -> list[int]:
    return [number_in(item.pixels) for item in video.frames() if isinstance(item, Frame)]


@cache
def content() -> bytes:
    """A short good video (Matroska)."""
    with tempfile.TemporaryDirectory() as folder:
        return write_mjpeg(Path(folder) / "a.mkv", pictures(3)).read_bytes()


def write_video(path: Path) -> Path:
    path.write_bytes(content())
    return path


def test_formats_that_lead_elsewhere_are_not_read() -> None:
    elsewhere = ("concat", "hls", "dash", "imf", "sdp", "rtsp", "rtp", "sap", "image2", "lavfi", "vobsub", "mlv", "avs")
    assert not set(elsewhere) & set(FORMATS.split(","))


@pytest.mark.parametrize("target", ["other.mkv", "../above.mkv", "{}/other.mkv", "file:other.mkv"])
@pytest.mark.parametrize("listed", LISTS, ids=lambda listed: listed.__name__)
def test_a_list_of_files_is_not_a_video(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, listed: Callable[[str], str], target: str
) -> None:
    folder = tmp_path / "folder"
    folder.mkdir()
    others = [write_video(folder / "other.mkv"), write_video(tmp_path / "above.mkv")]
    monkeypatch.chdir(folder)
    for name in ("list.mp4", "list.m3u8", "list.mpd", "list.ffconcat", "other.idx"):
        Path(name).write_text(listed(target.format(folder)), encoding="utf-8")
        with watched_opens(others) as found, pytest.raises(InputError, match=rf"^{name}: ") as refused:
            Video(Path(name))
        assert found == []
        assert "\n" not in str(refused.value)
        assert len(str(refused.value)) <= 300


@POSIX
@pytest.mark.parametrize("name", LIKE_ADDRESSES)
def test_a_name_that_looks_like_an_address_is_the_name_of_a_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    write_mjpeg(tmp_path / "other.mkv", pictures(5)[3:])
    write_video(tmp_path / name)
    monkeypatch.chdir(tmp_path)
    assert frame_numbers(Video(Path(name))) == [0, 1, 2]
    device = open_camera(name, 160, 96)
    assert device.ends
    assert [number_in(item.pixels) for item in device.frames() if isinstance(item, Frame)] == [0, 1, 2]
    Path(name).write_bytes(bytes(100))
    for use in (lambda: Video(Path(name)), lambda: open_camera(name, 160, 96)):
        with pytest.raises(InputError, match="not a video that can be opened"):
            use()


@POSIX
@pytest.mark.parametrize("name", ["concat:folder", "2026-11-26T10:30:05"])
def test_files_are_written_below_names_that_look_like_addresses(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    monkeypatch.chdir(tmp_path)
    recorder = FrameRecorder(Path(name) / "a.mkv", 160, 96)
    for number, pixels in enumerate(pictures(3)):
        recorder.add(Frame(number, number / 10, pixels))
    recorder.close()
    assert frame_numbers(Video(Path(name) / "a.mkv")) == [0, 1, 2]
    write_loop(Path(name) / "a.mp4", pictures(3), 10.0)
    assert frame_numbers(Video(Path(name) / "a.mp4")) == [0, 1, 2]


def test_data_in_another_file_are_not_read(tmp_path: Path) -> None:
    import av

    other = write_mjpeg(tmp_path / "other.mkv", pictures(3))
    # Only a file whose index is at its end keeps the places that the index states.
    with av.open(str(tmp_path / "plain.mp4"), "w") as container, av.open(str(other)) as source:
        stream = container.add_stream_from_template(source.streams.video[0])
        for packet in source.demux(video=0):
            if packet.size:
                packet.stream = stream
                container.mux(packet)
    path = tmp_path / "external.mp4"
    path.write_bytes(with_external_data((tmp_path / "plain.mp4").read_bytes(), str(other)))
    if AUDITED:
        with (
            watched_opens([other]) as found,
            av.open(str(path), options={"enable_drefs": "1", "use_absolute_path": "1"}),
        ):
            pass
        assert set(found) == {other}
    with watched_opens([other]) as found:
        frames = list(Video(path).frames())
    assert found == []
    assert len(frames) <= 3


def test_anything_but_a_regular_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"nowhere\.mkv: no such file$"), opened(tmp_path / "nowhere.mkv"):
        pass
    with pytest.raises(InputError, match="too long"), opened(tmp_path / ("x" * 300)):
        pass
    with pytest.raises(InputError, match="null"), opened(tmp_path / "\0"):
        pass
    with pytest.raises(InputError, match="is a folder, expected a video or pictures"), opened(tmp_path):
        pass
    if hasattr(os, "mkfifo"):
        os.mkfifo(tmp_path / "pipe.mkv")
        with pytest.raises(InputError, match="is not a regular file"), opened(tmp_path / "pipe.mkv"):
            pass


def test_a_seek_outside_a_file_returns_an_error_code(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(bytes(10))
    with MediaFile(tmp_path / "a") as file:
        assert file.seek(-1) < 0
        assert file.seek(4) == 4
        assert len(file.read()) == 6


def test_frames_are_those_that_ffmpeg_gives_by_the_name(tmp_path: Path) -> None:
    import av

    for path in (write_h264(tmp_path / "a.mp4", pictures(9), b_frames=2), write_mjpeg(tmp_path / "a.avi", pictures(9))):
        with av.open(str(path)) as by_name, opened(path) as by_bytes:
            assert by_bytes.format.name == by_name.format.name
            assert by_bytes.duration == by_name.duration
            first, second = ([(p.pos, p.pts, bytes(p)) for p in each.demux(video=0)] for each in (by_name, by_bytes))
            assert first == second


READ = """
import sys
from pathlib import Path
from mirrorcam.core.errors import InputError
from mirrorcam.core.video.camera_addresses import open_camera
from mirrorcam.core.video.video import Video
for name in sys.argv[1:]:
    for use in (lambda: list(Video(Path(name), print).frames()), lambda: list(open_camera(name, 160, 96).frames())):
        try:
            use()
        except InputError as error:
            print(error)
"""


def test_the_system_sees_no_other_file_opened(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    strace = shutil.which("strace")
    if strace is None:
        pytest.skip("needs strace")
    log = tmp_path / "strace.log"
    trace = [strace, "-f", "-o", str(log), "-e", "trace=open,openat,connect"]
    if subprocess.run([*trace, "true"], capture_output=True, check=False).returncode:
        pytest.skip("strace may not trace here")
    folder = tmp_path / "folder"
    folder.mkdir()
    for other in (folder / "other.mkv", folder / "other.sub", tmp_path / "above.mkv"):
        write_video(other)
    names = ["2026-11-26T10:30:05.mkv", "plain.mkv"]
    for name in names:
        write_video(folder / name)
    for listed in LISTS:
        for target in ("other.mkv", "../above.mkv", str(tmp_path / "above.mkv"), "http://127.0.0.1:1/a.mkv"):
            names.append(f"list_{len(names)}.mp4")
            (folder / names[-1]).write_text(listed(target), encoding="utf-8")
    names += ["concat:other.mkv", "other.idx", "file_%02d.png"]
    for name in names[-3:]:
        (folder / name).write_text("# VobSub index file, v7\ntimestamp: 00:00:00:000\n", encoding="utf-8")
    monkeypatch.chdir(folder)
    run = subprocess.run(
        [*trace, sys.executable, "-c", READ, *names], capture_output=True, text=True, timeout=120, check=False
    )
    assert (run.returncode, run.stderr) == (0, "")
    lines = log.read_text(encoding="utf-8", errors="replace").splitlines()
    assert not [line for line in lines if "connect(" in line and "AF_INET" in line]
    opens = {match[1] for line in lines if (match := re.search(r'open(?:at)?\(.*?"(.*?)"', line))}
    assert opens >= set(names)
    there = {str(path) for path in tmp_path.rglob("*") if path.is_file() and path != log}
    assert {os.path.normpath(folder / name) for name in opens} & there == {str(folder / name) for name in names}
