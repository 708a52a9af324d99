"""Text and YAML files of other tools, of limited size, and what is expected in them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from mirrorcam.core.disk.files import read_bytes
from mirrorcam.core.messages import shortened
from mirrorcam.core.values import InputError
from mirrorcam.optics.camera_files.read.yaml_documents import yaml_documents

LARGEST_BYTES = 5_000_000
"""Of a calibration as text; that of a hundred cameras takes 0.1 MB."""
YAML_SUFFIXES = (".yaml", ".yml")


def read_yaml(path: Path) -> Any:
    """The value of a YAML file, or InputError in one line.

    Of several documents, as `ros2 topic echo` prints messages, it is the first: the others may differ in their
    `header` alone.
    """
    text = read_text(path)
    try:
        documents = [each for each in yaml_documents(text) if each is not None]
    except InputError as error:
        raise InputError(shortened(f"{path}: {error}", 250)) from None
    if any(_without_header(each) != _without_header(documents[0]) for each in documents[1:]):
        raise InputError(f"{path}: {len(documents)} documents that differ, expected one, or messages that are alike")
    return documents[0] if documents else None


def _without_header(value: Any) -> Any:
    return {key: each for key, each in value.items() if key != "header"} if isinstance(value, dict) else value


def read_text(path: Path) -> str:
    """The text of a file in UTF-8, or InputError in one line."""
    try:
        return read_bytes(path, LARGEST_BYTES).decode("utf-8-sig")
    except UnicodeDecodeError:
        raise InputError(f"{path}: not text in UTF-8, expected a calibration as text") from None


def table(value: Any, where: str) -> dict[str, Any]:
    """A mapping of names to values; raises InputError for anything else."""
    if not isinstance(value, dict) or not all(isinstance(key, str) for key in value):
        raise InputError(f"{where}: expected names with values")
    return value


def entry(values: dict[str, Any], key: str, where: str) -> Any:
    """A value that must be there; raises InputError where it is not."""
    if values.get(key) is None:
        raise InputError(f"{where}: {key} is missing")
    return values[key]
