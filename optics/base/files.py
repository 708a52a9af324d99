"""Reading and writing users' files: files are written atomically, and bad ones are refused in one line."""

from __future__ import annotations

import json
import os
import re
import tempfile
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ValidationError

from mirrorcam.optics.base.values import InputError, Metric

Model = TypeVar("Model", bound=BaseModel)
JPEG_ENDINGS = (".jpg", ".jpeg")
PICTURE_ENDINGS = (".png", *JPEG_ENDINGS, ".webp")
"""What the names of pictures end in, in small letters, wherever pictures are read."""
PNG_END = b"IEND\xaeB`\x82"
# Starts a segment with a length; padding, escaped bytes and restarts in the data of a scan have none.
JPEG_MARKER = re.compile(rb"\xff[^\x00\xd0-\xd7\xff]")


@contextmanager
def atomic(path: Path) -> Iterator[Path]:
    """A temporary path beside `path`, with its suffix, renamed to it when the block ends well and removed otherwise."""
    if path.is_dir():
        raise InputError(f"{path}: is a folder, expected a file to write")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.stem}-", suffix=path.suffix)
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror}") from None
    os.close(handle)
    temporary = Path(name)
    try:
        yield temporary
        umask = os.umask(0)
        os.umask(umask)
        temporary.chmod(0o666 & ~umask)
        temporary.replace(path)
    except OSError as error:
        # An error of a full disk names no file; one that names another file is not about this one.
        if error.filename not in (None, name):
            raise
        raise InputError(f"{path}: cannot be written: {error.strerror or error}") from None
    finally:
        temporary.unlink(missing_ok=True)


def write_text(path: Path, text: str) -> None:
    """Write a UTF-8 text file atomically."""
    with atomic(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def write_json(path: Path, value: object) -> None:
    """Write JSON atomically; NaN is refused rather than written."""
    write_text(path, json.dumps(value, indent=1, allow_nan=False) + "\n")


def write_metrics(path: Path, metrics: dict[str, Metric]) -> None:
    """Write `metrics.json`: flat name -> value, unit and, where there is one, limit."""
    write_json(path, {name: metric.model_dump(exclude_none=True) for name, metric in metrics.items()})


def read_bytes(path: Path) -> bytes:
    """The bytes of a file, or InputError in one line."""
    try:
        return path.read_bytes()
    except FileNotFoundError:
        raise InputError(f"{path}: no such file") from None
    except IsADirectoryError:
        raise InputError(f"{path}: is a folder, expected a file") from None
    except OSError as error:
        raise InputError(f"{path}: {error.strerror}") from None


def one_line(error: ValidationError) -> str:
    """One line that says what is wrong and where: the first of pydantic's findings and the number of the others."""
    details = error.errors(include_url=False)
    where = ".".join(str(part) for part in details[0]["loc"])
    message = details[0]["msg"].removeprefix("Value error, ")
    more = f" (and {len(details) - 1} more)" if len(details) > 1 else ""
    return f"{where}: {message}{more}" if where else f"{message}{more}"


def read_model(model: type[Model], path: Path) -> Model:
    """Read a JSON or (by its suffix) TOML file into a pydantic model, or raise InputError in one line."""
    raw = read_bytes(path)
    try:
        text = raw.decode("utf-8")
        data = tomllib.loads(text) if path.suffix == ".toml" else json.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: not valid {'TOML' if path.suffix == '.toml' else 'JSON'}: {error}") from None
    try:
        return model.model_validate(data)
    except ValidationError as error:
        raise InputError(f"{path}: {one_line(error)}") from None


def _jpeg_ends(raw: bytes) -> bool:
    """Return whether a JPEG is complete: it reaches its end marker, not a thumbnail's; appended data is ignored."""
    at = 2
    while found := JPEG_MARKER.search(raw, at):
        if found.group() == b"\xff\xd9":
            return True
        at = found.end() + int.from_bytes(raw[found.end() : found.end() + 2])
    return False


def is_picture(path: Path) -> bool:
    """Return whether a file is named like a picture; capitals count as small letters."""
    return path.suffix.lower() in PICTURE_ENDINGS


def pictures_in(paths: Sequence[Path]) -> list[Path]:
    """The pictures among files and folders, in order: a folder stands for all pictures in it, by name."""
    found: list[Path] = []
    for path in paths:
        inside = sorted(filter(is_picture, path.iterdir())) if path.is_dir() else [path]
        if not inside:
            raise InputError(f"{path}: holds no picture, expected {', '.join(PICTURE_ENDINGS)} files")
        found += inside
    return found


def read_image(path: Path, *, grey: bool = False) -> NDArray[np.uint8]:
    """Read a picture of 8 bits a channel, PNG, JPEG or WebP.

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
        If the file is missing, truncated or no picture.
    """
    raw = read_bytes(path)
    if (raw.startswith(b"\x89PNG") and PNG_END not in raw) or (raw.startswith(b"\xff\xd8") and not _jpeg_ends(raw)):
        raise InputError(f"{path}: image is truncated")
    flags = (cv2.IMREAD_GRAYSCALE if grey else cv2.IMREAD_COLOR_RGB) | cv2.IMREAD_IGNORE_ORIENTATION
    image = cv2.imdecode(np.frombuffer(raw, np.uint8), flags) if raw else None
    if image is None:
        raise InputError(f"{path}: not an image that can be decoded, expected PNG, JPEG or WebP")
    return np.asarray(image, dtype=np.uint8)


def encoded_image(image: NDArray[np.uint8], suffix: str, jpeg_quality: int = 95) -> bytes:
    """The bytes of the file of an RGB (h, w, 3) or grey (h, w) 8-bit image, in the format of the suffix."""
    options = [cv2.IMWRITE_JPEG_QUALITY, jpeg_quality] if suffix in JPEG_ENDINGS else []
    encoded, buffer = cv2.imencode(suffix, image if image.ndim == 2 else image[..., ::-1], options)
    if not encoded:
        raise ValueError(f"no encoder for {image.shape=}")
    return buffer.tobytes()


def write_bytes(path: Path, content: bytes) -> None:
    """Write a file atomically."""
    with atomic(path) as temporary:
        temporary.write_bytes(content)


def write_npz(path: Path, arrays: Mapping[str, NDArray[Any]]) -> None:
    """Write arrays by name to a compressed .npz file, atomically; the same arrays give the same bytes."""
    # By an open file: to a path that does not end in .npz, NumPy would append it and leave this one empty.
    with atomic(path) as temporary, temporary.open("wb") as file:
        np.savez_compressed(file, **dict[str, Any](arrays))


def write_image(path: Path, image: NDArray[np.uint8]) -> None:
    """Write an RGB (h, w, 3) or grey (h, w) 8-bit image atomically, in the format of the suffix."""
    if not cv2.haveImageWriter(path.name):
        raise InputError(f"{path}: no image format for this suffix, expected .png or .jpg")
    write_bytes(path, encoded_image(image, path.suffix))
