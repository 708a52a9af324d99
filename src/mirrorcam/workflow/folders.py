"""Atomic writing of folders: complete, or not there."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from mirrorcam.optics.base.values import InputError


@contextmanager
def replaced(folder: Path, *, marker: str, keep_interrupted: bool = False) -> Iterator[Path]:
    """Yield an empty hidden folder that replaces `folder` if the block succeeds and is deleted otherwise.

    With `keep_interrupted` it is kept where the block was interrupted, and the next call yields it with its content.
    Raises InputError where `folder` holds files but not `marker`: another program may have written them.
    """
    if folder.is_file() or (folder.is_dir() and any(folder.iterdir()) and not (folder / marker).exists()):
        raise InputError(f"{folder}: exists and holds no {marker}, expected a new folder or one made by this command")
    former = folder.parent / f".{folder.name}-former"
    _remove(former)
    with _unfinished(folder, keep_interrupted=keep_interrupted) as unfinished:
        yield unfinished
        if folder.exists():
            folder.rename(former)
        unfinished.rename(folder)
        _remove(former)


@contextmanager
def merged(folder: Path, *, listing: str | None = None) -> Iterator[Path]:
    """Yield an empty hidden folder whose files move into `folder` if the block succeeds and are deleted otherwise.

    Files of the same name are replaced, each in one step; others in `folder` stay, except those that an earlier block
    wrote and this one did not: their names are in the file `listing`, where one is given.
    """
    with _unfinished(folder, keep_interrupted=False) as unfinished:
        yield unfinished
        if listing:
            names = sorted(path.relative_to(unfinished).as_posix() for path in unfinished.rglob("*") if path.is_file())
            for name in _listed(folder / listing) - set(names):
                (folder / name).unlink(missing_ok=True)
            (unfinished / listing).write_text("\n".join(names) + "\n", encoding="utf-8")
        for path in sorted(unfinished.rglob("*")):
            place = folder / path.relative_to(unfinished)
            if path.is_dir():
                place.mkdir(parents=True, exist_ok=True)
            else:
                place.parent.mkdir(parents=True, exist_ok=True)
                path.replace(place)


@contextmanager
def _unfinished(folder: Path, *, keep_interrupted: bool) -> Iterator[Path]:
    """Yield a hidden folder beside `folder`; if the block fails, delete it and the parent folders made for it."""
    unfinished = folder.parent / f".{folder.name}-unfinished"
    if not keep_interrupted:
        _remove(unfinished)
    made = [parent for parent in unfinished.parents if not parent.exists()]
    unfinished.mkdir(parents=True, exist_ok=True)
    keep = False
    try:
        yield unfinished
        made = []
    except KeyboardInterrupt:
        keep = keep_interrupted
        raise
    finally:
        if not keep:
            _remove(unfinished)
            for parent in made:
                if not any(parent.iterdir()):
                    parent.rmdir()


def _listed(listing: Path) -> set[str]:
    """Names in a listing that lie below its folder; none where there is no listing."""
    try:
        lines = listing.read_text(encoding="utf-8").splitlines()
    except (FileNotFoundError, NotADirectoryError):
        return set()
    return {
        line for line in lines if line and (listing.parent / line).resolve().is_relative_to(listing.parent.resolve())
    }


def clear(folder: Path) -> None:
    """Delete everything in a folder, but not the folder."""
    for path in folder.iterdir():
        if path.is_dir():
            shutil.rmtree(path)
        else:
            path.unlink()


def _remove(folder: Path) -> None:
    if folder.exists():
        shutil.rmtree(folder)
