"""Speed of decoding, against a bare `cv2.remap`: `python -m benchmarks.decode [LAYOUT] [--json FILE]`.

For one frame in memory, in the size of the layout's camera: milliseconds of `Decoder.decode` for a pinhole camera and
for the pupil of a C920, of both with equalised views, of the bare lookup, and of copying the result, all in the same
run, interleaved; median and best of the rounds. Then how the time grows with the pixels of the views.
"""

from __future__ import annotations

import argparse
import statistics
import time
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np

from benchmarks.records import add_json_option, write_record
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.pupil import PINHOLE
from mirrorcam.optics.light_field.decoder import Decoder
from mirrorcam.optics.light_field.equalisation import Equalisation

DEFAULT_LAYOUT = Path(__file__).parents[1] / "tests" / "data" / "default_layout.json"
ROUNDS = 200
MAX_TIMES_REMAP = 1.3
WIDTHS_PX = (100, 200, 300, 400, 480)
MIN_HZ = 100.0


def median_ms(jobs: dict[str, Callable[[], object]], rounds: int = ROUNDS) -> dict[str, float]:
    """Print and return the jobs' median milliseconds; each round runs every job once."""
    times_ms: dict[str, list[float]] = {name: [] for name in jobs}
    for _ in range(rounds):
        for name, job in jobs.items():
            start = time.perf_counter()
            job()
            times_ms[name].append(1e3 * (time.perf_counter() - start))
    for name, values in times_ms.items():
        print(f"{name:26} median {statistics.median(values):6.2f} ms  best {min(values):6.2f} ms")
    return {name: statistics.median(values) for name, values in times_ms.items()}


def decode_times(layout: Layout) -> dict[str, float]:
    """Print times of decoding, of the bare lookup and of a copy for a layout; return its figures."""
    decoders, built_ms = [], []
    for pupil in (PINHOLE, Camera.c920().pupil):
        start = time.perf_counter()
        decoders.append(Decoder(layout.replaced(camera=layout.camera.with_pupil(pupil))))
        built_ms.append(1e3 * (time.perf_counter() - start))
    decoder, lens = decoders
    camera, views = layout.camera, decoder.views
    random = np.random.default_rng(0)
    frame = random.integers(0, 255, (camera.height_px, camera.width_px, 3), dtype=np.uint8)
    samples = decoder.decode(frame).samples
    gain = random.uniform(0.8, 1.2, (views.rows, views.cols, 3))
    equal, equal_lens = (
        one.equalised(Equalisation(layout_identity=one.views.layout_identity, gain=gain)) for one in decoders
    )

    def bare() -> None:
        for pixels, fraction in decoder.tables:
            cv2.remap(frame, pixels, fraction, cv2.INTER_LINEAR)

    print(
        f"{views.rows}x{views.cols} views of {views.width_px}x{views.height_px} px from {camera.width_px}x"
        f"{camera.height_px}, {cv2.getNumThreads()} threads; table built once in {built_ms[0]:.0f} ms, of a lens in "
        f"{built_ms[1]:.0f} ms"
    )
    medians = median_ms(
        {
            "Decoder.decode": lambda: decoder.decode(frame),
            "the same, equalised": lambda: equal.decode(frame),
            "with a lens": lambda: lens.decode(frame),
            "with a lens, equalised": lambda: equal_lens.decode(frame),
            "bare cv2.remap": bare,
            "copy of the result": samples.copy,
        }
    )
    for name in list(medians)[:4]:
        ratio = medians[name] / medians["bare cv2.remap"]
        print(f"{name:26} {ratio:.3f} x the bare lookup (at most {MAX_TIMES_REMAP})")
    print(f"{1e3 / medians['Decoder.decode']:.0f} frames/s; a camera gives 30")
    bare_ms = medians["bare cv2.remap"]
    return {
        "decode_hz": 1e3 / medians["Decoder.decode"],
        "times_remap": medians["Decoder.decode"] / bare_ms,
        "equalised_times_remap": medians["the same, equalised"] / bare_ms,
        "lens_times_remap": medians["with a lens"] / bare_ms,
    }


def by_pixels(layout: Layout) -> None:
    """Time decoding against the number of pixels of all views."""
    camera = layout.camera
    frame = np.random.default_rng(0).integers(0, 255, (camera.height_px, camera.width_px, 3), dtype=np.uint8)
    decoders = [Decoder(layout, width_px=width_px) for width_px in WIDTHS_PX]

    def job(decoder: Decoder) -> Callable[[], object]:
        return lambda: decoder.decode(frame)

    count = decoders[0].views.rows * decoders[0].views.cols
    sizes = [(decoder.views.width_px, decoder.views.height_px) for decoder in decoders]
    medians = median_ms(
        {f"{count} views of {w}x{h}": job(decoder) for (w, h), decoder in zip(sizes, decoders, strict=True)},
        50,
    )
    for (width, height), ms in zip(sizes, medians.values(), strict=True):
        print(f"{width}x{height}: {1e6 * ms / (count * width * height):.1f} ns per pixel, {1e3 / ms:.0f} frames/s")
    print(f"required for nine views of 400x240: {MIN_HZ:.0f} frames/s")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("layout", nargs="?", type=Path, default=DEFAULT_LAYOUT)
    add_json_option(parser)
    options = parser.parse_args()
    chosen = Layout.load(options.layout)
    write_record(options.json, "decode", decode_times(chosen))
    by_pixels(chosen)
