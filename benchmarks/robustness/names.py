"""Foreign manifests, records and journals that list odd file names.

A secret file is next to the folder that is read: nothing may read it or write outside the folder.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.robustness.damage import damaged_bytes, damaged_value
from benchmarks.robustness.guard import Category, message_fault
from mirrorcam.core.disk.fingerprint import digest
from mirrorcam.core.disk.output_folder import output_folder, results_folder
from mirrorcam.core.disk.results import Results
from mirrorcam.core.disk.stages import Stage, made_of, staleness
from mirrorcam.core.errors import InputError
from mirrorcam.optics.light_field.io.recording import Folders, Recording
from mirrorcam.simulation.rendering import check_set
from tests.render_scenes.manifests import dataset_of_two_frames, scene_of_two_depths

SECRET, SECRET_TEXT = "secret", "nobody's business"
MINE = "mine"
ODD_NAMES = (
    *("../secret", "..\\secret", "./../secret", "frames/../../secret", "link/secret", "deep/link", "/etc/passwd"),
    *("C:\\x", "", ".", "..", "a\x00b", "a\nb", "x" * 300, "x/" * 3000, "\u202e", "con", "-rf", "~", "$HOME"),
    *("mine", "{secret}"),
)


def attempt(seed: int, folder: Path) -> str:
    """Use a manifest with odd names, and check what that read, wrote and reported."""
    random = np.random.default_rng(seed)
    place = folder / "place"
    (place / "deep").mkdir(parents=True)
    (folder / SECRET).write_text(SECRET_TEXT)
    (place / MINE).write_text(MINE)
    (place / "link").symlink_to(folder)
    (place / "deep" / "link").symlink_to(folder / SECRET)
    use = USES[int(random.integers(len(USES)))]
    with _opened() as opened:
        try:
            wrong = use(place, random)
        except InputError as error:
            wrong = message_fault(str(error).replace(str(folder), ""))
    if opened & {str((folder / SECRET).resolve()), os.path.realpath("/etc/passwd")}:
        return f"{use.__name__} read a file outside of the folder"
    if (folder / SECRET).read_text() != SECRET_TEXT or {path.name for path in folder.iterdir()} != {"place", SECRET}:
        return f"{use.__name__} wrote outside of the folder"
    if not (place / MINE).exists() or (place / MINE).read_text() != MINE:
        return f"{use.__name__} lost a file"
    return wrong and f"{use.__name__}: {wrong}"


_opened_paths: list[set[str]] = []


def _note(event: str, arguments: tuple[Any, ...]) -> None:
    if event == "open" and _opened_paths and isinstance(arguments[0], str | bytes):
        _opened_paths[-1].add(os.path.realpath(os.fsdecode(arguments[0])))


@cache
def _watch() -> None:
    sys.addaudithook(_note)


@contextmanager
def _opened() -> Iterator[set[str]]:
    """Collect the files opened in the block."""
    _watch()
    _opened_paths.append(set())
    try:
        yield _opened_paths[-1]
    finally:
        _opened_paths.pop()


def _odd(random: np.random.Generator, folder: Path) -> str:
    return ODD_NAMES[int(random.integers(len(ODD_NAMES)))].replace("{secret}", str(folder.parent / SECRET))


def _files(folder: Path, random: np.random.Generator) -> dict[str, str]:
    """Return one to three odd names, with the true checksum of the secret or of the user's own file."""
    checksums = digest(SECRET_TEXT.encode()), digest(MINE.encode())
    names = [_odd(random, folder) for _ in range(int(random.integers(1, 4)))]
    return {name: str(random.choice(checksums)) for name in names}


def _put(path: Path, value: Any, random: np.random.Generator) -> None:
    """Write JSON, sometimes with damaged values or bytes."""
    kind = random.random()
    text = json.dumps(damaged_value(value, random) if kind < 0.3 else value)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(damaged_bytes(text.encode(), random) if kind > 0.85 else text.encode())


def dataset(folder: Path, random: np.random.Generator) -> str:
    """Verify a rendered set."""
    _put(
        folder / "dataset.json",
        dataset_of_two_frames().replaced(files=_files(folder, random)).model_dump(mode="json", by_alias=True),
        random,
    )
    check_set(folder)
    return ""


def resumed(folder: Path, random: np.random.Generator) -> str:
    """Resume a rendered set or scene."""
    manifest = dataset_of_two_frames() if random.random() < 0.5 else scene_of_two_depths()
    listed = manifest.replaced(files=_files(folder, random))
    _put(folder / manifest.FILE, listed.model_dump(mode="json", by_alias=True), random)
    if random.random() < 0.3:
        (folder / "truth").symlink_to(folder.parent)
    manifest.resumed(folder, ("layout.json", "frames/0000.jpg"))
    return ""


def stage(folder: Path, random: np.random.Generator) -> str:
    """Check whether a stage of a run is done."""
    step = Stage("design", lambda place, progress: None)
    (folder / "design").mkdir()
    files = {name: sha256.encode() for name, sha256 in _files(folder, random).items()}
    Results(results_folder(folder)).put("stage-design", made_of(step, folder), files)
    staleness(step, folder)
    return ""


def record(folder: Path, random: np.random.Generator) -> str:
    """Write into a folder whose record lists foreign files."""
    files = {name: value for name, value in _files(folder, random).items() if name != MINE}
    line = {"schema": "mirrorcam.written/2", "command": "cad", "files": {name: [files[name]] for name in files}}
    _put(folder / ".mirrorcam" / "written.jsonl", line, random)
    with output_folder(folder, "cad", force=bool(random.random() < 0.5)) as output:
        output.refuse_changed()
        with output.staged() as staged:
            (staged / "new").write_text("new")
    return ""


def journal(folder: Path, random: np.random.Generator) -> str:
    """Resume a recording, or open a finished one."""
    frames: list[Any] = [{"number": number, "time_s": 0.1 * number} for number in range(3)]
    odd = {"number": _odd(random, folder), "time_s": 0.0}
    frames.insert(int(random.integers(4)), odd if random.random() < 0.5 else damaged_value(frames[0], random))
    about = {"schema": "mirrorcam.light_field/1"}
    if random.random() < 0.5:
        lines = "".join(json.dumps(line) + "\n" for line in (about, *frames)).encode()
        (folder / "clip.partial").mkdir()
        (folder / "clip.partial" / "journal.jsonl").write_bytes(
            damaged_bytes(lines, random) if random.random() < 0.3 else lines
        )
    else:
        _put(folder / "clip" / "frames.json", {**about, "frames": frames, "lost": []}, random)
    Recording(folder / "clip", about, Folders(lambda place, light_field: None)).close()
    return ""


USES: tuple[Callable[[Path, np.random.Generator], str], ...] = (*(dataset, resumed, stage, record, journal),)
CATEGORY = Category("names and manifests", 3_000, attempt)
