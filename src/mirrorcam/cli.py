"""The `mirrorcam` command: parses, runs one command, and turns bad input into one line and an exit code."""

from __future__ import annotations

import errno
import os
import signal
import sys
import traceback
from collections.abc import Callable, Sequence
from contextlib import redirect_stderr, suppress
from dataclasses import dataclass
from io import StringIO
from pathlib import Path
from typing import Annotated, Any

import tyro
from tyro.conf import (
    CascadeSubcommandArgs,
    FlagCreatePairsOff,
    OmitArgPrefixes,
    OmitSubcommandPrefixes,
    PositionalMetavarFromFieldName,
    subcommand,
)
from tyro.constructors import ConstructorRegistry, PrimitiveConstructorSpec, PrimitiveTypeInfo

from mirrorcam import __version__
from mirrorcam.bench import evaluate_command as evaluate
from mirrorcam.bench import leaderboard_command as leaderboard
from mirrorcam.bench import score_command as score
from mirrorcam.bench import suite_command as suite
from mirrorcam.calibration import calibrate_command as calibrate
from mirrorcam.calibration import compare_command as compare
from mirrorcam.calibration import drift_command as drift
from mirrorcam.calibration import validate_command as validate
from mirrorcam.core.console.refusals import one_line_message, refusal
from mirrorcam.core.console.streams import make_readable, quieten_libraries
from mirrorcam.core.console.system_libraries import missing_library_of
from mirrorcam.core.processes import interruption
from mirrorcam.core.values import InputError
from mirrorcam.designs import design_command as design
from mirrorcam.designs import sweep_command as sweep
from mirrorcam.device import adjust_command as adjust
from mirrorcam.device import board_command as board
from mirrorcam.device import cad_command as cad
from mirrorcam.device import camera_command as camera
from mirrorcam.device import cameras_command as cameras
from mirrorcam.lightfield import decode_command as decode
from mirrorcam.lightfield import depth_command as depth
from mirrorcam.lightfield import epi_command as epi
from mirrorcam.lightfield import export_command as export
from mirrorcam.lightfield import features_command as features
from mirrorcam.lightfield import filter_command as filter
from mirrorcam.lightfield import refocus_command as refocus
from mirrorcam.lightfield import track_command as track
from mirrorcam.optics.geometry.arrangement import Pattern
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.run import doctor_command as doctor
from mirrorcam.run import run_command as run
from mirrorcam.simulation import picture_command as picture
from mirrorcam.simulation import render_command as render
from mirrorcam.simulation import scene_command as scene
from mirrorcam.studio import studio_command as studio
from mirrorcam.studio.live import live_command as live

DONE, CHECK_FAILED, BAD_INPUT, INTERRUPTED, TERMINATED = 0, 1, 2, 130, 143
FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO)
"""What the system says where a stream without a name, such as standard output, takes no more."""

RUNNERS: dict[type, Callable[[Any], int]] = {
    run.RunOptions: run.run,
    design.DesignOptions: design.run,
    studio.StudioOptions: studio.run,
    sweep.SweepOptions: sweep.run,
    cad.CadOptions: cad.run,
    camera.CameraOptions: camera.run,
    board.BoardOptions: board.run,
    render.RenderOptions: render.run,
    suite.SuiteOptions: suite.run,
    scene.SceneOptions: scene.run,
    picture.PictureOptions: picture.run,
    calibrate.CalibrateOptions: calibrate.run,
    compare.CompareOptions: compare.run,
    adjust.AdjustOptions: adjust.run,
    decode.DecodeOptions: decode.run,
    live.LiveOptions: live.run,
    drift.DriftOptions: drift.run,
    cameras.CamerasOptions: cameras.run,
    refocus.RefocusOptions: refocus.run,
    epi.EpiOptions: epi.run,
    depth.DepthOptions: depth.run,
    features.FeaturesOptions: features.run,
    filter.FilterOptions: filter.run,
    track.TrackOptions: track.run,
    export.ExportOptions: export.run,
    validate.ValidateOptions: validate.run,
    evaluate.EvaluateOptions: evaluate.run,
    score.ScoreOptions: score.run,
    doctor.DoctorOptions: doctor.run,
    leaderboard.LeaderboardOptions: leaderboard.run,
}
COMMANDS = {options.__module__.rpartition(".")[2].removesuffix("_command"): options for options in RUNNERS}
"""The options of each command by its name."""


@dataclass(frozen=True)
class Command:
    """MirrorCam: design, build, render, calibrate and decode a light field camera made of a webcam and flat mirrors."""

    command: OmitSubcommandPrefixes[
        Annotated[run.RunOptions, subcommand("run")]
        | Annotated[design.DesignOptions, subcommand("design")]
        | Annotated[studio.StudioOptions, subcommand("studio")]
        | Annotated[sweep.SweepOptions, subcommand("sweep")]
        | Annotated[cad.CadOptions, subcommand("cad")]
        | Annotated[camera.CameraOptions, subcommand("camera")]
        | Annotated[board.BoardOptions, subcommand("board")]
        | Annotated[render.RenderOptions, subcommand("render")]
        | Annotated[suite.SuiteOptions, subcommand("suite")]
        | Annotated[scene.SceneOptions, subcommand("scene")]
        | Annotated[picture.PictureOptions, subcommand("picture")]
        | Annotated[calibrate.CalibrateOptions, subcommand("calibrate")]
        | Annotated[compare.CompareOptions, subcommand("compare")]
        | Annotated[adjust.AdjustOptions, subcommand("adjust")]
        | Annotated[decode.DecodeOptions, subcommand("decode")]
        | Annotated[live.LiveOptions, subcommand("live")]
        | Annotated[drift.DriftOptions, subcommand("drift")]
        | Annotated[cameras.CamerasOptions, subcommand("cameras")]
        | Annotated[refocus.RefocusOptions, subcommand("refocus")]
        | Annotated[epi.EpiOptions, subcommand("epi")]
        | Annotated[depth.DepthOptions, subcommand("depth")]
        | Annotated[features.FeaturesOptions, subcommand("features")]
        | Annotated[filter.FilterOptions, subcommand("filter")]
        | Annotated[track.TrackOptions, subcommand("track")]
        | Annotated[export.ExportOptions, subcommand("export")]
        | Annotated[validate.ValidateOptions, subcommand("validate")]
        | Annotated[evaluate.EvaluateOptions, subcommand("evaluate")]
        | Annotated[score.ScoreOptions, subcommand("score")]
        | Annotated[doctor.DoctorOptions, subcommand("doctor")]
        | Annotated[leaderboard.LeaderboardOptions, subcommand("leaderboard")]
    ]
    version: bool = False
    """print the version, and do nothing else"""
    debug: bool = False
    """show the traceback of an error"""


def camera_from_text(text: str) -> Camera:
    """A camera of the library by its name, or read from a JSON or TOML file."""
    from mirrorcam.optics.geometry.camera_library import read_camera

    return read_camera(text)


def _camera_rule(info: PrimitiveTypeInfo) -> PrimitiveConstructorSpec[Camera] | None:
    if info.type is not Camera:
        return None
    return PrimitiveConstructorSpec(
        nargs=1,
        metavar="NAME|FILE",
        instance_from_str=lambda texts: camera_from_text(texts[0]),
        is_instance=lambda value: isinstance(value, Camera),
        str_from_instance=lambda camera: ["c920" if camera == Camera.c920() else camera.name],
    )


def pattern_from_text(text: str) -> Pattern | None:
    """A pattern of views by its name, such as hex7, or read from a JSON or TOML file; "none" is None."""
    if text == "none":
        return None
    named = Pattern.named(text)
    if named is not None:
        return named
    from mirrorcam.core.disk.files import read_model

    return read_model(Pattern, Path(text))


def _pattern_rule(info: PrimitiveTypeInfo) -> PrimitiveConstructorSpec[Pattern | None] | None:
    if info.type != Pattern | None:
        return None
    return PrimitiveConstructorSpec(
        nargs=1,
        metavar="hexN|ringN|FILE",
        instance_from_str=lambda texts: pattern_from_text(texts[0]),
        is_instance=lambda value: value is None or isinstance(value, Pattern),
        str_from_instance=lambda pattern: ["none" if pattern is None else pattern.name],
    )


def _help_command(arguments: Sequence[str]) -> str:
    """The command line that prints the help of the command that was asked for, or of all where none was."""
    first = next((argument for argument in arguments if not argument.startswith("-")), "")
    return f"mirrorcam {first} --help" if first in COMMANDS else "mirrorcam --help"


def _flush() -> None:
    """Flush what was printed, so that an error of writing can still be reported."""
    if sys.stdout is not None:
        sys.stdout.flush()


def parse(arguments: Sequence[str]) -> Command:
    """The command line as a `Command`, or InputError in one line; --help prints and raises SystemExit(0)."""
    if any("\x00" in argument for argument in arguments):
        raise InputError("an argument contains a null character")
    registry = ConstructorRegistry()
    registry.primitive_rule(_camera_rule)
    registry.primitive_rule(_pattern_rule)
    printed = StringIO()
    try:
        with redirect_stderr(printed):
            return tyro.cli(
                Command,
                prog="mirrorcam",
                args=arguments,
                config=(CascadeSubcommandArgs, FlagCreatePairsOff, OmitArgPrefixes, PositionalMetavarFromFieldName),
                registry=registry,
            )
    except SystemExit as error:
        if not error.code:
            _flush()
            raise
        reason = refusal(error, printed.getvalue(), arguments, COMMANDS)
        raise InputError(one_line_message(reason, f" (see {_help_command(arguments)})")) from error


def _refuse(message: str, code: int, arguments: Sequence[str]) -> int:
    """Say in one line on standard error why it ends (with --debug, also where it happened), and pass the code on."""
    with suppress(OSError):  # where standard error takes nothing, the code says it alone
        if "--debug" in arguments:
            traceback.print_exc()
        print(f"mirrorcam: {one_line_message(message)}", file=sys.stderr)
    return code


def _say_no_more() -> None:
    """Let standard output go nowhere, also what is flushed to it at the end of this process."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; returns 0 done, 1 a check failed, 2 bad input, 130 interrupted, 143 terminated."""
    arguments = sys.argv[1:] if arguments is None else arguments
    make_readable()
    quieten_libraries()
    try:
        with interruption.remembered():
            if "--version" in arguments:
                print(f"mirrorcam {__version__}")
                _flush()
                return DONE
            command = parse(arguments)
            code = RUNNERS[type(command.command)](command.command)
            _flush()
            return code
    except (Exception, KeyboardInterrupt) as error:
        return _end(error, arguments)


def _end(error: BaseException, arguments: Sequence[str]) -> int:
    """Say why a command ends with an error, which is being handled, and return the exit code; raises a bug."""
    if interruption.ended(error):
        if interruption.asked() == signal.SIGTERM:
            return _refuse("terminated; finished files are whole", TERMINATED, arguments)
        return _refuse("interrupted; finished files are whole", INTERRUPTED, arguments)
    if isinstance(error, InputError):
        return _refuse(str(error), BAD_INPUT, arguments)
    if isinstance(error, BrokenPipeError):
        _say_no_more()  # the reader of the output has closed it
        return CHECK_FAILED
    if isinstance(error, OSError) and error.filename is not None:
        return _refuse(f"{error.filename}: {error.strerror}", BAD_INPUT, arguments)
    if isinstance(error, OSError) and error.errno in FULL:
        _say_no_more()
        return _refuse(f"cannot write: {error.strerror}", BAD_INPUT, arguments)
    if lacking := missing_library_of(error):
        return _refuse(lacking, BAD_INPUT, arguments)
    raise error
