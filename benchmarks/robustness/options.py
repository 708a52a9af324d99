"""Odd values of options: drawn for the options that each command has, on inputs that are good."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, redirect_stderr, redirect_stdout
from functools import cache, wraps
from importlib import import_module
from io import StringIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, get_args
from unittest.mock import patch

import numpy as np
from cyclopts.argument import Argument

from benchmarks.robustness.guard import Category, refused_well
from benchmarks.robustness.layouts import LAYOUT
from docs.website.command_pages import commands
from mirrorcam import cli
from mirrorcam.core.images.pictures import write_image
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.targets import default_board, save_board
from mirrorcam.optics.light_field.decoder import Decoder
from mirrorcam.optics.light_field.io.formats.registry import write_light_field

GOOD_FILES = ("layout.json", "board.toml", "frame.png", "field.npz", "nowhere.json", "work")
HOPELESS = ("nan", "1e308", "-1e308", "", "abc", "1e99", "\x00", "12 34", "a" * 5000, "\N{SNOWMAN}")
"""No number in any range."""
NUMBERS = (
    *("0", "1", "2", "3", "-1", "-0", "0.5", "1.5", "80", "300", "500"),
    *("1e-300", "1e9", "inf", "-inf", "9" * 40, "1_0", "0x10", "--"),
)
TEXTS = (
    *("", " ", "none", "true", "False", "a\nb", "\N{SNOWMAN}", "../..", "a" * 300, "\x00", "\x1b[31m", "-", "--"),
    *("=", ",", ":", "tilt_deg=0.3", "tilt_deg=nan", "tilt_deg=1e308", "tilt_deg", "x=1", "ideal", "c920", "300,500"),
    *("300,nan", "2x2", "0x0", "999999x999999", "a4", "0x1", "1e5x1e5", "c920.toml", "tcp://nowhere:1"),
    *("vase.stl:1,2,3", "vase.stl:nan,0,0", "joint+warp"),
)
OUTPUTS = (
    *("out", ".", "..", "new\nline", "\N{SNOWMAN}", "a" * 300, "a/b/c", "layout.json", "", "x\x00y"),
    *("page.pdf", "page.svg", "a.png"),
)
SLOW = ("run", "design", "studio", "live", "sweep", "cad", "render", "scene", "suite", "calibrate", "validate")
"""Commands whose work, which takes long or does not end, is left out: their options are read, no more."""


@cache
def _inputs() -> dict[str, bytes]:
    """Good inputs: a layout, a board, a frame and the small light field that is decoded from it."""
    layout = Layout.load(LAYOUT)
    shape = (layout.camera.height_px, layout.camera.width_px, 3)
    frame = np.random.default_rng(0).integers(256, size=shape, dtype=np.uint8)
    with TemporaryDirectory() as name:
        folder = Path(name)
        layout.save(folder / "layout.json")
        save_board(folder / "board.toml", default_board())
        write_image(folder / "frame.png", frame)
        write_light_field(folder / "field.npz", Decoder(layout, width_px=32).decode(frame), "npz")
        return {path.name: path.read_bytes() for path in folder.iterdir()}


@cache
def options() -> dict[str, tuple[Argument, ...]]:
    """The arguments and options of each command and subcommand."""
    return {
        name: tuple(each for each in command.assemble_argument_collection() if not each.children)
        for name, command in commands(cli.application()).items()
        if command.default_command is not None
    }


def is_number(argument: Argument) -> bool:
    """Whether an option takes numbers."""

    def has_number(kind: Any) -> bool:
        return kind in (int, float) or any(map(has_number, get_args(kind)))

    return has_number(argument.hint)


def _values(argument: Argument, random: np.random.Generator) -> list[str]:
    def one(among: tuple[str, ...]) -> str:
        return among[int(random.integers(len(among)))]

    if argument.hint is bool:
        return [] if random.random() < 0.8 else [one(TEXTS)]
    if argument.name == "--out":
        return [one(OUTPUTS)]
    if is_number(argument):
        return [
            one(HOPELESS if random.random() < 0.3 else NUMBERS) for _ in range(int(random.choice([0, 1, 1, 1, 2, 5])))
        ]
    choices = tuple(str(each) for each in get_args(argument.hint) if isinstance(each, str))
    among = choices if choices and random.random() < 0.5 else TEXTS if random.random() < 0.5 else GOOD_FILES
    return [one(among) for _ in range(int(random.choice([0, 1, 1, 1, 1, 2])))]


def command_line(random: np.random.Generator) -> tuple[list[str], bool]:
    """Arguments with odd values, and whether one of them is a number that no range holds."""
    names = list(options())
    name = names[int(random.integers(len(names)))]
    arguments, hopeless = name.split(), False
    for each in options()[name]:
        if each.index is not None and random.random() < 0.9:
            own = each.name.lower()
            good = "layout.json" if "layout" in own else "frame.png" if "frame" in own else "field.npz"
            arguments += [good] if random.random() < 0.9 else _values(each, random)
        elif each.index is None and each.required and random.random() < 0.9:
            arguments += [
                each.name,
                {"--layout": "layout.json", "--board": "board.toml", "--to": "ply"}.get(each.name, "x"),
            ]
    named = [each for each in options()[name] if each.index is None]
    for at in random.choice(len(named), size=min(int(random.integers(1, 4)), len(named)), replace=False):
        each = named[int(at)]
        values = _values(each, random)
        hopeless |= is_number(each) and any(value in HOPELESS for value in values)
        arguments += [each.name, *values]
    return arguments, hopeless


@contextmanager
def _inside(folder: Path) -> Iterator[None]:
    before = Path.cwd()
    os.chdir(folder)
    try:
        yield
    finally:
        os.chdir(before)


def _files(folder: Path) -> dict[Path, bytes]:
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def _misplaced(folder: Path, arguments: list[str], before: dict[Path, bytes]) -> str:
    """What was changed, or written outside of the folder of results."""
    at = arguments.index("--out") + 1 if "--out" in arguments else len(arguments)
    stated = arguments[at] if at < len(arguments) else "output"
    roots = [] if "\x00" in stated else [(folder / stated).resolve()]
    if "board" in arguments[:1] or "picture" in arguments[:2]:  # a file beside which others may be written
        roots += [root.parent for root in roots]
    after = _files(folder.parent)
    changed = next((path.name for path, content in before.items() if after.get(path) != content), "")
    new = (path for path in after.keys() - before.keys() if not any(path.is_relative_to(root) for root in roots))
    return f"changed {changed}" if changed else next((f"wrote {path.name}" for path in new), "")


def _bad_message(said: str, arguments: list[str]) -> str:
    """What is wrong with what a refusal printed on standard error."""
    if not said.startswith("mirrorcam: ") or not said.endswith("\n"):
        return f"no line of ours: {said[:120]!r}"
    known = {"--help", *(name for all_of in options().values() for each in all_of for name in each.names)}
    named = set(re.findall(r"(?<![\w-])--[a-z][a-z0-9-]+", said)) - known - set(arguments)
    return refused_well(said[:-1]) or (f"names {named.pop()}, which is no option" if named else "")


@contextmanager
def _no_slow_work() -> Iterator[None]:
    """Let slow commands end as soon as their options are read."""
    with ExitStack() as stack:
        for name, command in commands(cli.application()).items():
            function = command.default_command
            if name.split()[0] not in SLOW or function is None:
                continue

            @wraps(function)
            def nothing(*values: object, **named: object) -> int:
                return 0

            if getattr(import_module(function.__module__), function.__name__, None) is function:
                stack.enter_context(patch(f"{function.__module__}.{function.__name__}", nothing))
            else:
                stack.enter_context(patch.object(command, "default_command", nothing))
        yield


def run_command(arguments: list[str]) -> tuple[int, str]:
    """Run a command in this process: its exit code, and what it prints on standard error."""
    with _no_slow_work(), redirect_stdout(StringIO()), redirect_stderr(StringIO()) as said:
        return cli.main(arguments), said.getvalue()


def attempt(seed: int, folder: Path) -> str:
    """Run a command with odd values of its options."""
    arguments, hopeless = command_line(np.random.default_rng(seed))
    work = folder / "a" / "work"
    work.mkdir(parents=True)
    for name, content in _inputs().items():
        (work / name).write_bytes(content)
    before = _files(folder)
    with _inside(work):
        code, said = run_command(arguments)
    shown = " ".join(arguments)[:100]
    if code not in (0, 1, 2):
        return f"exit code {code}: {shown}"
    if code != 2 and hopeless:
        return f"takes a number of no range: {shown}"
    wrong = (_bad_message(said, arguments) if code == 2 else "") or _misplaced(work, arguments, before)
    return f"{wrong}: {shown}" if wrong else ""


CATEGORY = Category("options", 3000, attempt)
