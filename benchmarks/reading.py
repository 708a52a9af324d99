"""Time to read a good picture, beside OpenCV's decoder on the same bytes in the same run.

`python -m benchmarks.reading` prints the least processor time of several runs, in ms; exit code 1 where ours takes more
than 5 % longer.
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import cv2
import numpy as np

from mirrorcam.optics.base.pictures import read_image, write_image

SIZE = (1920, 1080)
RUNS = 20
MOST = 1.05


def least_ms(call: Callable[[], object]) -> float:
    """The least processor time of several calls."""
    times = []
    for _ in range(RUNS):
        begun = time.thread_time()
        call()
        times.append(time.thread_time() - begun)
    return min(times) * 1e3


def opencv(path: Path) -> object:
    """The picture as OpenCV reads it, without a check."""
    flags = cv2.IMREAD_COLOR_RGB | cv2.IMREAD_IGNORE_ORIENTATION
    return cv2.imdecode(np.frombuffer(path.read_bytes(), np.uint8), flags)


def main() -> int:
    cv2.setNumThreads(1)
    random = np.random.default_rng(0)
    smooth = cv2.resize(random.uniform(0, 255, (60, 90, 3)), SIZE)
    picture = np.clip(smooth + random.normal(0, 4, smooth.shape), 0, 255).astype(np.uint8)
    slower = False
    print(f"{'1920 x 1080':<12}{'ours ms':>10}{'OpenCV ms':>12}{'ratio':>8}")
    with tempfile.TemporaryDirectory() as folder:
        for name in ("a.png", "a.jpg"):
            path = Path(folder) / name
            write_image(path, picture)
            ours, theirs = least_ms(partial(read_image, path)), least_ms(partial(opencv, path))
            print(f"{path.suffix:<12}{ours:>10.1f}{theirs:>12.1f}{ours / theirs:>8.2f}")
            slower |= ours > MOST * theirs
    return 1 if slower else 0


if __name__ == "__main__":
    sys.exit(main())
