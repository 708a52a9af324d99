"""Speed of decoding beside a bare `cv2.remap` of the same tables: `python -m benchmarks.decode [LAYOUT] [--json FILE]`.

For one frame in memory, of the size that the layout's camera takes: milliseconds of `Decoder.decode` of a pinhole
camera and of the pupil of a C920, of both with equalised views, of the bare lookup, and of copying the result, all in
the same run, interleaved; median and best of the rounds. Then how the cost grows with the pixels of the views.
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
MOST_TIMES_THE_LOOKUP = 1.3
WIDTHS_PX = (100, 200, 300, 400, 480)
LEAST_HZ = 100.0


def median_ms(jobs: dict[str, Callable[[], object]], rounds: int = ROUNDS) -> dict[str, float]:
    """The jobs' median milliseconds, each round doing every job once; printed with the best."""
    times_ms: dict[str, list[float]] = {name: [] for name in jobs}
    for _ in range(rounds):
        for name, job in jobs.items():
            start = time.perf_counter()
            job()
            times_ms[name].append(1e3 * (time.perf_counter() - start))
    for name, each in times_ms.items():
        print(f"{name:26} median {statistics.median(each):6.2f} ms  best {min(each):6.2f} ms")
    return {name: statistics.median(each) for name, each in times_ms.items()}


def whole_layout(layout: Layout) -> dict[str, float]:
    """Decoding of a layout, by a pinhole, by a lens and equalised, beside the lookup and a copy; its figures."""
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
        each.equalised(Equalisation(layout_identity=each.views.layout_identity, gain=gain)) for each in decoders
    )

    def bare() -> None:
        for where, fraction in decoder.tables:
            cv2.remap(frame, where, fraction, cv2.INTER_LINEAR)

    print(
        f"{views.rows}x{views.cols} views of {views.width_px}x{views.height_px} px from {camera.width_px}x"
        f"{camera.height_px}, {cv2.getNumThreads()} threads; table built once in {built_ms[0]:.0f} ms, of a lens in "
        f"{built_ms[1]:.0f} ms"
    )
    found = median_ms(
        {
            "Decoder.decode": lambda: decoder.decode(frame),
            "the same, equalised": lambda: equal.decode(frame),
            "of a lens": lambda: lens.decode(frame),
            "of a lens, equalised": lambda: equal_lens.decode(frame),
            "bare cv2.remap": bare,
            "copy of the result": samples.copy,
        }
    )
    for name in list(found)[:4]:
        ratio = found[name] / found["bare cv2.remap"]
        print(f"{name:26} {ratio:.3f} x the bare lookup (at most {MOST_TIMES_THE_LOOKUP})")
    print(f"{1e3 / found['Decoder.decode']:.0f} frames/s; a camera gives 30")
    bare_ms = found["bare cv2.remap"]
    return {
        "decode_hz": 1e3 / found["Decoder.decode"],
        "times_remap": found["Decoder.decode"] / bare_ms,
        "equalised_times_remap": found["the same, equalised"] / bare_ms,
        "lens_times_remap": found["of a lens"] / bare_ms,
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
    found = median_ms(
        {f"{count} views of {size[0]}x{size[1]}": job(each) for size, each in zip(sizes, decoders, strict=True)}, 50
    )
    for (width, height), ms in zip(sizes, found.values(), strict=True):
        print(f"{width}x{height}: {1e6 * ms / (count * width * height):.1f} ns a pixel, {1e3 / ms:.0f} frames/s")
    print(f"wanted of nine views of 400x240: {LEAST_HZ:.0f} frames/s")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("layout", nargs="?", type=Path, default=DEFAULT_LAYOUT)
    add_json_option(parser)
    options = parser.parse_args()
    chosen = Layout.load(options.layout)
    write_record(options.json, "decode", whole_layout(chosen))
    by_pixels(chosen)
