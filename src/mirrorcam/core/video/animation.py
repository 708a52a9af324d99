"""Loops of pictures as GIF files, or as MP4 files by FFmpeg's x264."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.disk.files import atomic
from mirrorcam.core.errors import InputError

# B-frames would make the output differ from run to run.
_X264 = {"crf": "18", "preset": "medium", "tune": "zerolatency", "flags": "+bitexact"}
PALETTE_PICTURES = 8
X264: Final = "libx264"


def write_loop(path: Path, pictures: Sequence[NDArray[np.uint8]], pictures_hz: float) -> None:
    """Write RGB pictures (h, w, 3) atomically as a repeating .gif or an .mp4 (H.264), with reproducible bytes.

    A GIF has 256 colours and durations in 1/100 s; an MP4 of odd size loses its last row or column.
    """
    with atomic(path) as temporary:
        if path.suffix.lower() == ".gif":
            _write_gif(temporary, pictures, pictures_hz)
        elif path.suffix.lower() == ".mp4":
            _write_mp4(temporary, pictures, pictures_hz)
        else:
            raise InputError(f"{path}: not the suffix of an animation format, expected .gif or .mp4")


def _write_gif(path: Path, pictures: Sequence[NDArray[np.uint8]], pictures_hz: float) -> None:
    # OpenCV's GIF encoder uses one fixed palette for all files.
    from PIL import Image

    # One palette for the complete loop, so that static parts do not flicker.
    stride = max(1, len(pictures) // PALETTE_PICTURES)
    palette = Image.fromarray(np.concatenate(pictures[::stride])).quantize(256)
    frames = [Image.fromarray(picture).quantize(palette=palette, dither=Image.Dither.NONE) for picture in pictures]
    frames[0].save(
        path, save_all=True, append_images=frames[1:], duration=round(1000.0 / pictures_hz), loop=0, optimize=False
    )


def _write_mp4(path: Path, pictures: Sequence[NDArray[np.uint8]], pictures_hz: float) -> None:
    import av

    require_x264()
    height, width = (side // 2 * 2 for side in pictures[0].shape[:2])
    with av.open(file_address(path), "w") as container:
        stream = container.add_stream(X264, rate=Fraction(pictures_hz).limit_denominator(1000), options=_X264)
        stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p"
        for picture in pictures:
            frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(picture[:height, :width]), format="rgb24")
            container.mux(stream.encode(frame))
        container.mux(stream.encode())


def require_x264() -> None:
    """Raise InputError if PyAV's FFmpeg was built without x264."""
    import av

    if X264 not in av.codecs_available:
        raise InputError(
            "this PyAV (av) is built without x264, expected its wheel from PyPI to write H.264; AVI, GIF and pictures "
            "do not need it"
        )


def file_address(path: Path) -> str:
    """Return the address by which FFmpeg writes a file, whatever its name."""
    return f"file:{path}"
