"""Arguments of the public functions: paths of any kind, and one line with the name for what is wrong with others."""

from __future__ import annotations

import os
from numbers import Integral, Real
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
    """Raise TypeError for an argument that is not an integer, of Python or NumPy, InputError for one out of bounds."""
    _check(name, value, (Integral,), "int")
    if not bounds.min <= cast(int, value) <= bounds.max:
        raise InputError(f"{name}: {value}, expected {bounds}")


def check_number(name: str, value: object) -> None:
    """Raise TypeError for an argument that is not a real number, of Python or NumPy."""
    _check(name, value, (Real,), "int or float")


def check_choice(name: str, value: object, *expected: str) -> None:
    """Raise TypeError for an argument that is not a str, InputError for one that is not expected."""
    check_type(name, value, str)
    if value not in expected:
        raise InputError(f"{name}: {value!r}, expected {' or '.join(expected)}")


def check_callable(name: str, value: object) -> None:
    """Raise TypeError for an argument that cannot be called."""
    if not callable(value):
        raise TypeError(f"{name}: {type(value).__name__}, expected a function")


def check_type(name: str, value: object, *expected: type) -> None:
    """Raise TypeError unless an argument has one of the types; a bool is no int."""
    _check(name, value, expected, " or ".join(kind.__name__ for kind in expected))


def _check(name: str, value: object, kinds: tuple[type, ...], expected: str) -> None:
    if not isinstance(value, kinds) or (isinstance(value, bool) and bool not in kinds):
        raise TypeError(f"{name}: {type(value).__name__}, expected {expected}")
