"""Commands that are killed at a random moment and run again to their end: nothing half written, and the same bytes.

Attempts take the commands in turn. Each kills one with SIGKILL, compares what then lies in its output folder with the
result of a run that was left alone, and runs the command again: a seed says when it is killed.
"""

from __future__ import annotations

import atexit
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np

from benchmarks.robustness.guard import Category
from mirrorcam.optics.base.fingerprint import file_digest
from mirrorcam.workflow.output_folder import HIDDEN

ROOT = Path(__file__).parents[2]
LONGEST_S = 600.0
SECONDS_TO_END = 1.0
"""Time within which every process of a killed command has ended."""
OUT = "out"
MARK = "MIRRORCAM_KILLED"
"""Environment variable by which the processes of an attempt are found."""


@dataclass(frozen=True)
class Killed:
    """A command that is killed.

    Attributes
    ----------
    arguments
        Its arguments, without `--out`.
    """

    name: str
    arguments: tuple[str, ...]


COMMANDS = (
    Killed("run", ("run", "--quick")),
    Killed("render", ("render", "layout.json", "--renderer", "fast", "--frames", "4", "--base-frames", "2")),
    Killed("sweep", ("sweep", "--counts", "1x2", "2x2", "--scales-mm", "60", "--tradeoffs", "0.1", "0.3")),
    Killed("decode", ("decode", "video.avi", "--layout", "layout.json")),
    Killed("cad", ("cad", "layout.json")),
    Killed("scene", ("scene", "layout.json", "--spp", "4")),
)
VIDEO_FRAMES = 60
CYCLES = 20
"""Attempts with each command in the full table."""


@cache
def inputs() -> Path:
    """A folder with the layout of 1 x 2 mirrors and the video that the commands take; removed at the end."""
    folder = Path(tempfile.mkdtemp(prefix="mirrorcam-kills-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    _whole(["design", "--rows", "1", "--cols", "2", "--out", "design"], folder)
    shutil.copy(folder / "design" / "layout.json", folder / "layout.json")
    _write_video(folder / "video.avi")
    return folder


def _write_video(path: Path) -> None:
    """Write a video of as many pixels as the layout's camera has, of smooth pictures that differ."""
    random = np.random.default_rng(0)
    with av.open(str(path), "w") as container:
        stream: Any = container.add_stream("mjpeg", rate=25)
        stream.width, stream.height, stream.pix_fmt = 1920, 1080, "yuvj420p"
        for _ in range(VIDEO_FRAMES):
            coarse = random.integers(0, 256, (9, 16, 3), dtype=np.uint8)
            picture = cv2.resize(coarse, (1920, 1080), interpolation=cv2.INTER_CUBIC).astype(np.uint8)
            container.mux(
                stream.encode(av.VideoFrame.from_ndarray(picture, format="rgb24").reformat(format="yuvj420p"))
            )
        container.mux(stream.encode(None))


@cache
def uninterrupted(command: Killed) -> tuple[dict[str, str], float]:
    """Digests by name of what a command writes when it is left alone, and how long it takes in s."""
    began = time.monotonic()
    out = inputs() / "whole" / command.name
    _whole([*command.arguments, "--out", str(out)], inputs())
    return contents(out), time.monotonic() - began


def contents(folder: Path) -> dict[str, str]:
    """Sha256 by name of the files in a folder that are not hidden."""
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    named = {path.relative_to(folder): path for path in files}
    return {name.as_posix(): file_digest(path) for name, path in named.items() if not _hidden(name)}


def _hidden(name: Path) -> bool:
    return any(part.startswith(".") for part in name.parts)


def _whole(arguments: list[str], folder: Path) -> None:
    done = subprocess.run(
        _command(arguments), cwd=folder, capture_output=True, text=True, timeout=LONGEST_S, check=False
    )
    if done.returncode not in (0, 1):
        raise RuntimeError(f"{' '.join(arguments)} ended with {done.returncode}: {done.stderr}")


def _command(arguments: list[str]) -> list[str]:
    return [sys.executable, "-m", "mirrorcam", *arguments]


def killed_after(command: Killed, folder: Path, seconds: float) -> list[int]:
    """Run a command in a folder, kill it after a time, and return its processes that still run SECONDS_TO_END later."""
    mark = f"{os.getpid()}-{folder.name}"
    process = subprocess.Popen(
        _command([*command.arguments, "--out", str(folder / OUT)]),
        cwd=inputs(),
        env=os.environ | {MARK: mark},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    try:
        process.wait(seconds)
    except subprocess.TimeoutExpired:
        process.send_signal(signal.SIGKILL)
        process.wait()
    deadline = time.monotonic() + SECONDS_TO_END
    while (left := processes_with(mark)) and time.monotonic() < deadline:
        time.sleep(0.02)
    return left


def processes_with(mark: str) -> list[int]:
    """Numbers of the running processes whose environment has a mark (Linux)."""
    found, wanted = [], f"{MARK}={mark}".encode()
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            if wanted in (folder / "environ").read_bytes().split(b"\0"):
                found.append(int(folder.name))
        except OSError:  # it has ended, or is another user's
            continue
    return found


def attempt(seed: int, folder: Path) -> str:
    """Kill the command of a seed at a moment of the seed."""
    return cycle(COMMANDS[seed % len(COMMANDS)], seed, folder)


def cycle(command: Killed, seed: int, folder: Path) -> str:
    """Kill a command at a moment of the seed, look at what is there, and run it to its end."""
    expected, takes_s = uninterrupted(command)
    seconds = float(np.random.default_rng(seed).uniform(0.0, takes_s))
    left = killed_after(command, folder, seconds)
    what = f"{command.name}, killed after {seconds:.1f} of {takes_s:.1f} s"
    if left:
        return f"{what}: {len(left)} of its processes run on"
    if half := half_written(folder / OUT, expected):
        return f"{what}: left {half}"
    _whole([*command.arguments, "--out", str(folder / OUT)], inputs())
    found = contents(folder / OUT)
    differing = sorted(name for name in found.keys() | expected.keys() if found.get(name) != expected.get(name))
    if differing:
        return f"{what}: run again, {differing[0]} and {len(differing) - 1} others differ"
    kept = folder / OUT / HIDDEN
    return f"{what}: run again, left {HIDDEN}/lock" if (kept / "lock").exists() else ""


def half_written(folder: Path, expected: dict[str, str]) -> str:
    """Name of the first file that is neither as the result has it nor says what is there of it; empty where none.

    The latter are manifests, of which each file that they list is as they say, and recordings, which end in ".partial".
    """
    for name, sha256 in contents(folder).items():
        growing = any(part.endswith(".partial") for part in Path(name).parts[:-1])
        if sha256 != expected.get(name) and not growing and not _is_manifest(folder / name):
            return name
    return ""


def _is_manifest(path: Path) -> bool:
    try:
        files = json.loads(path.read_bytes())["files"]
        return all(file_digest(path.parent / name) == sha256 for name, sha256 in files.items())
    except (ValueError, TypeError, KeyError, AttributeError, OSError):
        return False


CATEGORY = Category("kills", CYCLES * len(COMMANDS), attempt, longest_s=LONGEST_S, tested=0)
