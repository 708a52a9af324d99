"""Pictures as files: PNG, JPEG, TIFF and BMP by their content, with 8 bits a channel, complete or refused."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from io import BytesIO
from pathlib import Path
from warnings import catch_warnings

import cv2
import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.arguments import AnyPath, path_of
from mirrorcam.core.bounds import LARGEST_PICTURE_PX
from mirrorcam.core.disk.bags import is_bag
from mirrorcam.core.disk.files import first_bytes, read_bytes, stored_bytes, write_bytes
from mirrorcam.core.errors import InputError
from mirrorcam.core.figures.figure_texts import count_text
from mirrorcam.core.images.picture_data import PictureData, as_grey
from mirrorcam.core.images.png import PNG_BEGIN
from mirrorcam.core.images.sample_bits import ALL, SampleBits, to_8_bits
from mirrorcam.core.images.tiff import TIFF_BEGINS
from mirrorcam.core.messages import shortened

JPEG_ENDINGS = (".jpg", ".jpeg")
WRITTEN_ENDINGS = (".png", *JPEG_ENDINGS)
PICTURE_ENDINGS = (*WRITTEN_ENDINGS, ".tif", ".tiff", ".bmp")
"""Endings of names of pictures, in lower case, wherever pictures are read."""
LARGEST_FILE_BYTES = 4 * LARGEST_PICTURE_PX
"""Bytes of the largest file: more than the pixels of the largest picture without compression."""

_SIDE_ENDINGS = (".toml", ".json", ".yaml", ".yml", ".csv", ".npz", ".html", ".md", ".db", ".ini")
"""Suffixes of files that may lie among pictures: boards, layouts, tables, results, and notes of file managers."""
_MAX_NAMES = 3
_ORIENTATION = 0x0112
_SIXTEEN = 16
_common_bits: dict[tuple[Path, int, int], SampleBits] = {}
"""Common sample bits of a set's 16-bit pictures, by path, time and size of each file."""


def is_picture(path: Path) -> bool:
    """Return whether a file is named like a picture; capitals count as small letters."""
    return path.suffix.lower() in PICTURE_ENDINGS


def pictures_in(paths: Sequence[Path], on_note: Callable[[str], None] = lambda line: None) -> list[Path]:
    """List the pictures of files and folders in order, those of a folder by name; a ROS 2 bag counts as a
    file.

    They count as one set, see `set_common_bit_depth`. `on_note` takes a line about ignored files of a folder, and one
    about pictures of 16 bits. Raises InputError for a folder without pictures.
    """
    listed: list[Path] = []
    for path in paths:
        if not path.is_dir() or is_bag(path):
            listed.append(path)
            continue
        pictures = sorted(filter(is_picture, path.iterdir()))
        ignored = sorted(filter(_is_left_out, path.iterdir()))
        names = ", ".join(file.name for file in ignored[:_MAX_NAMES]) + (", ..." if ignored[_MAX_NAMES:] else "")
        if not pictures:
            instead = f", but {names}" if ignored else ""
            endings = ", ".join(PICTURE_ENDINGS)
            raise InputError(shortened(f"{path}: holds no picture{instead}, expected {endings} files"))
        if ignored:
            total = count_text(len(pictures) + len(ignored), "file")
            on_note(shortened(f"{path}: {len(ignored)} of {total} left out: {names}"))
        listed += pictures
    set_common_bit_depth(listed, on_note)
    return listed


def _is_left_out(path: Path) -> bool:
    """Return whether a user may take an ignored file for a picture of its folder."""
    hidden = path.name.startswith(".")
    return not hidden and not is_picture(path) and path.suffix.lower() not in _SIDE_ENDINGS and path.is_file()


def set_common_bit_depth(paths: Sequence[Path], on_note: Callable[[str], None] = lambda line: None) -> None:
    """Treat the 16-bit pictures among some files as one set with a common number of used bits.

    `read_image` then scales all of them equally; a single picture is scaled by its own samples. `on_note` takes a line
    about them, if there are any.
    """
    set_bits: dict[tuple[Path, int, int], SampleBits] = {}
    for path in filter(is_picture, paths):
        with suppress(InputError):  # reported when the picture is read
            if (bits := _common_bits.get(_key(path))) is not None:
                set_bits[_key(path)] = bits
                continue
            begin = first_bytes(path, 25) if stored_bytes(path) else b""
            if begin.startswith(TIFF_BEGINS) or (begin.startswith(PNG_BEGIN) and begin[24:] == bytes((_SIXTEEN,))):
                data = PictureData.of(path, read_bytes(path, LARGEST_FILE_BYTES))
                if data.depth == _SIXTEEN:
                    set_bits[_key(path)] = SampleBits.of(data.decoded(), data.significant_bits)
    if set_bits:
        common = SampleBits.combined(set_bits.values())
        _common_bits.update(dict.fromkeys(set_bits, common))
        on_note(_line_on_bits(len(set_bits), common))


def line_on_bits(folder: Path) -> str | None:
    """A line about the pictures of 16 bits of a folder, or a file, that were read as a set; None without any."""
    root = folder.absolute()
    matching = [bits for (path, *_), bits in _common_bits.items() if path.is_relative_to(root)]
    return _line_on_bits(len(matching), matching[0]) if matching else None


def _line_on_bits(count: int, bits: SampleBits) -> str:
    return f"{count_text(count, 'picture')} of {bits}"


def _key(path: Path) -> tuple[Path, int, int]:
    """Return path, time and size of a file; raises InputError for anything else."""
    stored_bytes(path)
    status = path.stat()
    return path.absolute(), status.st_mtime_ns, status.st_size


def read_image(path: AnyPath, *, grey: bool = False) -> NDArray[np.uint8]:
    """Read a picture with 8 bits a channel, PNG, JPEG, TIFF or BMP by its content.

    Of 16-bit samples, the highest 8 of the used bits are returned, those that the picture's own samples use: to scale
    all pictures of a set equally, call `mirrorcam.core.images.pictures.set_common_bit_depth` first.

    Parameters
    ----------
    path
        File to read.
    grey
        Convert to grey.

    Returns
    -------
    ndarray of uint8
        (h, w, 3) in RGB, or (h, w) in grey, with rows as on the sensor: a rotation in the EXIF data is not applied.

    Raises
    ------
    InputError
        If the file is missing or larger than any camera's picture.
    DamagedPicture
        If it is not a picture, truncated or damaged.
    """
    path = path_of("path", path)
    data = _data(path)
    image = data.decoded(grey=grey)
    if image.dtype != np.uint8:
        image = to_8_bits(image, _bits(path, data, image))
    if grey:
        return as_grey(image)
    return np.repeat(image[..., None], 3, axis=2) if image.ndim == 2 else np.ascontiguousarray(image)


def read_opacity(path: Path) -> NDArray[np.uint8] | None:
    """Read the 8-bit opacity (h, w) of a picture; None without one. Raises as `read_image`."""
    data = _data(path)
    image = data.decoded(opacity=True)
    if image.shape[2:] != (4,):
        return None
    opacity = image[..., 3]
    if opacity.dtype != np.uint8:
        bits = _bits(path, data, image[..., :3])
        opacity = to_8_bits(opacity, bits if int(opacity.max()) < 1 << bits else ALL)
    return np.ascontiguousarray(opacity)


def _bits(path: Path, data: PictureData, image: NDArray[np.uint16]) -> int:
    """Return the number of used bits of a picture, common to its set."""
    common = _common_bits.get(_key(path))
    return (SampleBits.of(image, data.significant_bits) if common is None else common).used


def _data(path: Path) -> PictureData:
    return PictureData.of(path, read_bytes(path, LARGEST_FILE_BYTES))


def picture_size(path: Path) -> tuple[int, int]:
    """Return width and height of a picture in px from its header; raises as `read_image`, but ignores later damage."""
    return _data(path).size


def orientation(path: Path) -> int:
    """Return the EXIF orientation of a picture, 1 to 8; 1 is as on the sensor, also assumed if the file states none."""
    from PIL import Image, UnidentifiedImageError

    try:
        with catch_warnings(action="ignore"), Image.open(BytesIO(read_bytes(path, LARGEST_FILE_BYTES))) as image:
            value = image.getexif().get(_ORIENTATION, 1)
    except (UnidentifiedImageError, OSError, ValueError, SyntaxError):
        return 1
    return value if isinstance(value, int) and 1 <= value <= 8 else 1


def check_size(path: Path, size: tuple[int, int], expected: tuple[int, int], owner: str) -> None:
    """Raise InputError for a picture or video whose width and height, px, differ from those of `owner`.

    The message names a rotation in the EXIF data, which other programs apply.
    """
    if size != expected:
        rotation = " as stored (its EXIF data rotates it)" if is_picture(path) and orientation(path) > 1 else ""
        raise InputError(f"{path}: {size[0]}x{size[1]} px{rotation}, expected {expected[0]}x{expected[1]} of {owner}")


def encoded_image(image: NDArray[np.uint8], suffix: str, jpeg_quality: int = 95) -> bytes:
    """Encode an RGB (h, w, 3) or grey (h, w) 8-bit image in the format of the suffix."""
    options = [cv2.IMWRITE_JPEG_QUALITY, jpeg_quality] if suffix in JPEG_ENDINGS else []
    encoded, buffer = cv2.imencode(suffix, image if image.ndim == 2 else image[..., ::-1], options)
    if not encoded:
        raise ValueError(f"no encoder for {image.shape=}")
    return buffer.tobytes()


def write_image(path: Path, image: NDArray[np.uint8]) -> None:
    """Write an RGB (h, w, 3) or grey (h, w) 8-bit image atomically, in the format of the suffix."""
    if path.suffix.lower() not in WRITTEN_ENDINGS:
        raise InputError(f"{path}: not the suffix of an image format, expected .png or .jpg")
    write_bytes(path, encoded_image(image, path.suffix.lower()))
