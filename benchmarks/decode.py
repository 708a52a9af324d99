"""Speed of decoding beside a bare `cv2.remap` of the same tables: `python benchmarks/decode.py [LAYOUT]`.

Prints, for one 1920x1080 frame (or what the layout's camera takes) in memory, the milliseconds of `Decoder.decode`, of
the bare lookup, and of copying the result, all in the same run, interleaved; median and best of the rounds.
"""

from __future__ import annotations

import statistics
import sys
import time
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np

from optics.layout import Layout
from optics.light_field.decode import Decoder

DEFAULT_LAYOUT = Path(__file__).parents[1] / "tests" / "data" / "default_layout.json"
ROUNDS = 200


def main(path: Path) -> None:
    layout = Layout.load(path)
    start = time.perf_counter()
    decoder = Decoder(layout)
    built_ms = 1e3 * (time.perf_counter() - start)
    camera, views = layout.camera, decoder.views
    frame = np.random.default_rng(0).integers(0, 255, (camera.height_px, camera.width_px, 3), dtype=np.uint8)
    samples = decoder.decode(frame).samples

    def bare() -> None:
        for where, fraction in decoder.tables:
            cv2.remap(frame, where, fraction, cv2.INTER_LINEAR)

    jobs: dict[str, Callable[[], object]] = {
        "Decoder.decode": lambda: decoder.decode(frame),
        "bare cv2.remap": bare,
        "copy of the result": samples.copy,
    }
    times_ms: dict[str, list[float]] = {name: [] for name in jobs}
    for _ in range(ROUNDS):
        for name, job in jobs.items():
            start = time.perf_counter()
            job()
            times_ms[name].append(1e3 * (time.perf_counter() - start))
    print(
        f"{views.rows}x{views.cols} views of {views.width_px}x{views.height_px} px from {camera.width_px}x"
        f"{camera.height_px}, {cv2.getNumThreads()} threads; table built once in {built_ms:.0f} ms"
    )
    for name, each in times_ms.items():
        print(f"{name:20} median {statistics.median(each):6.2f} ms  best {min(each):6.2f} ms")
    ratio = statistics.median(times_ms["Decoder.decode"]) / statistics.median(times_ms["bare cv2.remap"])
    print(f"decode / bare lookup {ratio:.3f}")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else DEFAULT_LAYOUT)
