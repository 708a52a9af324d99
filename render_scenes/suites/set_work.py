"""Rendering of one set of a suite in a worker: the task is JSON text, the result a folder or the bytes of files."""

from __future__ import annotations

import time
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

from mirrorcam.core.disk.fingerprint import value_digest
from mirrorcam.core.disk.program import program_of
from mirrorcam.core.errors import InputError
from mirrorcam.core.values import Value
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.render_scenes.suites.recipe import SetRecipe

CODE = (
    "mirrorcam.render_scenes.sets.render_set",
    "mirrorcam.render_scenes.suites.recipe",
    "mirrorcam.optics.design.optimise",
)
"""Modules that determine the bytes of a set: renderers, requests and the design of layouts."""


def folder_name(recipe: SetRecipe, variant: str) -> str:
    """Return the folder name of a set: its name, and a 16-digit digest of everything that determines its bytes."""
    inputs = {"recipe": recipe.content_inputs(), "variant": variant, "made_with": program_of(*CODE)}
    return f"{recipe.name}-{value_digest(inputs)[:16]}"


class SetTask(Value):
    """One set: its recipe, the layout of its design, and Mitsuba's variant.

    With a folder, files are written there and an interrupted set is continued; without one, the files are returned.
    """

    recipe: SetRecipe
    designed: Layout | None = None
    variant: str
    folder: Path | None = None


@dataclass(frozen=True)
class SetResult:
    """Result of a worker: the failure, if any, and the files of a set without a folder.

    `seconds` is the processor time.
    """

    failure: str = ""
    files: Mapping[str, bytes] = field(default_factory=dict)
    made_with: Mapping[str, str] = field(default_factory=dict)
    seconds: float = field(default=0.0, compare=False)


def render_on_one_core(task_json: str) -> SetResult:
    """Render a set on one thread, for pools with one process per core; any error is returned as the failure."""
    started = time.process_time()
    task = SetTask.model_validate_json(task_json)
    files: Mapping[str, bytes] = {}
    failure = ""
    try:
        if task.folder is not None:
            _render(task, task.folder)
        else:
            files = _render_files(task)
    except InputError as error:
        failure = str(error)
    except Exception as error:
        failure = f"{type(error).__name__}: {error}"
    return SetResult(" ".join(failure.split()), files, program_of(*CODE), time.process_time() - started)


def render_in_turn(task_json: str) -> SetResult:
    """Call `render_on_one_core` from one of several threads; the calls run in sequence."""
    return _one_thread().submit(render_on_one_core, task_json).result()


@cache
def _one_thread() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(max_workers=1)


def _render(task: SetTask, folder: Path) -> None:
    import cv2

    from mirrorcam.render_scenes.sets.render_set import render_set
    from mirrorcam.render_scenes.variant import use_variant

    use_variant(task.variant)
    import drjit

    drjit.set_thread_count(1)
    cv2.setNumThreads(1)
    render_set(task.recipe.request(task.designed), folder, variant=task.variant)


def _render_files(task: SetTask) -> dict[str, bytes]:
    with TemporaryDirectory(prefix="mirrorcam-") as name:
        folder = Path(name)
        _render(task, folder)
        paths = (path for path in sorted(folder.rglob("*")) if path.is_file())
        return {path.relative_to(folder).as_posix(): path.read_bytes() for path in paths}
