"""Commands that are ended at a random moment and run again to their end: nothing half written, and the same bytes.

Attempts take the commands in turn. Each ends one, with SIGKILL or, as the second category, with SIGTERM, compares what
then lies in its output folder with the result of a run that was left alone, and runs the command again: a seed says
when it is ended. After SIGTERM, the command says so in one line, and its exit code is 143.
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
from mirrorcam.core.disk.fingerprint import file_digest
from mirrorcam.core.disk.output_folder import HIDDEN
from mirrorcam.optics.geometry.camera import Camera

ROOT = Path(__file__).parents[2]
LONGEST_S = 600.0
SECONDS_TO_END = 1.0
"""Time within which every process of a command has ended once the command itself has."""
SECONDS_TO_TERMINATE = 20.0
"""Time within which a command ends after SIGTERM, whatever native code it is in, on a busy machine."""
LONGEST_TO_END_S = 60.0
OUT = "out"
MARK = "MIRRORCAM_KILLED"
"""Environment variable by which the processes of an attempt are found."""


@dataclass(frozen=True)
class Killed:
    """A command that is ended.

    Attributes
    ----------
    arguments
        Its arguments, without `--out`.
    """

    name: str
    arguments: tuple[str, ...]


@dataclass(frozen=True)
class End:
    """The end of a command: its exit code, what it said, and the processes that ran on for SECONDS_TO_END or longer."""

    code: int
    said: str
    left: tuple[str, ...]


COMMANDS = (
    Killed("run", ("run", "--quick")),
    Killed("render", ("render", "layout.json", "--renderer", "fast", "--frames", "4", "--base-frames", "2")),
    Killed("sweep", ("sweep", "--counts", "1x2", "2x2", "--scales-mm", "60", "--tradeoffs", "0.1", "0.3")),
    Killed("decode", ("decode", "video.avi", "--layout", "layout.json")),
    Killed("cad", ("cad", "layout.json")),
    Killed("scene", ("scene", "layout.json")),
)
TERMINATED = (*COMMANDS, Killed("design", ("design", "--rows", "2", "--cols", "3", "--tolerance")))
CAMERA = Camera.c920().binned(1 / 3)
SIZE_PX = (CAMERA.width_px, CAMERA.height_px)
VIDEO_FRAMES = 300
CYCLES = 20
"""Attempts with each command in the full table."""


@cache
def inputs() -> Path:
    """A folder with the layout of 1 x 2 mirrors and the video that the commands take; removed at the end.

    The camera has a ninth of the usual pixels.
    """
    folder = Path(tempfile.mkdtemp(prefix="mirrorcam-kills-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    (folder / "camera.json").write_text(CAMERA.model_dump_json())
    _whole(["design", "--camera", "camera.json", "--rows", "1", "--cols", "2", "--out", "design"], folder)
    shutil.copy(folder / "design" / "layout.json", folder / "layout.json")
    _write_video(folder / "video.avi")
    return folder


def _write_video(path: Path) -> None:
    """Write a video of as many pixels as the layout's camera has, of smooth pictures that differ."""
    random = np.random.default_rng(0)
    with av.open(str(path), "w") as container:
        stream: Any = container.add_stream("mjpeg", rate=25)
        stream.width, stream.height, stream.pix_fmt = *SIZE_PX, "yuvj420p"
        for _ in range(VIDEO_FRAMES):
            coarse = random.integers(0, 256, (9, 16, 3), dtype=np.uint8)
            picture = cv2.resize(coarse, SIZE_PX, interpolation=cv2.INTER_CUBIC).astype(np.uint8)
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
    if done.returncode not in (0, 1) or "Traceback" in done.stderr:
        raise RuntimeError(f"{' '.join(arguments)} ended with {done.returncode}: {done.stderr}")


def _command(arguments: list[str]) -> list[str]:
    return [sys.executable, "-m", "mirrorcam", *arguments]


def ended_after(command: Killed, folder: Path, seconds: float, number: signal.Signals = signal.SIGKILL) -> End:
    """Run a command in a folder, and end it after a time.

    Each process that is left is its command line, state and the time in s after which it had ended.
    """
    mark = f"{os.getpid()}-{folder.name}"
    process = subprocess.Popen(
        _command([*command.arguments, "--out", str(folder / OUT)]),
        cwd=inputs(),
        env=os.environ | {MARK: mark},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        process.wait(seconds)
    except subprocess.TimeoutExpired:
        process.send_signal(number)
        process.wait(SECONDS_TO_TERMINATE)
    finally:
        process.kill()
    ended = time.monotonic()
    while (left := processes_with(mark)) and time.monotonic() < ended + SECONDS_TO_END:
        time.sleep(0.02)
    found = [_description(each) for each in left]
    while processes_with(mark) and time.monotonic() < ended + LONGEST_TO_END_S:
        time.sleep(0.02)
    return End(
        process.returncode,
        process.communicate()[1],
        tuple(f"{what}, for {time.monotonic() - ended:.1f} s" for what in found),
    )


def _description(number: int) -> str:
    """Command line and state of a process (Linux)."""
    try:
        line = Path(f"/proc/{number}/cmdline").read_bytes().replace(b"\0", b" ").decode(errors="replace")
        state = Path(f"/proc/{number}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return "gone"
    return f"{line[-60:]!r} in state {state[0]}"


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


def terminate(seed: int, folder: Path) -> str:
    """Terminate the command of a seed at a moment of the seed."""
    return cycle(TERMINATED[seed % len(TERMINATED)], seed, folder, signal.SIGTERM)


def cycle(command: Killed, seed: int, folder: Path, number: signal.Signals = signal.SIGKILL) -> str:
    """End a command at a moment of the seed, look at what is there, and run it to its end."""
    expected, takes_s = uninterrupted(command)
    seconds = float(np.random.default_rng(seed).uniform(0.0, takes_s))
    end = ended_after(command, folder, seconds, number)
    what = f"{command.name}, {number.name} after {seconds:.1f} of {takes_s:.1f} s"
    if end.left:
        return f"{what}: {len(end.left)} of its processes run on: {'; '.join(end.left)}"
    if half := half_written(folder / OUT, expected):
        return f"{what}: left {half}"
    if wrong := unlike_the_end(end, number, contents(folder / OUT), expected):
        return f"{what}: {wrong}"
    _whole([*command.arguments, "--out", str(folder / OUT)], inputs())
    found = contents(folder / OUT)
    differing = sorted(name for name in found.keys() | expected.keys() if found.get(name) != expected.get(name))
    if differing:
        return f"{what}: run again, {differing[0]} and {len(differing) - 1} others differ"
    kept = folder / OUT / HIDDEN
    return f"{what}: run again, left {HIDDEN}/lock" if (kept / "lock").exists() else ""


def unlike_the_end(end: End, number: signal.Signals, found: dict[str, str], expected: dict[str, str]) -> str:
    """What is wrong with how a command ended, or nothing.

    A signal takes it unawares before it has begun to listen, and after it has written all.
    """
    if number == signal.SIGKILL or end.code in (0, 1):
        return ""
    if end.code == -number and found in ({}, expected):
        return ""
    if end.code != 143 or not end.said.startswith("mirrorcam: terminated") or end.said.count("\n") != 1:
        return f"ended with {end.code}: {end.said[-200:]!r}"
    return ""


def half_written(folder: Path, expected: dict[str, str]) -> str:
    """Name of the first file that is neither as the result has it nor says what is there of it; empty where none.

    The latter are manifests, of which each file that they list is as they say or still to come, and recordings, which
    end in ".partial".
    """
    for name, sha256 in contents(folder).items():
        growing = any(part.endswith(".partial") for part in Path(name).parts[:-1])
        if sha256 != expected.get(name) and not growing and not _is_manifest(folder / name):
            return name
    return ""


def _is_manifest(path: Path) -> bool:
    try:
        files = json.loads(path.read_bytes())["files"]
        there = {name: sha256 for name, sha256 in files.items() if (path.parent / name).exists()}
        return all(file_digest(path.parent / name) == sha256 for name, sha256 in there.items())
    except (ValueError, TypeError, KeyError, AttributeError, OSError):
        return False


CATEGORIES = (
    Category("kills", CYCLES * len(COMMANDS), attempt, longest_s=LONGEST_S, tested=0),
    Category("terminations", CYCLES * len(TERMINATED), terminate, longest_s=LONGEST_S, tested=0),
)
