"""Speed of a live session against bare video decoding: `python -m benchmarks.live [VIDEO [LAYOUT]] [--seconds S]`.

Shows a video of the layout's camera (by default a generated one: a noisy, textured picture that drifts, H.264 of
1920 x 1080 px, 30 frames/s) like the page: frame, nine views, a refocused picture and depth at the same time. First
the limit, in one thread: only reading the video, and encoding each frame in the size of the page. Then the session at
the video's rate, with depth and without, and depth alone; and the session at full speed.

Prints pictures/s, their 95 % (19 in 20 intervals are shorter than at this rate), the latency from a frame's arrival to
its encoded pictures, median and 95 %, frames dropped, and memory of the process that decodes.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import av
import cv2
import numpy as np
import simplejpeg

from benchmarks.light_field_stream import DEFAULT_LAYOUT, write_video
from benchmarks.records import add_json_option, table, write_record
from mirrorcam.core.video.frames import Frame
from mirrorcam.core.video.video import Video
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.studio.live.engine import LiveEngine
from mirrorcam.studio.live.session import JPEG_QUALITY
from mirrorcam.studio.live.values import DECODED, FRAME_WIDTH_PX, LiveRequest, PictureKind

MIN_HZ, MIN_DEPTH_HZ = 15.0, 8.0
IDLE_S = 1.0
"""Time after which pictures that are not requested are no longer made."""
TIMES = 5
"""Number of repetitions of the generated video."""
POLL_S = 0.004
"""Interval between checks for new pictures."""
SETTLED_S = 3.0
"""Time after which a session is measured: by then, programs are loaded and compiled."""


@dataclass
class Arrivals:
    """Arrival times of pictures of a kind."""

    kind: PictureKind
    serial: int = 0
    moments: list[float] | None = None

    def note(self, engine: LiveEngine) -> None:
        picture = engine.wait_for(self.kind, self.serial, 0.0)
        if picture is not None:
            self.serial = picture.serial
            self.moments = [*(self.moments or []), time.perf_counter()]

    @property
    def text(self) -> str:
        steps = np.diff(self.moments or [])
        if len(steps) < 2:
            return "none"
        return f"{1.0 / np.mean(steps):.1f}/s, 95 % {1.0 / np.quantile(steps, 0.95):.1f}/s"


def repeat(path: Path, repeated: Path, times: int) -> None:
    """Repeat a video without B-frames a number of times in one file."""
    with av.open(str(path)) as read, av.open(str(repeated), "w") as written:
        source = read.streams.video[0]
        stream = written.add_stream_from_template(source)
        packets = [bytes(packet) for packet in read.demux(source) if packet.size]
        assert source.average_rate is not None
        for number in range(times * len(packets)):
            packet = av.Packet(packets[number % len(packets)])
            packet.stream, packet.time_base = stream, 1 / source.average_rate
            packet.pts = packet.dts = number
            packet.is_keyframe = number % len(packets) == 0
            written.mux(packet)


def limit(video: Path) -> float:
    """Print and return the frames per second of reading and encoding alone."""
    size, count, start = None, 0, time.perf_counter()
    for item in Video(video).frames():
        if not isinstance(item, Frame):
            continue
        height, width = item.pixels.shape[:2]
        size = FRAME_WIDTH_PX, round(height * FRAME_WIDTH_PX / width)
        small = cv2.resize(item.pixels, size, interpolation=cv2.INTER_AREA)
        simplejpeg.encode_jpeg(small, JPEG_QUALITY, colorsubsampling="420")
        count += 1
    rate_hz = count / (time.perf_counter() - start)
    print(f"limit: reading and one JPEG of {size}, one thread: {rate_hz:.0f} frames/s")
    return rate_hz


def session(name: str, request: LiveRequest, kinds: tuple[PictureKind, ...], seconds: float) -> tuple[str, ...]:
    """Print the figures of a session that shows some kinds, and return its row of the table."""
    with tempfile.TemporaryDirectory() as out, LiveEngine(request, out=Path(out), idle_s=IDLE_S) as engine:
        shown = {kind: Arrivals(kind) for kind in kinds}
        settled = time.perf_counter() + SETTLED_S
        while time.perf_counter() < settled or ("depth" in kinds and engine.latest("depth") is None):
            for arrivals in shown.values():
                arrivals.note(engine)
            time.sleep(POLL_S)
        shown = {kind: Arrivals(kind) for kind in kinds}
        start, steps = time.perf_counter(), [shown.get(kind, Arrivals(kind)) for kind in ("views", "depth")]
        dropped = engine.status().dropped
        while time.perf_counter() - start < seconds:
            for arrivals in shown.values():
                arrivals.note(engine)
            time.sleep(POLL_S)
        status = engine.status()
        failed = "" if status.failed is None else f"; failed: {status.failed}"
        ended = " (the video ended)" if status.over else ""
        print(
            f"{name:28} views {steps[0].text}; depth {steps[1].text}; latency {status.latency_ms or 0.0:.0f} ms, "
            f"95 % {status.latency_p95_ms or 0.0:.0f} ms, of depth {status.depth_latency_ms or 0.0:.0f} ms; dropped "
            f"{status.dropped - dropped}; {status.memory_mb:.0f} MB{ended}{failed}"
        )
    latency = f"{status.latency_ms or 0.0:.0f} ms, {status.latency_p95_ms or 0.0:.0f} ms"
    late_depth = f"{status.depth_latency_ms:.0f} ms" if status.depth_latency_ms else ""
    return name, steps[0].text, steps[1].text, latency, late_depth


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("video", nargs="?", type=Path)
    parser.add_argument("layout", nargs="?", type=Path, default=DEFAULT_LAYOUT)
    parser.add_argument("--seconds", type=float, default=10.0)
    add_json_option(parser)
    options = parser.parse_args()
    layout = Layout.load(options.layout)
    with tempfile.TemporaryDirectory() as folder:
        video = options.video
        if video is None:
            write_video(Path(folder) / "once.mp4", layout.camera.width_px, layout.camera.height_px)
            video = Path(folder) / "video.mp4"
            repeat(Path(folder) / "once.mp4", video, TIMES)
        figures = {"reading_and_jpeg_hz": limit(video)}
        request = LiveRequest(options.layout, str(video))
        fast = LiveRequest(options.layout, str(video), every_frame=True)
        rows = [
            session("frame, views, refocus, depth", request, (*DECODED, "depth"), options.seconds),
            session("frame, views, refocus", request, DECODED, options.seconds),
            session("depth alone", request, ("depth",), options.seconds),
            session("at full speed", fast, DECODED, options.seconds),
        ]
    header = ("shown", "views and refocused", "depth", "latency, median and 95 %", "of depth")
    write_record(options.json, "live", figures, table(header, rows))
    print(f"required: views and refocus {MIN_HZ:.0f}/s, depth {MIN_DEPTH_HZ:.0f}/s")


if __name__ == "__main__":
    main()
