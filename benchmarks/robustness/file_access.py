"""Files that Python opens, makes, renames or removes in places where an attempt has nothing to look for.

Python's audit events tell. They do not see what libraries in other languages and child processes open: attempts that
could make those read or write elsewhere put a file there and look at it themselves.
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
"""Audit events of changes: where among their arguments a path is, and the descriptor of the folder it starts from."""
WRITES = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND

_seen: list[str] | None = None


@contextmanager
def watched_files() -> Iterator[list[str]]:
    """List what is read or written elsewhere within the block, such as "reads /home/x/secret"."""
    global _seen
    _hook()
    found: list[str] = []
    _seen = found
    try:
        yield found
    finally:
        _seen = None


@cache
def _hook() -> None:
    sys.addaudithook(_on_event)


def _on_event(event: str, arguments: tuple[Any, ...]) -> None:
    if _seen is None:
        return
    if event == "open":
        path, _, flags = arguments
        _note(_seen, path, writes=bool((flags or 0) & WRITES))
    for place, start in CHANGES.get(event, ()):
        _note(_seen, arguments[place], writes=True, start=-1 if start is None else arguments[start])


def _note(found: list[str], path: Any, writes: bool, start: int = -1) -> None:
    is_known = start < 0 or sys.platform == "linux"  # elsewhere, the path of an open folder cannot be found out
    if isinstance(path, str | bytes | os.PathLike) and is_known:
        folder = Path(f"/proc/self/fd/{start}").readlink() if start >= 0 else Path()
        full = Path(os.path.realpath(folder / os.fsdecode(path).replace("\0", "?")))
        if not _is_temporary(full) and (writes or not any(full.is_relative_to(place) for place in _libraries())):
            found.append(f"{'writes' if writes else 'reads'} {full}")


def _is_temporary(path: Path) -> bool:
    """Whether a path lies in a folder that `tempfile` has made, is what Python or a library keeps, or is no file."""
    folder = Path(tempfile.gettempdir()).resolve()
    own = (tempfile.gettempprefix(), "mirrorcam-")
    inside = path.is_relative_to(folder) and str(path.relative_to(folder)).startswith(own)
    return (
        inside
        or path in (Path(os.devnull), Path("/dev/full"))
        or ("__pycache__" in path.parts and any(path.is_relative_to(place) for place in _libraries()))
        or any(path.is_relative_to(place) for place in _settings())
    )


@cache
def _settings() -> tuple[Path, ...]:
    """Folders of settings and caches of libraries."""
    home = Path.home().resolve()
    return tuple(home / kept / name for kept in (".config", ".cache") for name in ("matplotlib", "ezdxf"))


@cache
def _libraries() -> tuple[Path, ...]:
    """Folders of programs and libraries, and of what the system tells about itself."""
    installed = {sys.prefix, sys.base_prefix, str(ROOT), *(path for path in sys.path if "site-packages" in path)}
    system = [Path(place) for place in ("/usr", "/proc", "/sys", "/dev")]
    return (*(Path(place).resolve() for place in sorted(installed)), *system)
