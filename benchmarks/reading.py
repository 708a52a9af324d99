"""Time to read a valid picture or a frame of a valid video, against OpenCV's and FFmpeg's decoders in the same run.

`python -m benchmarks.reading` prints medians of interleaved runs, in ms of processor time of all threads; exit code 1
if ours takes more than 5 % longer.
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Callable
from fractions import Fraction
from functools import partial
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.images.pictures import encoded_image, read_image, write_image
from mirrorcam.core.video.video import Video

SIZE = (1920, 1080)
RUNS = 11
FRAMES = 150
MAX_RATIO = 1.05


def medians_ms(*calls: Callable[[], object]) -> tuple[float, ...]:
    """Return the median processor time of each call, ms; the calls are interleaved."""
    times: list[list[float]] = [[] for _ in calls]
    for _ in range(RUNS):
        for call, seconds in zip(calls, times, strict=True):
            start_s = time.process_time()
            call()
            seconds.append(time.process_time() - start_s)
    return tuple(float(np.median(seconds)) * 1e3 for seconds in times)


def opencv(path: Path) -> object:
    """Read a picture by OpenCV, without a check."""
    flags = cv2.IMREAD_COLOR_RGB | cv2.IMREAD_IGNORE_ORIENTATION
    return cv2.imdecode(np.frombuffer(path.read_bytes(), np.uint8), flags)


def ours(path: Path) -> None:
    """Read every frame of a video."""
    assert sum(1 for _ in Video(path).frames()) == FRAMES


def ffmpeg(path: Path) -> None:
    """Read every frame of a video by PyAV, without a check."""
    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        stream.thread_type = "AUTO"
        assert sum(1 for frame in container.decode(stream) if frame.to_ndarray(format="rgb24") is not None) == FRAMES


def write_videos(folder: Path, pictures: list[NDArray[np.uint8]]) -> dict[str, Path]:
    """Write the pictures as videos of H.264 and, like a camera, of JPEGs."""
    paths = {"H.264": folder / "a.mp4", "MJPEG": folder / "a.avi"}
    for codec, path in paths.items():
        with av.open(str(path), "w") as container:
            name, settings = ("libx264", {"preset": "ultrafast"}) if codec == "H.264" else ("mjpeg", {})
            stream: Any = container.add_stream(name, rate=30, options=settings)
            stream.width, stream.height = SIZE
            stream.pix_fmt = "yuv420p" if codec == "H.264" else "yuvj422p"
            for number in range(FRAMES):
                picture = pictures[number % len(pictures)]
                if codec == "H.264":
                    container.mux(stream.encode(av.VideoFrame.from_ndarray(picture, format="rgb24")))
                    continue
                packet: Any = av.Packet(encoded_image(picture, ".jpg", 85))
                packet.stream, packet.time_base, packet.pts, packet.dts = stream, Fraction(1, 30), number, number
                container.mux(packet)
            if codec == "H.264":
                container.mux(stream.encode(None))
    return paths


def main() -> int:
    cv2.setNumThreads(1)
    random = np.random.default_rng(0)
    smooth = cv2.resize(random.uniform(0, 255, (60, 90, 3)), SIZE)
    noisy = [np.clip(smooth + random.normal(0, 4, smooth.shape), 0, 255).astype(np.uint8) for _ in range(4)]
    ratios = []

    def compare(name: str, mine: Callable[[], object], theirs: Callable[[], object], pictures: int) -> None:
        ms, others_ms = (total / pictures for total in medians_ms(mine, theirs))
        print(f"{name:<12}{ms:>10.1f}{others_ms:>12.1f}{ms / others_ms:>8.2f}", flush=True)
        ratios.append(ms / others_ms)

    print(f"{'1920 x 1080':<12}{'ours ms':>10}{'theirs ms':>12}{'ratio':>8}")
    with tempfile.TemporaryDirectory() as folder:
        for name in ("a.png", "a.jpg"):
            path = Path(folder) / name
            write_image(path, noisy[0])
            compare(path.suffix, partial(read_image, path), partial(opencv, path), 1)
        for name, path in write_videos(Path(folder), noisy).items():
            compare(name, partial(ours, path), partial(ffmpeg, path), FRAMES)
    return 1 if max(ratios) > MAX_RATIO else 0


if __name__ == "__main__":
    sys.exit(main())
