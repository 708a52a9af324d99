"""Writing videos with FFmpeg: the address of a file, and x264, which is under the GPL and which a PyAV may lack."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from mirrorcam.core.values import InputError

X264: Final = "libx264"


def require_x264() -> None:
    """Raise InputError where the FFmpeg of PyAV is built without x264."""
    import av

    if X264 not in av.codecs_available:
        raise InputError(
            "this PyAV (av) is built without x264, expected its wheel from PyPI to write H.264; AVI, GIF and pictures "
            "need none"
        )


def file_address(path: Path) -> str:
    """The address by which FFmpeg writes a file, whatever its name looks like."""
    return f"file:{path}"
