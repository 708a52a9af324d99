"""Files that refer to other files, and names that are addresses: reading a video must not open anything else.

Each attempt writes a playlist or another list of files under the name of a video, or a file whose name looks like an
address or a pattern, sometimes damaged, and reads it like commands do. The files to which it could lead are valid
videos, so that only the reader keeps FFmpeg from them, and a local server listens for requests.
"""

from __future__ import annotations

import socket
import tempfile
from collections.abc import Callable, Iterator
from contextlib import chdir, contextmanager
from functools import cache
from itertools import islice
from pathlib import Path
from threading import Timer
from unittest.mock import patch

import numpy as np

from benchmarks.robustness import media
from benchmarks.robustness.damage import damaged_bytes
from benchmarks.robustness.external_data import with_external_data
from benchmarks.robustness.guard import Category, message_fault
from benchmarks.robustness.native_opens import AUDITED, watched_opens
from mirrorcam.core.errors import InputError
from mirrorcam.core.video import camera_addresses
from mirrorcam.core.video.video import Video
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.studio.live.streams import open_source

CAMERA = Camera(width_px=media.WIDTH, height_px=media.HEIGHT, fx_px=300.0, fy_px=300.0, cx_px=159.5, cy_px=119.5)
ANSWER_S = 0.2
"""Time to wait for a stream."""
GIVE_UP_S = 1.0
"""Time after which an opened camera is stopped."""
TARGETS = ("other.mkv", "frame_01.png", "other.sub", "other.M00")
"""Names of videos in the folder of the file that is read, and in the folder above."""
PREFIXES = (
    *("", "./", "../", "{folder}/", "{above}/", "file:", "file:../", "file:{above}/", "file://{above}/"),
    *("concat:", "concat:../", "concatf:", "subfile,,start,0,end,0,,:", "subfile,,start,0,end,0,,:../", "crypto:"),
    *("crypto+file:../", "cache:", "cache:../", "async:", "async:../", "tee:", "link:", "md5:", "prompeg:"),
    *("http://127.0.0.1:{port}/", "tcp://127.0.0.1:{port}/", "ftp://127.0.0.1:{port}/", "rtmp://127.0.0.1:{port}/"),
    *("hls+file:../", "hls+http://127.0.0.1:{port}/", "icecast://127.0.0.1:{port}/", "gopher://127.0.0.1:{port}/"),
    *("rtsp://127.0.0.1:{port}/", "httpproxy://127.0.0.1:{port}/", "mmsh://127.0.0.1:{port}/"),
)
ADDRESSES = (
    *("pipe:", "pipe:0", "fd:", "-", "data:video/mp4;base64,AAAA", "unix:other.mkv", "movie=other.mkv"),
    *("lavfi:testsrc", "%02d.png", "frame_%02d.png", "*.png", "frame_*.png", "frame_%2d.png", "@other.mkv"),
    *("tee:a|b", "other.mkv|b"),
)
SUFFIXES = (
    *("mp4", "mov", "mkv", "webm", "avi", "ts", "mpg", "m4v", "wmv", "flv", "ogv", "mxf", "h264", "mjpeg", "dat"),
    *("MP4", "m3u8", "m3u", "mpd", "sdp", "ffconcat", "concat", "txt", "idx", "mlv", "xml", "nut", "y4m", "gif"),
    *("rm", ""),
)


def _ffconcat(target: str) -> str:
    return f"ffconcat version 1.0\nfile '{target}'\nduration 1\nfile {target}\n"


def _ffconcat_unsafe(target: str) -> str:
    return f"ffconcat version 1.0\nstream\noption safe 0\nfile '{target}'\noption protocol_whitelist file,http,tcp\n"


def _hls(target: str) -> str:
    head = "#EXTM3U\n#EXT-X-VERSION:7\n#EXT-X-TARGETDURATION:10\n#EXT-X-MEDIA-SEQUENCE:0\n"
    return f"{head}#EXTINF:10.0,\n{target}\n#EXT-X-ENDLIST\n"


def _hls_of_parts(target: str) -> str:
    head = f'#EXTM3U\n#EXT-X-VERSION:7\n#EXT-X-TARGETDURATION:10\n#EXT-X-MAP:URI="{target}"\n'
    return f'{head}#EXT-X-KEY:METHOD=AES-128,URI="{target}"\n#EXTINF:10.0,\n{target}\n#EXT-X-ENDLIST\n'


def _hls_master(target: str) -> str:
    media = f'#EXT-X-MEDIA:TYPE=AUDIO,GROUP-ID="a",NAME="a",DEFAULT=YES,URI="{target}"\n'
    return f'#EXTM3U\n{media}#EXT-X-STREAM-INF:BANDWIDTH=100000,AUDIO="a"\n{target}\n'


def _m3u(target: str) -> str:
    return f"#EXTM3U\n#EXTINF:10,other\n{target}\n"


def _dash(target: str) -> str:
    list_ = f'<SegmentList duration="1"><Initialization sourceURL="{target}"/><SegmentURL media="{target}"/>'
    representation = f'<Representation id="1" bandwidth="1000"><BaseURL>{target}</BaseURL>{list_}'
    return (
        '<?xml version="1.0"?>\n<MPD xmlns="urn:mpeg:dash:schema:mpd:2011" type="static" '
        'profiles="urn:mpeg:dash:profile:isoff-live:2011" mediaPresentationDuration="PT1S"><Period>'
        f'<AdaptationSet mimeType="video/mp4" contentType="video">{representation}</SegmentList></Representation>'
        "</AdaptationSet></Period></MPD>\n"
    )


def sdp(target: str) -> str:
    return (
        f"v=0\r\no=- 0 0 IN IP4 127.0.0.1\r\ns=x\r\nc=IN IP4 127.0.0.1\r\nt=0 0\r\na=control:{target}\r\n"
        f"m=video 0 RTP/AVP 96\r\na=rtpmap:96 H264/90000\r\na=control:{target}\r\n"
    )


def _imf(target: str) -> str:
    return (
        '<?xml version="1.0"?><CompositionPlaylist xmlns="http://www.smpte-ra.org/schemas/2067-3/2016">'
        f"<Id>urn:uuid:0</Id><AssetMap>{target}</AssetMap></CompositionPlaylist>"
    )


def _subtitles(target: str) -> str:
    return f"# VobSub index file, v7 (do not modify this line!)\nsize: 320x240\n# {target}\ntimestamp: 00:00:00:000\n"


def _raw_lists(target: str) -> str:
    return f"MLVI\x34\x00\x00\x00v2.0\x00\x00\x00\x00{target}\x00\x00[playlist]\nFile1={target}\n"


LISTS: tuple[Callable[[str], str], ...] = (
    *(_ffconcat, _ffconcat_unsafe, _hls, _hls_of_parts, _hls_master, _m3u, _dash, sdp, _imf, _subtitles, _raw_lists),
)


@cache
def video() -> bytes:
    """Return a short valid video."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a.mp4"
        media.write_video(path, "mjpeg", {})
        return path.read_bytes()


@contextmanager
def listening() -> Iterator[tuple[int, list[str]]]:
    """Yield a local port, and a list that states at the end of the block whether anything connected to it."""
    connections: list[str] = []
    with socket.create_server(("127.0.0.1", 0)) as server:
        server.setblocking(False)
        yield int(server.getsockname()[1]), connections
        try:
            server.accept()[0].close()
            connections.append("connects to a server named in the file")
        except BlockingIOError:
            pass


def _content(path: Path, target: str, random: np.random.Generator) -> bytes:
    """Return a list of files, or an MP4 whose data are in a different file; half of them are damaged."""
    if random.random() < 0.15:
        raw = with_external_data(video(), target)
    else:
        raw = LISTS[int(random.integers(len(LISTS)))](target).encode()
    return damaged_bytes(raw, random) if random.random() < 0.5 else raw


def _named(folder: Path, port: int, random: np.random.Generator) -> tuple[str, bytes]:
    """Return the name of a file, which may look like an address, and its content."""
    values = {"folder": folder, "above": folder.parent, "port": port}
    targets = [prefix.format(**values) + name for prefix in PREFIXES for name in TARGETS[:1]] + list(ADDRESSES)
    target = str(targets[int(random.integers(len(targets)))])
    if random.random() < 0.3:
        names = [name for name in targets if "/" not in name and name not in ("", *TARGETS)]
        return names[int(random.integers(len(names)))], random.bytes(100)
    stem = str(random.choice(["a", "other", "frame_01", "2026-11-26T10:30:05", "concat:a"]))
    suffix = SUFFIXES[int(random.integers(len(SUFFIXES)))]
    return f"{stem}.{suffix}" if suffix else stem, _content(folder, target, random)


def _frames(name: str) -> None:
    """Read a video like `decode` and `calibrate`."""
    for _ in Video(Path(name), lambda line: None).frames():
        pass


def _live(name: str) -> None:
    """Open a source like `live`."""
    open_source(name, CAMERA).source.stop()


def _device(name: str) -> None:
    """Open a camera like `decode --live`; stop one without frames, such as a stream that nobody sends."""
    source = camera_addresses.open_camera(name, media.WIDTH, media.HEIGHT)
    give_up = Timer(GIVE_UP_S, source.stop)
    give_up.start()
    try:
        for _ in islice(source.frames(), 3):
            pass
    finally:
        give_up.cancel()


def attempt(seed: int, folder: Path) -> str:
    """Read a file that leads elsewhere, and check whether anything else was opened."""
    random = np.random.default_rng(seed)
    place = folder / "place"
    place.mkdir()
    for parent in (place, folder):
        for target in TARGETS:
            (parent / target).write_bytes(video())
    use = (_frames, _live, _device)[int(random.integers(3))]
    with listening() as (port, connections), chdir(place), patch.object(camera_addresses, "OPENING_S", ANSWER_S):
        name, content = _named(place, port, random)
        (place / name).write_bytes(content)
        others = [parent / target for parent in (place, folder) for target in TARGETS if target != name]
        with watched_opens(others) as opened:
            wrong = _refusal(use, name)
    label = f"{use.__name__} of {name!r}"
    if opened:
        return f"{label} opens {opened[0].relative_to(folder)}"
    return f"{label} {connections[0]}" if connections else wrong and f"{label}: {wrong}"


def _refusal(use: Callable[[str], None], name: str) -> str:
    try:
        use(name)
    except InputError as error:
        return message_fault(str(error))
    return ""


CATEGORY = Category("playlists" if AUDITED else "playlists (opens not audited)", 3_000, attempt)
