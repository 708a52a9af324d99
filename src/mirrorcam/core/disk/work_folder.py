"""Temporary folders for other programs: always removed, by the next run if this one is killed."""

from __future__ import annotations

import os
import secrets
import stat
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from filelock import FileLock, Timeout

PREFIX = "mirrorcam-work-"
LOCK = "lock"
"""Name of the file in each folder that the creating process locks until it ends."""


@contextmanager
def work_folder() -> Iterator[Path]:
    """Yield a new temporary folder, and remove it afterwards with its contents; links are not followed.

    Files that cannot be removed, such as those that the system protects, stay for `remove_stale` of a later run.
    """
    folder = Path(tempfile.mkdtemp(prefix=PREFIX)).resolve()
    lock = FileLock(folder / LOCK, timeout=0)
    lock.acquire()
    try:
        yield folder
    finally:
        with suppress(OSError):
            remove_tree(folder)
        lock.release()


def remove_stale() -> None:
    """Remove the folders of `work_folder` that killed runs of this user left.

    A folder is kept if a process has locked it, or if it has no lock file.
    """
    for folder in Path(tempfile.gettempdir()).resolve().glob(f"{PREFIX}*"):
        with suppress(OSError, Timeout):  # another run removes or uses it
            if _is_ours(folder) and stat.S_ISREG((folder / LOCK).lstat().st_mode):
                with FileLock(folder / LOCK, timeout=0):
                    remove_tree(folder)


def _is_ours(folder: Path) -> bool:
    status = folder.lstat()
    return stat.S_ISDIR(status.st_mode) and (not hasattr(os, "getuid") or status.st_uid == os.getuid())


def remove_tree(path: Path) -> None:
    """Remove a file, a link, or a folder with its content, even without read permission or nested too deep.

    No link is followed. Raises OSError for the first file that cannot be removed.
    """
    if not os.path.lexists(path):
        return
    if path.is_symlink() or not path.is_dir():
        path.unlink()
        return
    path.chmod(0o700)
    pending, token, moved = [path], secrets.token_hex(8), 0
    while pending:
        folder = pending.pop()
        with os.scandir(folder) as entries:
            children = [(Path(entry.path), entry.is_dir(follow_symlinks=False)) for entry in entries]
        for child, is_folder in children:
            if is_folder:
                # Moved to the top before it is emptied: no path becomes too long for the system.
                child.chmod(0o700)
                pending.append(child.rename(path / f".{token}-{moved}"))
                moved += 1
            else:
                child.unlink()
        if folder != path:
            folder.rmdir()
    path.rmdir()
