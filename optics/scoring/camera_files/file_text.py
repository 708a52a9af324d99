"""YAML of other tools as plain values: by a safe loader, of limited size, with the matrices of OpenCV's FileStorage."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml

from mirrorcam.optics.base.files import read_bytes
from mirrorcam.optics.base.messages import shortened
from mirrorcam.optics.base.values import InputError

LARGEST_BYTES = 5_000_000
"""Of a calibration as text; that of a hundred cameras takes 0.1 MB."""
MOST_VALUES = 1_000_000
YAML_SUFFIXES = (".yaml", ".yml")


class _Loader(yaml.SafeLoader):  # type: ignore[misc]
    """PyYAML's safe loader, for which OpenCV's matrix is a mapping."""


for _kind in ("matrix", "nd-matrix"):
    _Loader.add_constructor(
        f"tag:yaml.org,2002:opencv-{_kind}", lambda loader, node: loader.construct_mapping(node, deep=True)
    )


def read_yaml(path: Path) -> Any:
    """The value of a YAML file, or InputError in one line."""
    text = read_text(path)
    if text.startswith("%YAML:1.0"):  # OpenCV's head, which is none of YAML
        text = text.partition("\n")[2]
    try:
        value = yaml.load(text, Loader=_Loader)
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        reason = " ".join(str(error).split()) or "nested too deep"
        raise InputError(shortened(f"{path}: not valid YAML: {reason}", 250)) from None
    _refuse_many(value, path)
    return value


def _refuse_many(value: Any, path: Path) -> None:
    """Raise InputError for more values than such files hold, which aliases of aliases can stand for in a few lines."""
    left, count = [value], 0
    while left:
        each = left.pop()
        count += 1
        if count > MOST_VALUES:
            raise InputError(f"{path}: holds more than {MOST_VALUES} values, expected a calibration")
        left += list(each.values()) if isinstance(each, dict) else each if isinstance(each, list) else []


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
