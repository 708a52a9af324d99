"""Text and YAML files of other tools as plain values."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from mirrorcam.core.disk.files import read_bytes
from mirrorcam.core.disk.yaml_text import yaml_documents
from mirrorcam.core.errors import InputError
from mirrorcam.core.messages import shortened

MAX_BYTES = 5_000_000
"""Limit for a calibration as text; a hundred cameras take 0.1 MB."""


def read_yaml(path: Path) -> Any:
    """Content of a YAML file; raises InputError for an invalid file.

    `ros2 topic echo` prints several documents. They may differ only in `header`; the first is returned.
    """
    text = read_text(path)
    try:
        documents = [document for document in yaml_documents(text) if document is not None]
    except InputError as error:
        raise InputError(shortened(f"{path}: {error}", 250)) from None
    if any(_without_header(document) != _without_header(documents[0]) for document in documents[1:]):
        raise InputError(f"{path}: {len(documents)} different documents, expected one, or identical messages")
    return documents[0] if documents else None


def _without_header(value: Any) -> Any:
    return {key: item for key, item in value.items() if key != "header"} if isinstance(value, dict) else value


def read_text(path: Path) -> str:
    """Text of a UTF-8 file; raises InputError for anything else."""
    try:
        return read_bytes(path, MAX_BYTES).decode("utf-8-sig")
    except UnicodeDecodeError:
        raise InputError(f"{path}: not UTF-8, expected a calibration as text") from None


def table(value: Any, where: str) -> dict[str, Any]:
    """Check that a value is a mapping with string keys; raises InputError for anything else."""
    if not isinstance(value, dict) or not all(isinstance(key, str) for key in value):
        raise InputError(f"{where}: expected names with values")
    return value


def entry(values: dict[str, Any], key: str, where: str) -> Any:
    """A required value; raises InputError if it is missing."""
    if values.get(key) is None:
        raise InputError(f"{where}: {key} is missing")
    return values[key]
