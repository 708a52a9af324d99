"""Local media files: FFmpeg reads the bytes of the named file, and cannot open any other.

FFmpeg detects the format of a file by its content, and several formats are lists of other files: playlists, `ffconcat`,
DASH, SDP. A name can be a protocol, too (`concat:other.mkv`).
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from io import FileIO
from pathlib import Path
from typing import Any

from mirrorcam.core.disk.files import stored_bytes
from mirrorcam.core.errors import InputError

_CONTAINERS = "mov matroska avi mpegts mpeg flv live_flv asf ogg nut mxf gxf dv rm wtv dhav mpjpeg smjpeg cine ser"
_ELEMENTARY = "h264 hevc vvc m4v mpegvideo h261 h263 vc1 av1 obu ivf dirac dnxhd mjpeg mjpeg_2000 yuv4mpegpipe gif apng"
_PICTURES = "bmp_pipe jpeg_pipe png_pipe tiff_pipe webp_pipe ppm_pipe pgm_pipe pbm_pipe pam_pipe dpx_pipe"
_SOUND = "wav mp3 aac flac"
"""Opened to report that they contain no pictures."""
FORMATS = ",".join(f"{_CONTAINERS} {_ELEMENTARY} {_PICTURES} {_SOUND}".split())
"""FFmpeg's names of the accepted formats: those that contain all of their data and refer to no other file."""
NO_PROTOCOL = "none"
"""Protocol whitelist without any valid protocol."""


class MediaFile(FileIO):
    """An open file for FFmpeg, which expects an error code rather than an exception for an invalid seek."""

    def seek(self, offset: int, whence: int = 0) -> int:
        """Return the new position, or a negative error code for an invalid one, as damaged files state."""
        try:
            return super().seek(offset, whence)
        except OSError as error:
            return -(error.errno or 1)


@contextmanager
def opened(path: Path) -> Iterator[Any]:
    """Open a local video of one of `FORMATS` as an FFmpeg container; no other file is opened.

    Raises InputError for a path that is not a regular file, or that FFmpeg cannot read.
    """
    import av

    with suppress(OSError):  # a name that is too long
        if path.is_dir():
            raise InputError(f"{path}: is a folder, expected a video or pictures by their names (FOLDER/*.png)")
    stored_bytes(path)
    try:
        file = MediaFile(path)
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None
    options = {"format_whitelist": FORMATS, "protocol_whitelist": NO_PROTOCOL}
    with file:
        try:
            # Metadata is not used, and may be invalid text.
            container = av.open(file, options=options, metadata_errors="replace")
        except av.error.ArgumentError:
            raise InputError(
                f"{path}: not a video in a supported format, expected one such as MP4, MOV, MKV, AVI or MPEG; "
                "playlists and other lists of files are not read"
            ) from None
        except (av.FFmpegError, OSError) as error:
            raise InputError(
                f"{path}: not a video that can be opened, or cut off before its index: {error.strerror}"
            ) from None
        with container:
            yield container
