"""Cameras by number, through OpenCV, and by address, through FFmpeg: v4l2, RTSP, HTTP, UDP and others.

FFmpeg may use only the protocols and formats that each kind of address needs. Playlists are excluded, so that a server
cannot refer to local files or to other servers; only HTTP(S) redirects may lead to another server. An existing file
takes precedence over an address.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Generator, Iterator
from contextlib import ExitStack, contextmanager, suppress
from functools import cache, partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.arguments import check_count, check_type
from mirrorcam.core.bounds import SENSOR_PX
from mirrorcam.core.disk.files import stored_bytes
from mirrorcam.core.errors import InputError
from mirrorcam.core.images.sample_bits import SampleBits
from mirrorcam.core.messages import shortened
from mirrorcam.core.video.frames import READ_AHEAD
from mirrorcam.core.video.live_camera import CameraPicture, Connection, LiveCamera
from mirrorcam.core.video.media_files import FORMATS, MediaFile, opened
from mirrorcam.core.video.video import frame_remarks
from mirrorcam.core.video.video_pictures import has_16_bits, rgb_of, rgb_of_samples, samples_of_16_bits

MAX_MISSED = 30
"""Number of consecutive failed reads after which a camera counts as disconnected."""
OPENING_S, READING_S = 10.0, 5.0
"""Timeouts for the connection to a server, and for each packet."""
_V4L2 = re.compile(r"(v4l2://)?(?P<device>/dev/(video|v4l/)\S+)")
_RTMP = "flv,live_flv"
_WEB = "http,https,httpproxy,tls,tcp"
_SCHEMES = {
    "rtsp": ("rtsp,asf", "tcp"),
    "rtsps": ("rtsp,asf", "tls,tcp"),
    "rtmp": (_RTMP, "rtmp,tcp"),
    "rtmps": (_RTMP, "rtmps,tls,tcp"),
    "http": (FORMATS, _WEB),
    "https": (FORMATS, _WEB),
    "udp": (FORMATS, "udp"),
    "rtp": ("rtp", "rtp,udp"),
    "tcp": (FORMATS, "tcp"),
}
"""FFmpeg's formats and protocols for each kind of address."""
_INTRA = 1
"""FFmpeg's type of a picture that depends on no other (AV_PICTURE_TYPE_I)."""


def open_camera(
    address: str,
    width_px: int,
    height_px: int,
    on_note: Callable[[str], None] = lambda line: None,
    buffered: int = READ_AHEAD,
) -> LiveCamera:
    """Open a camera by number or address, and request a picture size.

    Parameters
    ----------
    address
        Number of a camera of this machine, "0"; a device, "/dev/video0"; a file; or an address, ``rtsp://HOST/PATH``.
        Messages omit passwords.
    width_px, height_px
        Size of the pictures: that of the layout's camera.
    on_note
        Called with a line when the camera disconnects and when it is back.
    buffered
        Number of buffered frames; with 1, the next frame is always the newest.

    Returns
    -------
    LiveCamera
        The camera; `frames()` yields its frames, RGB.

    Raises
    ------
    InputError
        If it cannot be opened, or the size is no picture's.
    """
    check_type("address", address, str)
    for name, side_px in {"width_px": width_px, "height_px": height_px}.items():
        check_count(name, side_px, SENSOR_PX)
    is_number = address.isascii() and address.isdigit()
    if not is_number and _local_file(address) is None and re.search(r"\s!\s", address):
        raise InputError(
            "a GStreamer pipeline cannot be read, expected an address: end it with `! mpegtsmux ! udpsink "
            "host=127.0.0.1 port=5000` and give udp://127.0.0.1:5000, or with `! v4l2sink device=/dev/videoN`"
        )
    # The camera is opened again after an outage: `cache` keeps remarks from being repeated.
    name, connect = without_password(address), partial(_addressed, address, width_px, height_px, cache(on_note))
    if is_number:
        name, connect = f"camera {address}", partial(_numbered, int(address), width_px, height_px)
    return LiveCamera(name, connect, width_px, height_px, on_note=on_note, buffered=buffered)


def without_password(address: str) -> str:
    """Return an address without user name and password."""
    return re.sub(r"(?<=://)[^/@]*@", "", address)


def _numbered(number: int, width_px: int, height_px: int) -> Connection:
    """Open a camera of this machine by its number."""
    # Silence OpenCV, which prints its attempts on standard error; a failure is reported below.
    level = cv2.utils.logging.getLogLevel()
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    try:
        capture = cv2.VideoCapture(number)
    finally:
        cv2.utils.logging.setLogLevel(level)
    if not capture.isOpened():
        raise InputError(f"camera {number} cannot be opened, expected one on this machine (/dev/video{number})")
    # USB 2 is too slow for uncompressed pictures of this size.
    capture.set(cv2.CAP_PROP_FOURCC, cv2.VideoWriter.fourcc(*"MJPG"))
    capture.set(cv2.CAP_PROP_FRAME_WIDTH, width_px)
    capture.set(cv2.CAP_PROP_FRAME_HEIGHT, height_px)
    return Connection(_captured(capture))


def _captured(capture: Any) -> Generator[CameraPicture]:
    missed = 0
    try:
        while missed < MAX_MISSED:
            succeeded, bgr = capture.read()
            missed = 0 if succeeded else missed + 1
            if succeeded:
                yield CameraPicture(np.asarray(cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB), dtype=np.uint8))
    finally:
        capture.release()


def existing(text: str) -> Path | None:
    """Return the path that a text names if it exists, even if the text looks like an address; otherwise None."""
    with suppress(OSError):  # too long for a path
        return Path(text) if Path(text).exists() else None
    return None


def _local_file(address: str) -> Path | None:
    """Return the file that an address names: an existing one, or one after `file:`; None for other addresses."""
    path = existing(address)
    if path is not None and path.is_file():
        return path
    scheme, _, name = address.partition(":")
    return Path(name.removeprefix("//")) if scheme.lower() == "file" else None


def _addressed(address: str, width_px: int, height_px: int, on_note: Callable[[str], None]) -> Connection:
    """Open a camera or server by an address for FFmpeg."""
    import av

    v4l2, name, path = _V4L2.fullmatch(address), shortened(without_password(address), 80), _local_file(address)
    with ExitStack() as stack:
        try:
            if path is not None:
                container = stack.enter_context(_opened_sdp(path) if is_sdp(path) else opened(path))
            elif v4l2:
                container = stack.enter_context(_opened_v4l2(v4l2["device"], f"{width_px}x{height_px}"))
            else:
                container = stack.enter_context(_opened_stream(address))
        except InputError:
            raise
        except (av.FFmpegError, OSError, ValueError) as error:
            reason = getattr(error, "strerror", None) or str(error).replace(address, name)
            if isinstance(error, av.error.ExitError):
                reason = f"no answer within {OPENING_S:g} s"
            elif isinstance(error, av.error.ArgumentError) and not v4l2:
                reason = "not a supported format of streams, such as a playlist"
            raise InputError(
                shortened(
                    f"{name} cannot be opened: {reason}; expected the number of a camera, /dev/videoN, a file, or an "
                    f"address by {', '.join(_SCHEMES)}, such as rtsp://HOST/PATH"
                )
            ) from None
        if not container.streams.video:
            raise InputError(f"{name} has no pictures, expected a camera or a video")
        ends = container.duration is not None or (path is not None and not is_sdp(path))
        return Connection(_decoded(container, stack.pop_all(), name, on_note), ends=ends)


def is_sdp(path: Path) -> bool:
    """Return whether a file has the suffix of an SDP description of an RTP stream."""
    return path.suffix.lower() == ".sdp"


@contextmanager
def _opened_sdp(path: Path) -> Iterator[Any]:
    """Open an RTP stream by its description (SDP) as an FFmpeg container; no other file is read."""
    stored_bytes(path)
    options = {"protocol_whitelist": "rtp,udp"}
    with MediaFile(path) as file, _opened(file, format="sdp", options=options) as container:
        yield container


def _opened_stream(address: str) -> Any:
    """Open the stream of a server as an FFmpeg container; raises ValueError for a scheme outside `_SCHEMES`."""
    scheme = address.partition("://")[0] if "://" in address else ""
    if scheme not in _SCHEMES:
        raise ValueError("neither a file nor an address of a supported kind")
    formats, protocols = _SCHEMES[scheme]
    options = {"format_whitelist": formats, "protocol_whitelist": protocols}
    if formats.startswith("rtsp"):
        options["rtsp_transport"] = "tcp"  # UDP loses packets, which damages pictures
    return _opened(address, options=options)


def _opened_v4l2(device: str, size: str) -> Any:
    """Open a v4l2 device as an FFmpeg container, with JPEG if supported, else the default format."""
    import av

    options = {"video_size": size}
    try:
        return _opened(device, format="v4l2", options={**options, "input_format": "mjpeg"})
    except (av.error.FileNotFoundError, av.error.PermissionError):
        raise
    except av.FFmpegError:
        return _opened(device, format="v4l2", options=options)


def _opened(address: Any, **settings: Any) -> Any:
    import av

    return av.open(address, timeout=(OPENING_S, READING_S), metadata_errors="replace", **settings)


def _decoded(container: Any, stack: ExitStack, name: str, on_note: Callable[[str], None]) -> Generator[CameraPicture]:
    """Yield the pictures of a container until it ends or fails; `stack` closes it, `on_note` gets remarks.

    After damage, pictures are lost until the next key frame.
    """
    import av

    stream = container.streams.video[0]
    # Otherwise, FFmpeg conceals errors in the data, and the frame seems complete.
    stream.codec_context.options = {"err_detect": "crccheck+explode"}
    stream.thread_type = "SLICE"  # frame threads would delay each picture by some frames
    started, complete, bits = False, False, SampleBits()

    def pixels(frame: Any) -> NDArray[np.uint8]:
        nonlocal bits
        if not has_16_bits(frame):
            return rgb_of(frame)
        # From all pictures so far: a dark one does not show how many bits the camera uses.
        samples = samples_of_16_bits(frame)
        previous, bits = bits, SampleBits.combined((bits, SampleBits.of(samples)))
        if bits.used != previous.used:
            on_note(f"{name}: {bits}")
        return rgb_of_samples(samples, bits.used)

    try:
        for packet in container.demux(stream):
            try:
                frames = packet.decode()
            except av.error.InvalidDataError:
                frames, complete = [], False
                if started:
                    yield CameraPicture(None)
            for frame in frames:
                key = bool(frame.key_frame) and frame.pict_type == _INTRA
                complete = (complete or key or bool(stream.codec_context.codec.intra_only)) and not frame.is_corrupt
                if complete and not started:
                    started = True
                    for line in frame_remarks(name, [frame]):
                        on_note(line)
                if started:
                    yield CameraPicture(pixels(frame) if complete else None, frame.time)
    except (av.FFmpegError, OSError):
        return  # disconnected
    finally:
        stack.close()
