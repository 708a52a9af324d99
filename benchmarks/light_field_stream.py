"""Videos to light fields: `python -m benchmarks.light_field_stream [FRAMES] [LAYOUT]`.

Makes a H.264 and a MJPEG video of the layout's camera (a textured picture that drifts, with noise), and prints for each
the frames per second, and the milliseconds of processor time per frame (all cores together), of reading alone, of
decoding views of 400 px, and of streaming these, and views in the frames' resolution, to Zarr. Then decodes FRAMES
(10,000) frames of the H.264 video, repeatedly, and prints the memory of the process meanwhile.
"""

from __future__ import annotations

import argparse
import resource
import shutil
import tempfile
import time
from collections.abc import Callable, Iterator
from fractions import Fraction
from functools import partial
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.records import add_json_option, write_record
from mirrorcam.core.video.frames import Frame, Lost
from mirrorcam.core.video.video import Video
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.light_field.decoder import Decoder
from mirrorcam.optics.light_field.io.recording import Recording, about
from mirrorcam.optics.light_field.io.stream import light_fields, record
from mirrorcam.optics.light_field.io.zarr_store import ZarrSink

DEFAULT_LAYOUT = Path(__file__).parents[1] / "tests" / "data" / "default_layout.json"
LENGTH = 240
RATE_HZ = 30
MIN_HZ = 45.0
MAX_GROWTH_MB = 30.0


def pictures(width: int, height: int) -> Iterator[NDArray[np.uint8]]:
    """Yield textured pictures (h, w, 3) that drift by 2 px per frame, with sensor noise."""
    random = np.random.default_rng(0)
    texture = np.zeros((height, width, 3), np.float32)
    for octave in range(1, 6):
        coarse = random.random((height >> octave, width >> octave, 3), dtype=np.float32)
        texture += cv2.resize(coarse, (width, height), interpolation=cv2.INTER_CUBIC) * (octave * 17.0)
    noise = [random.normal(0.0, 4.0, texture.shape).astype(np.float32) for _ in range(3)]
    for number in range(LENGTH):
        yield np.clip(np.roll(texture, 2 * number, axis=1) + noise[number % 3], 0, 255).astype(np.uint8)


def write_video(path: Path, width: int, height: int) -> None:
    """Write the pictures as H.264 of 10 Mbit/s with a key frame per second (.mp4), or as JPEGs of quality 90 (.avi)."""
    jpeg = path.suffix == ".avi"
    with av.open(str(path), "w") as container:
        settings = {} if jpeg else {"preset": "veryfast", "tune": "zerolatency", "b": "10M", "g": str(RATE_HZ)}
        stream: Any = container.add_stream("mjpeg" if jpeg else "libx264", rate=RATE_HZ, options=settings)
        stream.width, stream.height, stream.pix_fmt = width, height, "yuvj420p" if jpeg else "yuv420p"
        for number, picture in enumerate(pictures(width, height)):
            if jpeg:
                _, encoded = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, 90])
                packet: Any = av.Packet(encoded.tobytes())
                packet.stream, packet.time_base, packet.is_keyframe = stream, Fraction(1, RATE_HZ), True
                packet.pts = packet.dts = number
                container.mux(packet)
            else:
                container.mux(stream.encode(av.VideoFrame.from_ndarray(picture, format="rgb24")))
        if not jpeg:
            container.mux(stream.encode(None))


def measure(name: str, job: Callable[[], int]) -> None:
    """Print the rate of a job that returns the number of its frames."""
    wall, processor = time.perf_counter(), time.process_time()
    count = job()
    seconds = time.perf_counter() - wall
    frame_ms = 1e3 * (time.process_time() - processor) / count
    print(f"  {name:34} {count / seconds:6.1f} frames/s   {frame_ms:5.1f} ms of processor time per frame")


def read(video: Video) -> int:
    """Return the number of frames read."""
    return sum(1 for _ in video.frames())


def decode(decoder: Decoder, video: Video) -> int:
    """Return the number of frames decoded."""
    return sum(1 for _ in light_fields(decoder, video))


def to_zarr(decoder: Decoder, video: Video, path: Path) -> int:
    """Return the number of frames decoded and written."""
    recording = Recording(path, about(decoder.views, {}), ZarrSink())
    record(decoder, video, recording)
    recording.finish()
    return len(recording.entries.numbers)


class Loop:
    """A video repeated up to a number of frames."""

    def __init__(self, video: Video, count: int) -> None:
        self.video, self.count = video, count

    def frames(self, after: int = -1) -> Iterator[Frame | Lost]:
        """Yield the frames."""
        number = after + 1
        while True:
            for frame in self.video.frames():
                if number == self.count:
                    return
                yield frame
                number += 1

    def stop(self) -> None:
        """Do nothing: files end by themselves."""


def resident_mb() -> float:
    """Return the memory of the process."""
    return int(Path("/proc/self/statm").read_text(encoding="utf-8").split()[1]) * resource.getpagesize() / 1e6


def main(count: int, layout: Layout, json: Path | None) -> None:
    camera = layout.camera
    decoders = {"400 px": Decoder(layout, width_px=400), "all": Decoder(layout)}
    sizes = {name: f"{decoder.views.width_px}x{decoder.views.height_px}" for name, decoder in decoders.items()}
    with tempfile.TemporaryDirectory() as folder:
        for name in ("video.mp4", "video.avi"):
            path = Path(folder) / name
            write_video(path, camera.width_px, camera.height_px)
            video = Video(path)
            kind = "H.264" if path.suffix == ".mp4" else "MJPEG"
            print(
                f"{kind}, {camera.width_px}x{camera.height_px}, {path.stat().st_size / 1e6 / LENGTH:.2f} MB per frame"
            )
            measure("reading alone", partial(read, video))
            for label, decoder in decoders.items():
                views = f"views of {sizes[label]}"
                measure(views, partial(decode, decoder, video))
                store = Path(folder) / f"{name}-{sizes[label]}.zarr"
                measure(f"{views} to Zarr", partial(to_zarr, decoder, video, store))
                shutil.rmtree(store)
        print(f"required: {MIN_HZ:.0f} frames/s")
        loop = Loop(Video(Path(folder) / "video.mp4"), count)
        memory_mb: list[float] = []
        start = time.perf_counter()
        for done, item in enumerate(light_fields(decoders["400 px"], loop), start=1):
            assert not isinstance(item, Lost)
            if done % max(1, count // 10) == 0:
                memory_mb.append(resident_mb())
                print(
                    f"after {done:6} frames: {memory_mb[-1]:.0f} MB, "
                    f"{done / (time.perf_counter() - start):.0f} frames/s"
                )
    growth_mb = max(memory_mb[2:]) - memory_mb[1]
    print(f"grown by {growth_mb:.0f} MB after the first {count // 5} frames (at most {MAX_GROWTH_MB:.0f})")
    write_record(json, "light_field_stream", {"grown_mb": growth_mb})


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("frames", type=int, nargs="?", default=10_000, metavar="FRAMES")
    parser.add_argument("layout", type=Path, nargs="?", default=DEFAULT_LAYOUT, metavar="LAYOUT")
    add_json_option(parser)
    options = parser.parse_args()
    main(options.frames, Layout.load(options.layout), options.json)
