"""Commands in unusual surroundings: full disk, another user's folder, no HOME, no terminal, unusual names of files.

Each attempt runs a cheap command in one of the surroundings. It must end well, or say in one line why not; whatever
lies in its output folder is whole. Where this process may mount file systems, there are full disks that are real.
"""

from __future__ import annotations

import atexit
import ctypes
import itertools
import os
import resource
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from benchmarks.robustness.guard import Category, refused_well
from benchmarks.robustness.kills import contents

LAYOUT = Path(__file__).parents[2] / "tests" / "data" / "default_layout.json"
LONGEST_S = 120.0
PR_CAPBSET_DROP, CAP_DAC_OVERRIDE, CAP_DAC_READ_SEARCH = 24, 1, 2
COMMANDS = {
    "design": ("design", "--rows", "1", "--cols", "2"),
    "cameras": ("cameras", "{layout}"),
    "decode": ("decode", "{picture}", "--layout", "{layout}", "--width-px", "64"),
    "board": ("board",),
}
ODD_NAMES = (
    *(
        "a blank",
        " blank first",
        "two\nlines",
        "-dash",
        "--help",
        "größe-π-画",
        "quote'\"",
        "$HOME",
        "%s{0}",
        "[bold]x",
    ),
    *("*", "#", "a" * 250, "e\u0301", "\u202egnp", "b\udcff", "tab\tbell\a"),
)


@dataclass(frozen=True)
class Start:
    """A command about to be started: arguments, the folder it writes, and what is particular to its process."""

    arguments: tuple[str, ...]
    out: Path
    environment: dict[str, str]
    before: Callable[[], None] | None = None
    output: str | None = None
    """File that takes standard output; None: a pipe."""
    after: Callable[[], object] = lambda: None
    """Called when what it has left was looked at."""


Surroundings = Callable[[Start, Path], Start]


@cache
def reference(name: str) -> dict[str, str]:
    """Digests by name of what a command writes in good surroundings."""
    folder = Path(tempfile.mkdtemp(prefix="mirrorcam-surroundings-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    start = _start(name, folder)
    done = _run(start)
    if done.returncode != 0:
        raise RuntimeError(f"{name}: {done.stderr.decode()}")
    return contents(start.out)


def _start(name: str, folder: Path, *, called: str = "given", out: str = "out") -> Start:
    """Make the inputs of a command in a folder, under a name, and return how it is started there."""
    layout, picture = folder / f"{called}.json", folder / f"{called}.png"
    shutil.copy(LAYOUT, layout)
    random = np.random.default_rng(0)
    coarse = random.integers(0, 256, (9, 16, 3), dtype=np.uint8)
    encoded = cv2.imencode(".png", cv2.resize(coarse, (1920, 1080), interpolation=cv2.INTER_CUBIC))[1]
    picture.write_bytes(encoded.tobytes())
    for path in (folder, layout, picture):
        path.chmod(0o755)
    words = [word.format(layout=f"./{layout.name}", picture=f"./{picture.name}") for word in COMMANDS[name]]
    to = f"{out}/board.svg" if name == "board" else out
    return Start((*words, f"--out={to}"), folder / out, dict(os.environ))


def _run(start: Start) -> subprocess.CompletedProcess[bytes]:
    command: list[Any] = [sys.executable, "-m", "mirrorcam", *start.arguments]
    cwd = start.out.parent
    if start.output is None:
        return subprocess.run(
            command, cwd=cwd, env=start.environment, capture_output=True, preexec_fn=start.before,
            timeout=LONGEST_S, check=False,
        )  # fmt: skip
    with Path(start.output).open("wb") as stream:
        return subprocess.run(
            command, cwd=cwd, env=start.environment, stdout=stream, stderr=subprocess.PIPE, preexec_fn=start.before,
            timeout=LONGEST_S, check=False,
        )  # fmt: skip


def _full_disk(most: int, start: Start, folder: Path) -> Start:
    """Limit the size of every file to `most` bytes, as if the disk were full there."""
    return replace(start, before=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (most, most)))


def _small_disk(kib: int, start: Start, folder: Path) -> Start:
    """The output folder is a file system of its own, of `kib` KiB."""
    start.out.mkdir()
    subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={kib}k", "tmpfs", str(start.out)], check=True)
    return replace(start, after=partial(subprocess.run, ["umount", str(start.out)], check=True))


@cache
def may_mount() -> bool:
    """Whether this process may mount file systems, as root on Linux may."""
    with tempfile.TemporaryDirectory() as folder:
        try:
            mounted = subprocess.run(["mount", "-t", "tmpfs", "tmpfs", folder], capture_output=True, check=False)
        except OSError:
            return False
        return mounted.returncode == 0 and subprocess.run(["umount", folder], check=True).returncode == 0


def _as_ordinary_user() -> None:
    """Take from root its right to read and write what is not its own."""
    if os.getuid() == 0:
        for capability in (CAP_DAC_OVERRIDE, CAP_DAC_READ_SEARCH):
            ctypes.CDLL(None).prctl(PR_CAPBSET_DROP, capability)


def _read_only(made: bool, start: Start, folder: Path) -> Start:
    """The output folder, or the one it is to be made in, is not the user's to write."""
    target = start.out if made else folder
    target.mkdir(exist_ok=True)
    target.chmod(0o555)
    return replace(start, before=_as_ordinary_user)


def _home(home: str | None, start: Start, folder: Path) -> Start:
    """There is no home, or none that can be written: a name in the folder."""
    others = {name: value for name, value in start.environment.items() if not name.startswith(("HOME", "XDG", "MPL"))}
    if home is not None:
        (folder / "read_only").mkdir(mode=0o555)
        others["HOME"] = str(folder / home)
    return replace(start, environment=others, before=_as_ordinary_user)


def _close(*descriptors: int) -> None:
    for descriptor in descriptors:
        os.close(descriptor)


def _closed(descriptors: tuple[int, ...], start: Start, folder: Path) -> Start:
    """Standard streams are closed, as for a service."""
    return replace(start, before=partial(_close, *descriptors))


def _plain(environment: dict[str, str], start: Start, folder: Path) -> Start:
    """Nothing but an environment of other settings."""
    return replace(start, environment=start.environment | environment)


def _no_reader(start: Start, folder: Path) -> Start:
    """Standard output takes nothing."""
    return replace(start, output="/dev/full")


SURROUNDINGS: dict[str, Surroundings] = {
    **{f"full disk at {most} bytes": partial(_full_disk, most) for most in (0, 100, 3_000, 20_000, 200_000)},
    "read-only folder": partial(_read_only, True),
    "in a read-only folder": partial(_read_only, False),
    "no HOME": partial(_home, None),
    "HOME is no folder": partial(_home, "nonexistent"),
    "HOME read-only": partial(_home, "read_only"),
    **{f"closed {which}": partial(_closed, which) for which in ((0,), (1,), (0, 1), (0, 1, 2))},
    "output to a full device": _no_reader,
    "plain C": partial(_plain, {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}),
    "dumb terminal": partial(_plain, {"TERM": "dumb", "COLUMNS": "20"}),
}
DISKS: dict[str, Surroundings] = {f"disk of {kib} KiB": partial(_small_disk, kib) for kib in (8, 40, 100, 300, 600)}
CASES: tuple[tuple[str, str, str], ...] = (
    *((name, around, "") for name, around in itertools.product(COMMANDS, SURROUNDINGS)),
    *((name, kind, odd) for name, kind, odd in itertools.product(COMMANDS, ("input", "output"), ODD_NAMES)),
    *((name, disk, "") for name, disk in itertools.product(COMMANDS, DISKS) if may_mount()),
)
"""Command, surroundings, and the odd name where they are one of a file."""


def attempt(seed: int, folder: Path) -> str:
    """Run the command of a seed in the surroundings of the seed."""
    name, around, odd = CASES[seed % len(CASES)]
    expected = reference(name)
    if odd:
        start = _start(name, folder, **{"called" if around == "input" else "out": odd})
    else:
        start = (SURROUNDINGS | DISKS)[around](_start(name, folder), folder)
    try:
        done = _run(start)
        wrong = fault(done, contents(start.out) if os.access(folder, os.R_OK) else {}, expected, named=bool(odd))
    finally:
        start.after()
    return f"{name}, {around} {odd!r}: {wrong}" if wrong else ""


def fault(
    done: subprocess.CompletedProcess[bytes], found: dict[str, str], expected: dict[str, str], *, named: bool
) -> str:
    """What is wrong with the end of a command and the files it has left, or nothing.

    Files `named` after their input are not compared with those expected.
    """
    said = done.stderr.decode(errors="replace")
    if "Traceback" in said:
        return f"traceback: {said.strip().splitlines()[-1]}"
    if done.returncode not in (0, 1, 2):
        return f"exit code {done.returncode}: {said[:100]!r}"
    if done.returncode == 0 and said:
        return f"says {said[:100]!r}"
    if done.returncode == 2 and said and (wrong := refused_well(said.removesuffix("\n"))):
        return wrong
    if named:
        return ""
    half = [name for name in found if found[name] != expected.get(name)]
    if half:
        return f"left {half[0]}"
    return "done without all of its files" if done.returncode == 0 and found != expected else ""


CATEGORY = Category("surroundings", len(CASES), attempt, longest_s=LONGEST_S, tested=0)
