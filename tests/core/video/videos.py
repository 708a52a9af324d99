"""Small videos, made by the test that needs them, and damage to them."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
from numpy.typing import NDArray

RATE = 25


def pictures(count: int, width: int = 160, height: int = 96) -> list[NDArray[np.uint8]]:
    """Smooth coloured pictures (h, w, 3) that drift, each with its number as a grey level in a corner of 32 x 32."""
    v, u = np.mgrid[0:height, 0:width].astype(np.float64)
    made = []
    for number in range(count):
        waves = [128 + 60 * np.sin((u + 2 * number) / (9 + k) + k) * np.cos(v / (11 + 2 * k)) for k in range(3)]
        picture = np.stack(waves, axis=-1).astype(np.uint8)
        picture[:32, :32] = 20 + 5 * number
        made.append(picture)
    return made


def number_in(picture: NDArray[np.uint8]) -> int:
    """The number that `pictures` has put into a picture."""
    return round((float(picture[8:24, 8:24].mean()) - 20) / 5)


def write_h264(
    path: Path,
    frames: list[NDArray[np.uint8]],
    *,
    key_every: int = 10,
    b_frames: int = 0,
    interlaced: bool = False,
    matrix: tuple[int, int, int, int] | None = None,
) -> Path:
    """An H.264 file with the given distance of key frames; MP4 with its index in front.

    Fields are those of frames where it is `interlaced`; players show it by `matrix`, of which 1 is no change.
    """
    settings = {
        "preset": "veryfast",
        "crf": "18",
        "g": str(key_every),
        "keyint_min": str(key_every),
        "sc_threshold": "0",
    }
    if interlaced:
        settings["flags"] = "+ildct+ilme"
    with av.open(str(path), "w", options={"movflags": "faststart"} if path.suffix == ".mp4" else {}) as container:
        stream: Any = container.add_stream("libx264", rate=RATE, options=settings | {"bf": str(b_frames)})
        stream.height, stream.width = frames[0].shape[:2]
        stream.pix_fmt = "yuv420p"
        stream.codec_context.thread_count = 1
        if matrix is not None:
            a, b, c, d = (each << 16 for each in matrix)
            stream.set_display_matrix([a, b, 0, c, d, 0, 0, 0, 1 << 30])
        for number, frame in enumerate(frames):
            picture = av.VideoFrame.from_ndarray(frame, format="rgb24")
            picture.pts, picture.time_base = number, Fraction(1, RATE)
            container.mux(stream.encode(picture))
        container.mux(stream.encode(None))
    return path


def write_mjpeg(path: Path, frames: list[NDArray[np.uint8]]) -> Path:
    """A video of JPEG pictures, as webcams give them."""
    with av.open(str(path), "w") as container:
        stream: Any = container.add_stream("mjpeg", rate=RATE)
        stream.height, stream.width = frames[0].shape[:2]
        stream.pix_fmt = "yuvj420p"
        for number, frame in enumerate(frames):
            _, encoded = cv2.imencode(".jpg", frame[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 92])
            packet: Any = av.Packet(encoded.tobytes())
            packet.stream, packet.time_base = stream, Fraction(1, RATE)
            packet.pts = packet.dts = number
            packet.is_keyframe = True
            container.mux(packet)
    return path


def damage(path: Path, number: int) -> None:
    """Overwrite the middle of one frame's data in the file."""
    with av.open(str(path)) as container:
        packet = [packet for packet in container.demux(video=0) if packet.size][number]
        assert packet.pos is not None
        start, size = packet.pos + packet.size // 3, packet.size // 2
    raw = bytearray(path.read_bytes())
    raw[start : start + size] = bytes(np.random.default_rng(0).integers(0, 256, size, dtype=np.uint8))
    path.write_bytes(raw)


def cut(path: Path, part: float) -> None:
    """Keep only the first part of a file."""
    raw = path.read_bytes()
    path.write_bytes(raw[: int(len(raw) * part)])


def write_ramps(path: Path, stored: str, bits: int, largest: tuple[int, ...]) -> Path:
    """Write frames of 64 x 48 samples of 16 bits, of which the lowest are used: ramps up to given values of 8 bits."""
    channels = 3 if stored.startswith("rgb") else 1
    with av.open(str(path), "w") as container:
        stream: Any = container.add_stream("ffv1", rate=10)
        stream.width, stream.height, stream.pix_fmt = 64, 48, stored
        for each in largest:
            ramp = np.linspace(0, each, 48 * 64 * channels).astype("<u2").reshape(48, -1) << (bits - 8)
            frame = av.VideoFrame(64, 48, stored)
            lines = np.zeros((48, frame.planes[0].line_size // 2), "<u2")
            lines[:, : ramp.shape[1]] = ramp
            frame.planes[0].update(lines.tobytes())
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    return path
