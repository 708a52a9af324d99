"""Speed of a live session beside bare video decoding: `python -m benchmarks.live [VIDEO [LAYOUT]] [--seconds S]`.

Shows a video of the layout's camera (without VIDEO, a textured picture that drifts, with noise, is made, H.264 of
1920 x 1080 px, 30 frames/s) as a page would: frame, nine views, a refocused picture and depth at the same time. First
the limit, in one thread: reading the video, encoding each frame at the size of the page, and nothing else. Then the
session at the video's pace, with depth and without, and depth alone; and the session as fast as it goes.

Prints pictures/s, their 95 % (the rate at which 19 in 20 follow one another), the latency from the arrival of a frame
to its encoded pictures, median and 95 %, frames dropped, and memory of the process that decodes.
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

WANTED_HZ, WANTED_DEPTH_HZ = 15.0, 8.0
TIMES = 5
"""How often the video that is made is shown."""
LOOK_S = 0.004
"""Time between two looks at what is newest."""
SETTLED_S = 3.0
"""Time after which a session counts: programs are loaded and compiled by then."""


@dataclass
class Steps:
    """Times at which pictures of a kind arrived."""

    kind: PictureKind
    serial: int = 0
    moments: list[float] | None = None

    def note(self, engine: LiveEngine) -> None:
        picture = engine.latest(self.kind)
        if picture is not None and picture.serial > self.serial:
            self.serial = picture.serial
            self.moments = [*(self.moments or []), time.perf_counter()]

    @property
    def text(self) -> str:
        steps = np.diff(self.moments or [])
        if len(steps) < 2:
            return "none"
        return f"{1.0 / np.mean(steps):.1f}/s, 95 % {1.0 / np.quantile(steps, 0.95):.1f}/s"


def repeated(path: Path, to: Path, times: int) -> None:
    """Write a video without B-frames again, a number of times in one file."""
    with av.open(str(path)) as given, av.open(str(to), "w") as made:
        source = given.streams.video[0]
        stream = made.add_stream_from_template(source)
        packets = [bytes(packet) for packet in given.demux(source) if packet.size]
        assert source.average_rate is not None
        for number in range(times * len(packets)):
            packet = av.Packet(packets[number % len(packets)])
            packet.stream, packet.time_base = stream, 1 / source.average_rate
            packet.pts = packet.dts = number
            packet.is_keyframe = number % len(packets) == 0
            made.mux(packet)


def limit(video: Path) -> float:
    """Frames per second of reading and encoding alone, which is printed too."""
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
    with tempfile.TemporaryDirectory() as out, LiveEngine(request, out=Path(out)) as engine:
        engine.show(kinds)
        if "depth" in kinds:
            engine.wait_for("depth", 0, 30.0)
        time.sleep(SETTLED_S)
        start, steps = time.perf_counter(), [Steps(kind) for kind in ("views", "depth")]
        dropped = engine.status().dropped
        while time.perf_counter() - start < seconds:
            for each in steps:
                each.note(engine)
            time.sleep(LOOK_S)
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
    given = parser.parse_args()
    layout = Layout.load(given.layout)
    with tempfile.TemporaryDirectory() as folder:
        video = given.video
        if video is None:
            write_video(Path(folder) / "once.mp4", layout.camera.width_px, layout.camera.height_px)
            video = Path(folder) / "video.mp4"
            repeated(Path(folder) / "once.mp4", video, TIMES)
        figures = {"reading_and_jpeg_hz": limit(video)}
        request = LiveRequest(given.layout, str(video))
        fast = LiveRequest(given.layout, str(video), every_frame=True)
        rows = [
            session("frame, views, refocus, depth", request, (*DECODED, "depth"), given.seconds),
            session("frame, views, refocus", request, DECODED, given.seconds),
            session("depth alone", request, ("depth",), given.seconds),
            session("as fast as it goes", fast, DECODED, given.seconds),
        ]
    head = ("shown", "views and refocused", "depth", "latency, median and 95 %", "of depth")
    write_record(given.json, "live", figures, table(head, rows))
    print(f"wanted: views and refocus {WANTED_HZ:.0f}/s, depth {WANTED_DEPTH_HZ:.0f}/s")


if __name__ == "__main__":
    main()
