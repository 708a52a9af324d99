"""Local media files: FFmpeg gets the bytes of the one file that was named, and can open no other.

FFmpeg finds the format of a file by its content, whatever its name is, and several formats are lists of other files:
playlists, `ffconcat`, DASH, SDP. Names can be protocols, too (`concat:other.mkv`).
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
_PLAIN = "h264 hevc vvc m4v mpegvideo h261 h263 vc1 av1 obu ivf dirac dnxhd mjpeg mjpeg_2000 yuv4mpegpipe gif apng"
_PICTURES = "bmp_pipe jpeg_pipe png_pipe tiff_pipe webp_pipe ppm_pipe pgm_pipe pbm_pipe pam_pipe dpx_pipe"
_SOUND = "wav mp3 aac flac"
"""Opened for the message that there are no pictures."""
FORMATS = ",".join(f"{_CONTAINERS} {_PLAIN} {_PICTURES} {_SOUND}".split())
"""FFmpeg's names of the formats that are read: those that hold all of their data and name no other file."""
NO_PROTOCOL = "none"
"""A list of the protocols that FFmpeg may use, with none among them."""


class MediaFile(FileIO):
    """An open file as FFmpeg reads it, by which a place that no file has is answered rather than raised."""

    def seek(self, offset: int, whence: int = 0) -> int:
        """The new place, or a negative number for one that is not there, as in a damaged file."""
        try:
            return super().seek(offset, whence)
        except OSError as error:
            return -(error.errno or 1)


@contextmanager
def opened(path: Path) -> Iterator[Any]:
    """An FFmpeg container of a local video of one of `FORMATS`; nothing but this file is opened.

    Raises InputError for a path that is no regular file, and for one that FFmpeg cannot read as such a format.
    """
    import av

    with suppress(OSError):  # of a name that is too long
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
            # Names and remarks in the file are of no use here, and need not be text.
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
