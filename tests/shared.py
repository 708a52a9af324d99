"""What keeps a run of all tests short: fixtures built once for all workers, parts that are not sliced again."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from filelock import FileLock

from mirrorcam.cad.write.slicer import PROGRAMS


def built_once(factory: pytest.TempPathFactory, name: str, build: Callable[[Path], object]) -> Path:
    """Return the folder `name`, filled by `build`, which one worker calls while the others wait.

    Parameters
    ----------
    factory
        The fixture `tmp_path_factory`. The folder lies in the base folder of the whole run, beside those of the
        workers, so that it must only be read.
    name
        Name of the folder, unique in the test suite.
    build
        Called with a path that does not exist yet, in an existing folder. When it raises, the next worker that asks
        for the folder tries again.
    """
    root = factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        root = root.parent
    folder = root / "shared" / name
    folder.parent.mkdir(exist_ok=True)
    with FileLock(f"{folder}.lock"):
        if not folder.exists():
            unfinished = folder.with_name(f".{name}-{os.environ.get('PYTEST_XDIST_WORKER', 'alone')}")
            build(unfinished)
            unfinished.rename(folder)
    return folder


def path_without_slicer() -> str:
    """Return PATH without the folders that hold PrusaSlicer, for a process that builds parts.

    Slicing takes much of the time of a build; the parts of the default device are sliced by the tests of `cad`.
    """
    folders = os.environ["PATH"].split(os.pathsep)
    return os.pathsep.join(
        folder for folder in folders if not any(shutil.which(program, path=folder) for program in PROGRAMS)
    )


@contextmanager
def no_slicer() -> Iterator[None]:
    """Build parts in this process as where no slicer is installed."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("mirrorcam.cad.write.slicer.find_slicer", lambda: None)
        patch.setattr("mirrorcam.cad.part_files.slicer_version", lambda: None)
        yield
