"""The `mirrorcam` command: its commands and their groups, and how a command ends."""

from __future__ import annotations

import errno
import inspect
import os
import signal
import sys
import traceback
from collections.abc import Sequence
from contextlib import suppress
from difflib import get_close_matches
from pathlib import Path
from typing import Annotated, Any

from cyclopts import App, CycloptsError, Group, Parameter
from cyclopts.config import Dict, Env

from mirrorcam import __version__
from mirrorcam.core.command_text import command_text
from mirrorcam.core.console.refusals import one_line_message, refusal
from mirrorcam.core.console.session import begin, session
from mirrorcam.core.console.streams import make_readable, quieten_libraries
from mirrorcam.core.console.system_libraries import missing_library_of
from mirrorcam.core.errors import InputError
from mirrorcam.core.processes import interruption

DONE, CHECK_FAILED, BAD_INPUT, INTERRUPTED, TERMINATED = 0, 1, 2, 130, 143
FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO)
"""Errors of a stream without a file name, such as standard output, that accepts no more data."""
CONFIG = "mirrorcam.toml"
"""File of the current folder with defaults of options: a table for each command."""
LARGEST_CONFIG_BYTES = 4_000
"""Parsing time grows with the square of the length of a list."""
CONFIGURED = f"Defaults of options are read from {CONFIG} and the environment: docs/commands.md."

# The group, name, function and summary of each command. A function is imported when its command runs; its docstring,
# which begins with the summary, is the command's help.
COMMANDS = {
    "Start": {
        "demo": (
            "studio.demo.demo_command:demo",
            "Decode a rendered frame, and show its views, depth and features on a page in the browser.",
        ),
        "run": (
            "run.run_command:run",
            "Run the complete pipeline, from a design to a light field, and write a page of results.",
        ),
        "doctor": ("run.doctor_command:doctor", "List the installed libraries, and test each part."),
    },
    "Design": {
        "design": ("designs.design_command:design", "Optimise a layout of mirrors."),
        "sweep": (
            "designs.sweep_command:sweep",
            "Optimise layouts for all combinations of counts, depths, scales and trade-offs.",
        ),
        "studio": (
            "studio.studio_command:studio",
            "Design, build and use a camera with mirrors, on a page in the browser.",
        ),
        "live": ("studio.studio_command:live", "Align, focus and calibrate a camera, on a page in the browser."),
    },
    "Build": {
        "cad": ("device.cad_command:app", "Generate and check every part of a device; render it; adjust its mirrors."),
        "camera": ("device.camera_command:app", "List, show, measure and export cameras."),
        "board": ("device.board_command:board", "Draw a calibration board at true scale."),
    },
    "Simulate": {
        "render": ("simulation.render_command:app", "Render frames of a calibration board, with ground truth."),
        "scene": ("simulation.scene_command:scene", "Render a tabletop scene, with its true views and depths."),
        "suite": ("bench.suite_command:suite", "Render the sets of a suite: many cameras, boards and hard cases."),
    },
    "Calibrate": {
        "calibrate": (
            "calibration.calibrate_command:calibrate",
            "Calibrate a device, or a camera, from pictures of a board.",
        ),
        "compare": ("calibration.compare_command:compare", "Compare two calibrations of one device."),
        "drift": ("calibration.drift_command:drift", "Detect mirrors that moved since the calibration."),
        "validate": ("calibration.validate_command:validate", "Calibrate a rendered set, and compare with its truth."),
        "score": ("bench.score_command:app", "Score calibrations of rendered sets by any program."),
    },
    "Use the light field": {
        "decode": ("lightfield.decode_command:decode", "Decode frames, videos or a camera into light fields."),
        "depth": ("lightfield.depth_command:depth", "Estimate depth maps of light fields."),
        "refocus": ("lightfield.refocus_command:refocus", "Refocus light fields, and render other viewpoints."),
        "features": ("lightfield.features_command:features", "Find features on which all views agree."),
        "track": ("lightfield.track_command:track", "Track the camera past a static scene."),
        "filter": ("lightfield.filter_command:filter", "Filter light fields in the frequency domain."),
        "export": ("lightfield.export_command:export", "Convert a light field between formats."),
    },
}
NAMES = tuple(name for commands in COMMANDS.values() for name in commands)
_SESSION = Group("Output and errors", sort_key=1000)
Quiet = Annotated[bool, Parameter(("--quiet", "-q"), group=_SESSION, help="print errors only")]
Verbose = Annotated[
    bool, Parameter(("--verbose", "-v"), group=_SESSION, help="also print warnings of libraries and tracebacks")
]
Json = Annotated[bool, Parameter("--json", group=_SESSION, help="print results as one JSON object instead")]


def application(config: Path = Path(CONFIG)) -> App:
    """The parser of command lines: defaults come from a configuration file and from MIRRORCAM_COMMAND_OPTION."""
    app = App(
        name="mirrorcam",
        help="Design, build, simulate, calibrate and use a light field camera made of a webcam and flat mirrors.",
        help_epilogue=CONFIGURED,
        version=f"mirrorcam {__version__}",
        config=[Env("MIRRORCAM_", show=False), *_configuration(config)],
        default_parameter=Parameter(negative=(), consume_multiple=True, show_default=_default_text),
        help_format="plaintext",
        exit_on_error=False,
        print_error=False,
        result_action="return_value",
        suppress_keyboard_interrupt=False,  # `main` ends the command
    )
    app.meta.suppress_keyboard_interrupt = False
    app.register_install_completion_command(group=_SESSION)
    for number, (title, commands) in enumerate(COMMANDS.items()):
        group = Group(title, sort_key=number)
        for position, (name, (function, summary)) in enumerate(commands.items()):
            app.command(f"mirrorcam.{function}", name=name, help=summary, group=group, sort_key=position)
    return app


def _default_text(default: object) -> str | None:
    """The default of an option in its help: None for flags, lists as typed."""
    if default is False or default is None or default == ():
        return None
    return " ".join(map(str, default)) if isinstance(default, tuple) else str(default)


def _configuration(path: Path) -> list[Dict]:
    """Read the configuration file, if any; raises InputError for a table that does not belong to a command."""
    if not path.is_file():
        return []
    from mirrorcam.core.disk.files import read_bytes, toml_of

    tables = toml_of(path, read_bytes(path, LARGEST_CONFIG_BYTES))
    valid = (*NAMES, "quiet", "verbose", "json")
    for key in tables:
        if key not in valid:
            matches = get_close_matches(key, valid, n=1)
            raise InputError(f"{path}: {key!r} is not a command" + (f", did you mean {matches[0]}?" if matches else ""))
    cad = tables.get("cad")
    if isinstance(cad, dict) and Path(str(cad.get("adapter", ""))).suffix:
        # A Python file is run: a folder from elsewhere must not start one.
        raise InputError(f"{path}: cad.adapter is a file, which only the command line may name, expected a kind")
    return [Dict(tables, source=str(path))]


def show_docstring(app: App, names: Sequence[str]) -> None:
    """Use the docstring of the named command as its help: paragraphs are wrapped, examples are not."""
    for name in names[:2]:
        if name not in (NAMES if app.name == ("mirrorcam",) else tuple(app)):
            return
        app = app[name]
        if app.default_command is not None:
            text, title, examples = (inspect.getdoc(app.default_command) or "").partition("\n\nExamples:\n")
            app.help = "\n\n".join(paragraph.replace("\n", " ") for paragraph in text.split("\n\n"))
            app.help_epilogue = f"{title.strip()}\n{examples}\n\n{CONFIGURED}" if examples else CONFIGURED


def parse_and_run(arguments: Sequence[str]) -> int:
    """Run one command line and return its exit code; raises a one-line InputError if it cannot be parsed."""
    app = application()
    show_docstring(app, [argument for argument in arguments if not argument.startswith("-")])

    @app.meta.default
    def launch(
        *tokens: Annotated[str, Parameter(show=False, allow_leading_hyphen=True)],
        quiet: Quiet = False,
        verbose: Verbose = False,
        json: Json = False,
    ) -> Any:
        begin(quiet=quiet, verbose=verbose, json=json)
        if not verbose:
            quieten_libraries()
        if any("\x00" in token for token in tokens):
            raise InputError("an argument contains a null character")
        if not tokens:
            raise InputError(f"expected a command, one of {', '.join(NAMES)} (see mirrorcam --help)")
        with command_text():
            command, bound, _ = app.parse_args(tokens)
        return command(*bound.args, **bound.kwargs)

    try:
        code = app.meta(list(arguments))
    except CycloptsError as error:
        raise refusal(error, NAMES) from error
    return code if isinstance(code, int) else DONE  # of --help and --version


def _refuse(message: str, code: int) -> int:
    """Report an error in one line on standard error, with `--json` also as the result; return the exit code."""
    line = one_line_message(message)
    with suppress(OSError):  # if standard error cannot be written, the exit code reports the error
        if session().verbose:
            traceback.print_exc()
        print(f"mirrorcam: {line}", file=sys.stderr)
        if session().json:
            print(session().text(code, line), flush=True)
    return code


def _discard_output() -> None:
    """Discard further standard output, also at the flush when this process ends."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; returns 0 done, 1 a check failed, 2 bad input, 130 interrupted, 143 terminated."""
    arguments = sys.argv[1:] if arguments is None else arguments
    begin(quiet=False, verbose=False, json="--json" in arguments)  # until the arguments are parsed
    make_readable()
    try:
        with interruption.remembered():
            code = parse_and_run(arguments)
            if session().json:
                print(session().text(code))
            if sys.stdout is not None:
                sys.stdout.flush()  # so that a write error is still reported
            return code
    except (Exception, KeyboardInterrupt) as error:
        return _end(error)


def _end(error: BaseException) -> int:
    """Report the error that ended a command, and return the exit code; reraises a bug."""
    if interruption.caused(error):
        if interruption.requested() == signal.SIGTERM:
            return _refuse("terminated; finished files are complete", TERMINATED)
        return _refuse("interrupted; finished files are complete", INTERRUPTED)
    if isinstance(error, InputError):
        return _refuse(str(error), BAD_INPUT)
    if isinstance(error, BrokenPipeError):
        _discard_output()  # the reader of the output has closed it
        return CHECK_FAILED
    if isinstance(error, OSError) and error.filename is not None:
        return _refuse(f"{error.filename}: {error.strerror}", BAD_INPUT)
    if isinstance(error, OSError) and error.errno in FULL:
        _discard_output()
        return _refuse(f"cannot write: {error.strerror}", BAD_INPUT)
    if missing := missing_library_of(error):
        return _refuse(missing, BAD_INPUT)
    raise error
