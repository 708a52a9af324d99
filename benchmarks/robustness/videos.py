"""Damaged videos: refused, or read as far as frames are whole, each with the number or time of the filmed one.

Neither H.264 nor JPEG has a checksum: a flipped bit can give the very data that an encoder writes for another picture,
which no reader can tell from damage. Such frames are counted as wrong all the same, as "valid data": strict decoders
(libjpeg, and FFmpeg in one thread) take them, and all frames that they depend on, without a word.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from fractions import Fraction
from functools import cache
from pathlib import Path
from typing import Any

import av
import av.logging
import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.robustness.damage import damaged_bytes
from benchmarks.robustness.guard import Category, refused_well
from mirrorcam.core.values import InputError
from mirrorcam.core.video.frames import Frame
from mirrorcam.core.video.media_files import opened
from mirrorcam.core.video.video import Video

COUNT, WIDTH, HEIGHT, RATE = 30, 320, 240, 25
WRONG_BY = 24
"""Difference of a wrong pixel, of 255."""
WRONG_PART = 0.02
"""Part of the pixels of a kept frame that may be wrong."""
MOST_FRAMES = 50 * COUNT

KINDS = {
    "H.264": ("a.mp4", "libx264", {"movflags": "faststart"}),
    "index at the end": ("a.mp4", "libx264", {}),
    "MKV": ("a.mkv", "libx264", {}),
    "stream": ("a.ts", "libx264", {}),
    "MJPEG": ("a.avi", "mjpeg", {}),
    "MJPEG in MKV": ("a.mkv", "mjpeg", {}),
}


@cache
def shown() -> tuple[NDArray[np.uint8], ...]:
    """Pictures (h, w, 3) of a drifting scene with noise, all different."""
    random = np.random.default_rng(0)
    field = cv2.resize(random.uniform(30, 220, (40, 60, 3)), (2 * WIDTH, 2 * HEIGHT), interpolation=cv2.INTER_CUBIC)
    views = (field[3 * n : 3 * n + HEIGHT, 5 * n : 5 * n + WIDTH] for n in range(COUNT))
    return tuple(np.clip(view + random.normal(0, 2, view.shape), 0, 255).astype(np.uint8) for view in views)


def written(path: Path, codec: str, options: dict[str, str], gaps: bool = False) -> None:
    """Write the pictures as a video; with `gaps`, at uneven times."""
    with av.open(str(path), "w", options=options) as container:
        settings = {"preset": "veryfast", "crf": "18", "g": "10", "bf": "2"} if codec == "libx264" else {"qmin": "2"}
        stream: Any = container.add_stream(codec, rate=RATE, options=settings)
        stream.width, stream.height = WIDTH, HEIGHT
        stream.pix_fmt = "yuv420p" if codec == "libx264" else "yuvj420p"
        stream.codec_context.thread_count = 1
        for number, picture in enumerate(shown()):
            frame = av.VideoFrame.from_ndarray(picture, format="rgb24")
            frame.pts, frame.time_base = number + (number // 3 if gaps else 0), Fraction(1, RATE)
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))


@dataclass(frozen=True, eq=False)
class Whole:
    """A whole video of a kind: its name and bytes, its frames and their times, and whether they are evenly spaced."""

    name: str
    raw: bytes
    pictures: tuple[NDArray[np.uint8], ...]
    times_s: tuple[float, ...]
    even: bool


@cache
def good() -> dict[str, Whole]:
    """A whole video of each kind."""
    found = {}
    with tempfile.TemporaryDirectory() as folder:
        for kind, (name, codec, options) in KINDS.items():
            for gaps in (False, True):
                path = Path(folder) / name
                written(path, codec, options, gaps)
                frames = [item for item in Video(path).frames() if isinstance(item, Frame)]
                found[f"{kind}, uneven" if gaps else kind] = Whole(
                    name,
                    path.read_bytes(),
                    tuple(frame.pixels for frame in frames),
                    tuple(frame.time_s for frame in frames),
                    not gaps,
                )
    return found


def _cut(raw: bytes, random: np.random.Generator) -> bytes:
    return raw[: int(random.integers(len(raw)))]


def _flipped(raw: bytes, random: np.random.Generator) -> bytes:
    data = bytearray(raw)
    for at in random.integers(len(data), size=int(random.integers(1, 40))):
        data[at] ^= 1 << int(random.integers(8))
    return bytes(data)


def _header(raw: bytes, random: np.random.Generator) -> bytes:
    """The bytes with some at the beginning set to the largest value: sizes, counts and times are there."""
    data = bytearray(raw)
    at = int(random.integers(min(len(data), 1200)))
    data[at : at + 4] = b"\xff" * int(random.integers(1, 5))
    return bytes(data)


def _without_index(raw: bytes, random: np.random.Generator) -> bytes:
    """The bytes with the name of an index spoilt, where there is one."""
    for name in (b"moov", b"idx1", b"\x1c\x53\xbb\x6b", b"stsz", b"stco", b"stts", b"ctts"):
        if name in raw and random.random() < 0.5:
            return raw.replace(name, b"free", 1)
    return raw


DAMAGES: tuple[Callable[[bytes, np.random.Generator], bytes], ...] = (
    damaged_bytes,
    damaged_bytes,
    _cut,
    _flipped,
    _header,
    _without_index,
)


def damaged(seed: int) -> tuple[str, str, bytes, str]:
    """Kind and name of a video, its bytes with the damage of a seed, and what kind of damage that is."""
    random = np.random.default_rng(seed)
    kind = str(random.choice(sorted(good())))
    name = good()[kind].name
    if random.random() < 0.1:
        name = str(random.choice(["a.avi", "a.mp4", "a.mkv", "a.mov", "a.dat"]))
    damage = DAMAGES[int(random.integers(len(DAMAGES)))]
    return kind, name, damage(good()[kind].raw, random), damage.__name__


def attempt(seed: int, folder: Path) -> str:
    """Read a damaged video, and compare each frame that is kept with the filmed one of its number or time."""
    kind, name, raw, damage = damaged(seed)
    path = folder / name
    path.write_bytes(raw)
    check = _Check(good()[kind])
    try:
        for number, item in enumerate(Video(path).frames()):
            wrong = f"gives more than {number} frames" if number >= MOST_FRAMES else ""
            if isinstance(item, Frame):
                wrong = wrong or check(item)
                wrong += ", of valid data" if wrong.endswith("kept") and item.time_s in valid_times_s(path) else ""
            if wrong:
                return f"{kind}, {damage}: {wrong}"
    except InputError as error:
        return refused_well(str(error).replace(str(folder), "")) or (
            "" if str(error).startswith(str(path)) else f"names no file: {str(error)[:80]}"
        )
    return ""


def valid_times_s(path: Path) -> set[float]:
    """Times of the frames of a file that FFmpeg decodes without a word, as all that they depend on."""
    found, silent = set(), False
    av.logging.set_level(av.logging.VERBOSE)
    try:
        with av.logging.Capture() as said, opened(path) as container:
            stream = container.streams.video[0]
            decoder, start = stream.codec_context, stream.start_time or 0
            decoder.thread_count = 1
            decoder.options = {"err_detect": "explode+bitstream+buffer+careful"}
            for packet in container.demux(stream):
                before = len(said)
                silent |= packet.is_keyframe
                with suppress(av.FFmpegError):
                    decoder.decode(packet)
                silent &= not any(level < av.logging.VERBOSE for level, _, _ in said[before:])
                moment = packet.pts if container.format.name != "avi" else packet.dts
                if silent and packet.size and moment is not None:
                    found.add(float((moment - start) * (stream.time_base or 0)))
    except (av.FFmpegError, InputError):
        pass
    finally:
        av.logging.set_level(None)
    return found


@dataclass
class _Check:
    """Says what is wrong with a kept frame: its pixels, or its number and time beside those of the frames before.

    Numbers are those of the filmed frames; where frames are at uneven times, it may be the times instead. Where the
    start of a file is lost, they are counted from the first frame that is left.
    """

    whole: Whole
    shifts: set[tuple[int, float]] = field(default_factory=set)

    def __call__(self, frame: Frame) -> str:
        expected = self.whole.pictures
        if frame.pixels.shape != expected[0].shape:
            return f"frame {frame.number} has shape {frame.pixels.shape}"
        parts: dict[int, float] = {}
        for shown in sorted(range(len(expected)), key=lambda number: abs(number - frame.number)):
            parts[shown] = _wrong_part(frame.pixels, expected[shown])
            if parts[shown] <= WRONG_PART:
                break
        else:
            return f"{min(parts.values()):.0%} of frame {frame.number} is wrong, and kept"
        time_s = self.whole.times_s[shown]
        self.shifts.add((frame.number - shown, round(frame.time_s - time_s, 2)))
        numbers, times = map(set, zip(*self.shifts, strict=True))
        if len(numbers) == 1 or (len(times) == 1 and not self.whole.even):
            return ""
        return f"frame {frame.number} at {frame.time_s:.3f} s is filmed frame {shown} at {time_s:.3f} s"


def _wrong_part(found: NDArray[np.uint8], expected: NDArray[np.uint8]) -> float:
    return float(np.mean((np.abs(found.astype(np.int16) - expected) > WRONG_BY).any(axis=-1)))


CATEGORY = Category("videos", 1_000, attempt)
