"""Arguments of public functions: paths of any kind, and TypeErrors that name the argument."""

from __future__ import annotations

from pathlib import Path, PurePosixPath

import pytest

from mirrorcam.core.arguments import check_count, check_type, path_of
from mirrorcam.core.bounds import WORKERS
from mirrorcam.core.errors import InputError


class OwnPath:
    """A path of a class of somebody else's."""

    def __init__(self, path: str | bytes) -> None:
        self._path = path

    def __fspath__(self) -> str | bytes:
        return self._path


@pytest.mark.parametrize("given", ["a/b.json", Path("a/b.json"), PurePosixPath("a/b.json"), OwnPath("a/b.json")])
def test_any_path_becomes_a_path(given: str) -> None:
    assert path_of("path", given) == Path("a/b.json")


@pytest.mark.parametrize("given", [3, None, b"a/b.json", OwnPath(b"a/b.json"), ["a"], object()])
def test_arguments_that_are_not_paths_are_refused_by_name(given: str) -> None:
    with pytest.raises(TypeError, match=rf"^folder: {type(given).__name__}, expected str or os\.PathLike\[str\]$"):
        path_of("folder", given)


def test_other_types_are_refused_by_their_name() -> None:
    check_type("size", 3, int, float)
    with pytest.raises(TypeError, match=r"^size: str, expected int or float$"):
        check_type("size", "3", int, float)


@pytest.mark.parametrize("given", [0, -1, 1025])
def test_counts_out_of_bounds_are_refused_by_their_name(given: int) -> None:
    check_count("workers", 1, WORKERS)
    with pytest.raises(InputError, match=rf"^workers: {given}, expected 1 to 1024$"):
        check_count("workers", given, WORKERS)


def test_a_count_is_an_integer() -> None:
    with pytest.raises(TypeError, match=r"^workers: str, expected int$"):
        check_count("workers", "2", WORKERS)
