"""Arguments of the public functions: paths of any kind, and one-line TypeErrors for other types."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated, Any, TypeAlias, cast

from pydantic import BeforeValidator

from mirrorcam.core.bounds import Bounds
from mirrorcam.core.errors import InputError

AnyPath: TypeAlias = str | os.PathLike[str]
"""A path argument: a str, or any object with `__fspath__`."""


def path_of(name: str, value: AnyPath) -> Path:
    """Convert an argument to a path; raises TypeError unless it is a str or an `os.PathLike[str]`."""
    if isinstance(value, str):
        return Path(value)
    text = os.fspath(value) if isinstance(value, os.PathLike) else None
    if not isinstance(text, str):
        raise TypeError(f"{name}: {type(value).__name__}, expected str or os.PathLike[str]")
    return Path(text)


def _to_path(value: Any) -> Any:
    return Path(os.fspath(value)) if isinstance(value, os.PathLike) and not isinstance(value, Path) else value


PathField = Annotated[Path, BeforeValidator(_to_path)]
"""Field of a value that accepts any kind of path."""


def check_count(name: str, value: object, bounds: Bounds) -> None:
    """Raise TypeError for an argument that is not an integer, InputError for one out of bounds."""
    check_type(name, value, int)
    if not bounds.min <= cast(int, value) <= bounds.max:
        raise InputError(f"{name}: {value}, expected {bounds}")


def check_callable(name: str, value: object) -> None:
    """Raise TypeError for an argument that cannot be called."""
    if not callable(value):
        raise TypeError(f"{name}: {type(value).__name__}, expected a function")


def check_type(name: str, value: object, *expected: type) -> None:
    """Raise TypeError unless an argument has one of the types."""
    if not isinstance(value, expected):
        names = " or ".join(kind.__name__ for kind in expected)
        raise TypeError(f"{name}: {type(value).__name__}, expected {names}")
