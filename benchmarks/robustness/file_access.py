"""Files that Python opens, creates, renames or removes where an attempt has no business.

Python's audit events reveal them, except those of libraries in other languages and of child processes: attempts that
could make these read or write elsewhere put a file there and check it themselves.
"""

from __future__ import annotations

import os
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]
CHANGES = {
    "os.mkdir": ((0, 2),),
    "os.remove": ((0, 1),),
    "os.rmdir": ((0, 1),),
    "os.truncate": ((0, None),),
    "os.chmod": ((0, 2),),
    "os.rename": ((0, 2), (1, 3)),
    "os.link": ((0, 2), (1, 3)),
    "os.symlink": ((1, 2),),
}
"""Audit events of changes: argument index of a path, and that of the descriptor of the folder it is relative to."""
WRITES = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND

_accesses: list[str] | None = None


@contextmanager
def watched_files() -> Iterator[list[str]]:
    """List the files that are read or written elsewhere within the block, such as "reads /home/x/secret"."""
    global _accesses
    _hook()
    accesses: list[str] = []
    _accesses = accesses
    try:
        yield accesses
    finally:
        _accesses = None


@cache
def _hook() -> None:
    sys.addaudithook(_on_event)


def _on_event(event: str, arguments: tuple[Any, ...]) -> None:
    if _accesses is None:
        return
    if event == "open":
        path, _, flags = arguments
        _note(_accesses, path, writes=bool((flags or 0) & WRITES))
    for index, start in CHANGES.get(event, ()):
        _note(_accesses, arguments[index], writes=True, start=-1 if start is None else arguments[start])


def _note(accesses: list[str], path: Any, writes: bool, start: int = -1) -> None:
    is_known = start < 0 or sys.platform == "linux"  # elsewhere, the path of an open folder cannot be found out
    if isinstance(path, str | bytes | os.PathLike) and is_known:
        folder = Path(f"/proc/self/fd/{start}").readlink() if start >= 0 else Path()
        full = Path(os.path.realpath(folder / os.fsdecode(path).replace("\0", "?")))
        if not _is_temporary(full) and (writes or not any(full.is_relative_to(folder) for folder in _libraries())):
            accesses.append(f"{'writes' if writes else 'reads'} {full}")


def _is_temporary(path: Path) -> bool:
    """Return whether a path is in a folder made by `tempfile`, a cache of Python or a library, or a null device."""
    temporary = Path(tempfile.gettempdir()).resolve()
    own = (tempfile.gettempprefix(), "mirrorcam-")
    inside = path.is_relative_to(temporary) and str(path.relative_to(temporary)).startswith(own)
    return (
        inside
        or path in (Path(os.devnull), Path("/dev/full"))
        or ("__pycache__" in path.parts and any(path.is_relative_to(folder) for folder in _libraries()))
        or any(path.is_relative_to(folder) for folder in _settings())
    )


@cache
def _settings() -> tuple[Path, ...]:
    """Return the folders of settings and caches of libraries."""
    home = Path.home().resolve()
    return tuple(home / parent / name for parent in (".config", ".cache") for name in ("matplotlib", "ezdxf"))


@cache
def _libraries() -> tuple[Path, ...]:
    """Return the folders of programs and libraries, and of system information."""
    installed = {sys.prefix, sys.base_prefix, str(ROOT), *(path for path in sys.path if "site-packages" in path)}
    system = [Path(folder) for folder in ("/usr", "/proc", "/sys", "/dev")]
    return (*(Path(folder).resolve() for folder in sorted(installed)), *system)
