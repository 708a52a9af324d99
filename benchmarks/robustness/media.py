"""Damaged pictures and videos: refused in one line, or read as frames of the stated size.

Tests compare the frames of a damaged file with the original ones (tests/core/images/test_pictures.py,
tests/core/video/test_video.py); here, a decoder must not crash, hang, or take unlimited memory.
"""

from __future__ import annotations

import tempfile
from fractions import Fraction
from functools import cache
from io import BytesIO
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from benchmarks.robustness.damage import damaged_bytes
from benchmarks.robustness.guard import Category, message_fault
from mirrorcam.core.errors import InputError
from mirrorcam.core.images.pictures import picture_size, read_image
from mirrorcam.core.video.frames import Frame
from mirrorcam.core.video.video import Video

COUNT, WIDTH, HEIGHT, RATE = 30, 320, 240, 25
MAX_FRAMES = 50 * COUNT
JPEGS: dict[str, tuple[int, ...]] = {
    "baseline": (),
    "progressive": (cv2.IMWRITE_JPEG_PROGRESSIVE, 1),
    "restarts": (cv2.IMWRITE_JPEG_RST_INTERVAL, 40),
}
VIDEOS = {
    "a.mp4": ("libx264", {"movflags": "faststart"}),
    "b.mp4": ("libx264", {}),
    "a.mkv": ("libx264", {}),
    "a.ts": ("libx264", {}),
    "a.avi": ("mjpeg", {}),
    "b.mkv": ("mjpeg", {}),
}


@cache
def scene_pictures() -> tuple[NDArray[np.uint8], ...]:
    """Return pictures (h, w, 3) of a drifting scene with noise."""
    random = np.random.default_rng(0)
    field = cv2.resize(random.uniform(30, 220, (40, 60, 3)), (2 * WIDTH, 2 * HEIGHT), interpolation=cv2.INTER_CUBIC)
    views = (field[3 * n : 3 * n + HEIGHT, 5 * n : 5 * n + WIDTH] for n in range(COUNT))
    return tuple(np.clip(view + random.normal(0, 2, view.shape), 0, 255).astype(np.uint8) for view in views)


@cache
def pictures() -> dict[str, bytes]:
    """Return valid files of one picture, by name."""
    picture, stream = scene_pictures()[0], BytesIO()
    files = {f"{kind}.jpg": cv2.imencode(".jpg", picture, [*options])[1].tobytes() for kind, options in JPEGS.items()}
    alpha = np.concatenate([picture, np.full((HEIGHT, WIDTH, 1), 200, np.uint8)], axis=-1)
    images: dict[str, NDArray[Any]] = {"grey": picture[..., 1], "16 bits": picture.astype(np.uint16) * 257}
    for kind, image in (images | {"colour": picture, "opacity": alpha}).items():
        files[f"{kind}.png"] = cv2.imencode(".png", image)[1].tobytes()
    Image.fromarray(picture).quantize(64).save(stream, "PNG")
    return files | {"palette.png": stream.getvalue()}


def write_video(path: Path, codec: str, options: dict[str, str]) -> None:
    """Write the pictures as a video."""
    with av.open(str(path), "w", options=options) as container:
        settings = {"preset": "veryfast", "crf": "18", "g": "10", "bf": "2"} if codec == "libx264" else {"qmin": "2"}
        stream: Any = container.add_stream(codec, rate=RATE, options=settings)
        stream.width, stream.height = WIDTH, HEIGHT
        stream.pix_fmt = "yuv420p" if codec == "libx264" else "yuvj420p"
        for number, picture in enumerate(scene_pictures()):
            frame = av.VideoFrame.from_ndarray(picture, format="rgb24")
            frame.pts, frame.time_base = number, Fraction(1, RATE)
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))


@cache
def video(name: str) -> bytes:
    """Return a valid video, by its name in `VIDEOS`."""
    with tempfile.TemporaryDirectory() as folder:
        write_video(Path(folder) / name, *VIDEOS[name])
        return (Path(folder) / name).read_bytes()


def damaged_picture(seed: int, folder: Path) -> str:
    """Read a damaged picture."""
    random = np.random.default_rng(seed)
    name = str(random.choice(sorted(pictures())))
    path = folder / name
    path.write_bytes(damaged_bytes(pictures()[name], random))
    try:
        size = picture_size(path)
        picture = read_image(path, grey=bool(seed % 2))
    except InputError as error:
        return _refused(path, error)
    return "" if picture.shape[1::-1] == size else f"{name}: {picture.shape=}, {size=}"


def damaged_video(seed: int, folder: Path) -> str:
    """Read a damaged video to its end."""
    random = np.random.default_rng(seed)
    name = str(random.choice(sorted(VIDEOS)))
    path = folder / name
    raw = bytearray(damaged_bytes(video(name), random))
    if raw and random.random() < 0.3:  # sizes, counts and times are at the beginning
        offset = int(random.integers(min(len(raw), 1200)))
        raw[offset : offset + 4] = b"\xff" * 4
    path.write_bytes(raw)
    try:
        for number, item in enumerate(Video(path).frames()):
            if number >= MAX_FRAMES:
                return f"{name}: gives more than {number} frames"
            if isinstance(item, Frame) and item.pixels.shape != (HEIGHT, WIDTH, 3):
                return f"{name}: frame {item.number} has shape {item.pixels.shape}"
    except InputError as error:
        return _refused(path, error)
    return ""


def _refused(path: Path, error: InputError) -> str:
    wrong = message_fault(str(error).replace(str(path.parent), ""))
    return wrong or ("" if str(error).startswith(str(path)) else f"names no file: {str(error)[:80]}")


CATEGORIES = (Category("pictures", 1_000, damaged_picture), Category("videos", 1_000, damaged_video))
