"""Folders that appear whole or not at all."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from optics.values import InputError


@contextmanager
def replaced(folder: Path, *, marker: str) -> Iterator[Path]:
    """An empty hidden folder that takes the place of `folder` when the block ends well and vanishes otherwise.

    Raises InputError where `folder` holds files but not `marker`: then they are not ours to replace.
    """
    if folder.is_file() or (folder.is_dir() and any(folder.iterdir()) and not (folder / marker).exists()):
        raise InputError(f"{folder}: exists and holds no {marker}, expected a new folder or one made by this command")
    unfinished, former = (folder.parent / f".{folder.name}-{state}" for state in ("unfinished", "former"))
    _remove(unfinished, former)
    unfinished.mkdir(parents=True)
    try:
        yield unfinished
        if folder.exists():
            folder.rename(former)
        unfinished.rename(folder)
    finally:
        _remove(unfinished, former)


@contextmanager
def merged(folder: Path) -> Iterator[Path]:
    """An empty hidden folder whose files move into `folder` when the block ends well and vanish otherwise.

    Files of the same name are replaced, each in one step; others in `folder` stay.
    """
    unfinished = folder.parent / f".{folder.name}-unfinished"
    _remove(unfinished)
    unfinished.mkdir(parents=True)
    try:
        yield unfinished
        for path in sorted(unfinished.rglob("*")):
            place = folder / path.relative_to(unfinished)
            if path.is_dir():
                place.mkdir(parents=True, exist_ok=True)
            else:
                place.parent.mkdir(parents=True, exist_ok=True)
                path.replace(place)
    finally:
        _remove(unfinished)


def _remove(*folders: Path) -> None:
    for folder in folders:
        if folder.exists():
            shutil.rmtree(folder)
