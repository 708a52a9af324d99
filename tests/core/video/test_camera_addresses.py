"""Cameras by number and by address: what FFmpeg reads on this machine, and one line for what cannot be read."""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from fractions import Fraction
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from itertools import product
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from benchmarks.robustness.native_opens import watched_opens
from benchmarks.robustness.playlists import LISTS, sdp
from mirrorcam.core.errors import InputError
from mirrorcam.core.video import camera_addresses
from mirrorcam.core.video.camera_addresses import MAX_MISSED, open_camera, without_password
from mirrorcam.core.video.frames import Frame, Lost
from mirrorcam.core.video.live_camera import LiveCamera
from tests.core.video.rtsp_server import PAYLOAD, rtp_packets, rtsp_served
from tests.core.video.videos import RATE, damage, number_in, pictures, write_h264, write_mjpeg, write_ramps

COUNT = 20


class Quiet(SimpleHTTPRequestHandler):
    def log_message(self, *_: Any) -> None:
        pass


@contextmanager
def served(folder: Path, handler: type[Quiet] = Quiet) -> Iterator[str]:
    """The address of a web server of a folder."""
    with ThreadingHTTPServer(("127.0.0.1", 0), partial(handler, directory=str(folder))) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_address[1]}"
        server.shutdown()


def free_port() -> int:
    """A port for UDP."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        return int(taken.getsockname()[1])


def send(address: str, count: int, over: threading.Event) -> None:
    """Send pictures as a transport stream in real time, each with its number."""
    with av.open(address, "w", format="mpegts") as container:
        options = {"g": "5", "preset": "ultrafast", "tune": "zerolatency"}
        stream: Any = container.add_stream("libx264", rate=RATE, options=options)
        stream.width, stream.height, stream.pix_fmt = 160, 96, "yuv420p"
        for number in range(count):
            if over.wait(1 / RATE):
                return
            frame = av.VideoFrame.from_ndarray(pictures(number % 40 + 1)[-1], format="rgb24")
            frame.pts, frame.time_base = number, Fraction(1, RATE)
            container.mux(stream.encode(frame))


def test_a_recording_is_read_from_a_file_and_a_web_server(tmp_path: Path) -> None:
    path = write_h264(tmp_path / "a.mp4", pictures(COUNT), b_frames=2)
    with served(tmp_path) as host:
        for address in (f"file://{path}", f"{host}/a.mp4"):
            source = open_camera(address, 160, 96)
            found = list(source.frames())
            assert source.ends
            assert [frame.number for frame in found] == list(range(COUNT))
            for frame in found:
                assert isinstance(frame, Frame)
                assert frame.time_s == pytest.approx(frame.number / RATE, abs=1e-6)
                assert number_in(frame.pixels) == frame.number


def test_damaged_pictures_and_those_that_depend_on_them_are_lost(tmp_path: Path) -> None:
    path = write_h264(tmp_path / "a.mp4", pictures(30), key_every=10)
    damage(path, 13)
    found = list(open_camera(f"file://{path}", 160, 96).frames())
    kept = [number_in(frame.pixels) for frame in found if isinstance(frame, Frame)]
    assert kept == [*range(13), *range(20, 30)]
    assert {lost.reason for lost in found if isinstance(lost, Lost)} == {"is damaged"}


def test_remarks_on_a_recording_are_made_once(tmp_path: Path) -> None:
    path, lines = write_h264(tmp_path / "a.mp4", pictures(3), interlaced=True, matrix=(0, 1, -1, 0)), list[str]()
    assert len(list(open_camera(str(path), 160, 96, lines.append).frames())) == 3
    assert [line.split(" is ")[1].split()[0] for line in lines] == ["interlaced:", "displayed"]


def test_pictures_of_many_bits_are_scaled_by_those_in_use(tmp_path: Path) -> None:
    lines = list[str]()
    path = write_ramps(tmp_path / "a.mkv", "gray16le", 12, (200, 100, 255))
    found = list(open_camera(str(path), 64, 48, lines.append).frames())
    largest = [int(frame.pixels.max()) for frame in found if isinstance(frame, Frame)]
    assert largest == pytest.approx([200, 100, 255], abs=1)
    assert len(lines) == 1 and "the lowest 12 of these bits" in lines[0]


def assert_in_time(found: list[Frame | Lost]) -> None:
    """The pictures' own numbers and times go together, 25 a second; the first of a stream may state no time."""
    whole = [frame for frame in found if isinstance(frame, Frame)]
    assert len(whole) >= len(found) - 5
    times = np.array([frame.time_s for frame in whole])
    assert (np.diff(times) > 0).all()
    steps = np.diff([number_in(frame.pixels) for frame in whole]) % 40
    np.testing.assert_allclose(np.diff(times)[1:], steps[1:] / RATE, atol=0.002)


def test_a_camera_is_read_by_rtsp() -> None:
    with rtsp_served(pictures(40), RATE) as address:
        source = open_camera(address, 160, 96)
        assert not source.ends
        assert "secret" in address
        assert "secret" not in source.name
        frames = source.frames()
        found = [next(frames) for _ in range(25)]
        frames.close()
    assert_in_time(found)


@pytest.mark.slow
def test_a_stream_is_read_live() -> None:
    address = f"udp://127.0.0.1:{free_port()}"
    over = threading.Event()
    sender = threading.Thread(target=send, args=(f"{address}?pkt_size=1316", 500, over), daemon=True)
    sender.start()
    time.sleep(0.3)
    source = open_camera(address, 160, 96)
    assert not source.ends
    frames = source.frames()
    found = [next(frames) for _ in range(30)]
    frames.close()
    over.set()
    sender.join()
    assert_in_time(found)


def test_a_server_that_goes_and_comes_back_is_connected_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each connection gives a few JPEG pictures and is closed, as by a camera that loses its power."""
    write_mjpeg(tmp_path / "a.mjpeg", pictures(5))
    content, lines = (tmp_path / "a.mjpeg").read_bytes(), list[str]()
    with socket.create_server(("127.0.0.1", 0)) as server:

        def serve() -> None:
            for _ in range(2):
                connection, _ = server.accept()
                with connection:
                    connection.sendall(content)
                    time.sleep(0.2)

        thread = threading.Thread(target=serve, daemon=True)
        thread.start()
        monkeypatch.setattr(camera_addresses, "LiveCamera", partial(LiveCamera, retry_s=0.05))
        source = open_camera(f"tcp://127.0.0.1:{server.getsockname()[1]}", 160, 96, lines.append)
        frames = source.frames()
        found = [next(frames) for _ in range(8 - source.dropped)]
        frames.close()
        thread.join()
    assert source.outages == 1
    assert "gives no more pictures, waiting for it" in lines[0]
    assert all(isinstance(frame, Frame) for frame in found)


def test_a_server_leads_to_nothing_else(tmp_path: Path) -> None:
    other = write_mjpeg(tmp_path / "other.mkv", pictures(2))
    asked = list[str]()

    class Listed(Quiet):
        def do_GET(self) -> None:
            asked.append(self.path)
            super().do_GET()

    with served(tmp_path, Listed) as host, watched_opens([other]) as opened:
        targets = ("other.mkv", f"{host}/other.mkv", str(other), f"file://{other}")
        for listed, target, name in product(LISTS, targets, ("list.m3u8", "list.mp4", "list.sdp")):
            (tmp_path / name).write_text(listed(target), encoding="utf-8")
            with pytest.raises(InputError, match=rf"/{name} cannot be opened: ") as refused:
                open_camera(f"{host}/{name}", 160, 96)
            assert len(str(refused.value)) <= 300
    assert {each for each in asked if "other" in each} == set()
    assert opened == []


def test_a_server_may_send_to_another_page_but_not_to_a_file(tmp_path: Path) -> None:
    other = write_mjpeg(tmp_path / "other.mkv", pictures(2))
    places = dict[str, str]()

    class Sending(Quiet):
        def do_GET(self) -> None:
            if (place := places.get(self.path)) is None:
                super().do_GET()
                return
            self.send_response(302)
            self.send_header("Location", place)
            self.end_headers()

    with served(tmp_path, Sending) as host:
        places["/page"] = f"{host}/other.mkv"
        assert len(list(open_camera(f"{host}/page", 160, 96).frames())) == 2
        with watched_opens([other]) as opened:
            for place in (f"file:{other}", f"file://{other}", str(other), f"concat:{other}", f"subfile:{other}"):
                places["/file"] = place
                with pytest.raises(InputError, match="/file cannot be opened: "):
                    open_camera(f"{host}/file", 160, 96)
        assert opened == []


@pytest.mark.parametrize("scheme", ["rtsp", "rtmp", "http", "https", "tcp", "rtsps", "rtmps"])
def test_each_kind_of_address_has_the_protocols_that_it_needs(scheme: str) -> None:
    with pytest.raises(InputError, match="cannot be opened: Connection refused; "):
        open_camera(f"{scheme}://127.0.0.1:1/live", 160, 96)


@pytest.mark.parametrize(
    "address",
    ["concat:{}", "subfile,,start,0,end,0,,:{}", "crypto:{}", "cache:{}", "async:{}", "ftp://x/{}", "data:,{}"],
)
def test_other_kinds_of_address_are_refused(tmp_path: Path, address: str) -> None:
    other = write_mjpeg(tmp_path / "other.mkv", pictures(2))
    with (
        watched_opens([other]) as opened,
        pytest.raises(InputError, match="opened: neither a file nor an address"),
    ):
        open_camera(address.format(other), 160, 96)
    assert opened == []


@pytest.mark.slow
def test_a_stream_is_read_by_its_description(tmp_path: Path) -> None:
    port, over = free_port(), threading.Event()
    (tmp_path / "a.sdp").write_text(
        "v=0\r\no=- 0 0 IN IP4 127.0.0.1\r\ns=test\r\nc=IN IP4 127.0.0.1\r\nt=0 0\r\n"
        f"m=video {port} RTP/AVP {PAYLOAD}\r\na=rtpmap:{PAYLOAD} H264/90000\r\n"
        f"a=fmtp:{PAYLOAD} packetization-mode=1\r\n",
        encoding="utf-8",
    )

    def send_packets() -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            for packet in rtp_packets(pictures(40), RATE, over):
                sender.sendto(packet, ("127.0.0.1", port))

    thread = threading.Thread(target=send_packets, daemon=True)
    thread.start()
    source = open_camera(str(tmp_path / "a.sdp"), 160, 96)
    assert not source.ends
    frames = source.frames()
    assert_in_time([next(frames) for _ in range(15)])
    frames.close()
    over.set()
    thread.join()


def test_a_description_of_a_stream_is_not_a_playlist(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(camera_addresses, "OPENING_S", 0.3)
    other = write_mjpeg(tmp_path / "other.mkv", pictures(2))
    for listed in LISTS:
        if listed is sdp:  # which waits for its stream
            continue
        (tmp_path / "a.sdp").write_text(listed(str(other)), encoding="utf-8")
        with (
            watched_opens([other]) as opened,
            pytest.raises(InputError, match=r"a\.sdp (cannot be opened|has no pict)"),
        ):
            open_camera(str(tmp_path / "a.sdp"), 160, 96)
        assert opened == []


@pytest.mark.parametrize(
    ("address", "message"),
    [
        ("rtsp://me:secret@127.0.0.1:1/live", r"^rtsp://127\.0\.0\.1:1/live cannot be opened: Connection refused; "),
        (
            "/dev/video251",
            r"^/dev/video251 cannot be opened: No such file or directory; expected the number of a camera",
        ),
        ("v4l2:///dev/video251", r"^v4l2:///dev/video251 cannot be opened: "),
        ("nonsense://here", r"^nonsense://here cannot be opened: neither a file nor an address of a supported kind"),
        (
            "v4l2src device=/dev/video0 ! appsink",
            r"^a GStreamer pipeline cannot be read, expected an address: .*udpsink",
        ),
        ("99", r"^camera 99 cannot be opened, expected one on this machine \(/dev/video99\)$"),
    ],
)
def test_what_cannot_be_opened_is_refused_in_one_line(address: str, message: str) -> None:
    with pytest.raises(InputError, match=message) as refused:
        open_camera(address, 160, 96)
    assert "\n" not in str(refused.value)
    assert len(str(refused.value)) <= 300
    assert "secret" not in str(refused.value)


def test_a_device_of_v4l2_is_asked_for_jpeg_and_the_size_and_taken_without_jpeg(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, whole, asked = write_mjpeg(tmp_path / "a.avi", pictures(2)), av.open, list[Any]()

    def opened(address: str, *, format: str, options: dict[str, str], **_: Any) -> Any:  # PyAV's name
        asked.append((address, format, options))
        if "input_format" in options:
            raise av.error.InvalidDataError(22, "Invalid argument")
        return whole(str(path))

    monkeypatch.setattr(av, "open", opened)
    assert len(list(open_camera("v4l2:///dev/video3", 160, 96).frames())) == 2
    size = {"video_size": "160x96"}
    assert asked == [
        ("/dev/video3", "v4l2", size | {"input_format": "mjpeg"}),
        ("/dev/video3", "v4l2", size),
    ]


def test_a_silent_server_is_not_waited_for_without_end(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(camera_addresses, "OPENING_S", 0.3)
    with pytest.raises(InputError, match=r"cannot be opened: no answer within 0\.3 s; "):
        open_camera(f"udp://127.0.0.1:{free_port()}", 160, 96)


def test_sound_alone_is_not_a_camera(tmp_path: Path) -> None:
    with av.open(str(tmp_path / "a.wav"), "w") as container:
        stream: Any = container.add_stream("pcm_s16le", rate=8000, layout="mono")
        sound = av.AudioFrame.from_ndarray(np.zeros((1, 800), np.int16), format="s16", layout="mono")
        sound.sample_rate = 8000
        container.mux(stream.encode(sound))
        container.mux(stream.encode(None))
    with pytest.raises(InputError, match="has no pictures, expected a camera or a video"):
        open_camera(f"file://{tmp_path / 'a.wav'}", 160, 96)


def test_passwords_are_not_shown() -> None:
    assert without_password("rtsp://me:secret@host/path@1") == "rtsp://host/path@1"
    assert without_password("udp://host:5000") == "udp://host:5000"


class Camera:
    """What cv2.VideoCapture is: pictures in BGR, None for one that it fails to give."""

    def __init__(self, given: list[NDArray[np.uint8] | None]) -> None:
        self.given, self.released = iter(given), False
        self.asked: dict[int, float] = {}

    def __call__(self, number: int) -> Camera:
        return self

    def isOpened(self) -> bool:  # noqa: N802  # OpenCV's name
        return True

    def set(self, what: int, value: float) -> bool:
        self.asked[what] = value
        return True

    def read(self) -> tuple[bool, NDArray[np.uint8] | None]:
        picture = next(self.given, None)
        return picture is not None, picture

    def release(self) -> None:
        self.released = True


def test_a_camera_by_its_number_is_gone_after_many_pictures_that_it_did_not_give(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    one, two = pictures(2)
    misses: list[NDArray[np.uint8] | None] = [None] * (MAX_MISSED - 1)
    device = Camera([one[..., ::-1], *misses, two[..., ::-1]])
    monkeypatch.setattr(cv2, "VideoCapture", device)
    monkeypatch.setattr(camera_addresses, "LiveCamera", partial(LiveCamera, retry_s=30))
    frames = open_camera("0", 160, 96).frames()
    found = [next(frames), next(frames)]
    deadline = time.monotonic() + 10
    while not device.released and time.monotonic() < deadline:
        time.sleep(0.01)
    assert device.released
    frames.close()
    for frame, number, picture in zip(found, (0, 1), (one, two), strict=True):
        assert isinstance(frame, Frame)
        assert frame.number == number
        assert np.array_equal(frame.pixels, picture)
    assert (device.asked[cv2.CAP_PROP_FRAME_WIDTH], device.asked[cv2.CAP_PROP_FRAME_HEIGHT]) == (160, 96)
