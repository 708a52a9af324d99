"""The command: bad input ends in one line on standard error, exit 2 and no file; help comes without heavy imports."""

from __future__ import annotations

import inspect
import json
import os
import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from docs.website.command_pages import commands
from mirrorcam import cli
from mirrorcam.core.console.progress import long_work, say
from mirrorcam.core.errors import InputError
from mirrorcam.core.images.pictures import read_image, write_image
from mirrorcam.optics.geometry.boards import Checkerboard, default_board, save_board
from mirrorcam.optics.geometry.layout import Layout
from tests.command_line import assert_refused, assert_refused_here, mirrorcam, results
from tests.nightly import a_few
from tests.soon import soon

LIGHT = ("run", "doctor", "design", "sweep", "studio", "live")
"""Commands whose help needs neither numpy nor pydantic."""
HEAVY = ("casadi", "scipy", "cv2", "matplotlib", "build123d", "trimesh", "ezdxf", "mitsuba", "drjit", "numba", "dask")


@pytest.fixture
def layout_data(tmp_path: Path, small_layout: Layout) -> dict[str, Any]:
    """What a small layout.json, which lies in `tmp_path`, holds."""
    small_layout.save(tmp_path / "layout.json")
    data: dict[str, Any] = json.loads((tmp_path / "layout.json").read_text())
    return data


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        ("", "expected a command, one of demo, run, doctor, design"),
        ("desing", "unknown command 'desing', did you mean design? (see mirrorcam --help)"),
        ("design --tradeof 0.3", "Unknown option: --tradeof. Did you mean --tradeoff? (see mirrorcam design --help)"),
        ("design --tradeoff 2", "--tradeoff '2': expected 0 to 1 (see mirrorcam design"),
        ("design --rows 0", "--rows '0': expected 1 to 12"),
        ("design --rows three", "--rows 'three': expected INT"),
        ("design --rows 2.5", "--rows '2.5': expected INT"),
        ("design --rows 3 4 5", "unknown argument 5"),
        ("design --rows 1 --cols 1", "rows x cols is 1, expected at least two mirrors"),
        ("design --scale-mm nan", "--scale-mm 'nan'"),
        ("design --scale-mm 1e308", "--scale-mm '1e308': expected 0.001 to 100000"),
        ("design --fold-deg 300", "--fold-deg '300': expected 60 to 150"),
        ("design --fold-deg x", "--fold-deg 'x': expected FLOAT or auto"),
        ("design --pattern hex8", "pattern hex8: expected hex with one of 7, 19, 37, 61, 91, 127 views"),
        ("design --pattern mine.toml", "mine.toml: no such file"),
        ("design --pattern ring8 --rows 2", "rows or cols are given with a pattern"),
        ("design --depths-mm", "--depths-mm '': expected at least one value"),
        (f"design --depths-mm{' 3' * 11}", "depths_mm: Tuple should have at most 10 items"),
        ("design --camera nikon.json", "nikon.json: no such file"),
        (f"design --camera {'y' * 900}.toml", "File name too long"),
        (f"design --camera {'y' * 900}", "expected one of arducam_b0196, board_38"),
        ("design --out", "--out: expected a value"),
        ("design --out x\x00y", "an argument contains a null character"),
        ("sweep --table xls --quiet", "--table 'xls': expected one of csv, parquet, json (see mirrorcam sweep --help)"),
        ("sweep --workers x -q", "--workers 'x': expected INT"),
        ("--json sweep --workers 0", "--workers '0': expected 1 to 1024"),
        ("live", "expected --layout (see mirrorcam live --help)"),
        ("decode --layout layout.json", "expected frames, videos, or --live NUMBER"),
        ("decode frame.png --layout nowhere.json", "nowhere.json: no such file"),
        ("depth", "expected LIGHTFIELD... (see mirrorcam depth --help)"),
        ("depth a.npz --near-mm 500 --far-mm 400", "--near-mm 500 --far-mm 400: the nearest depth must be less"),
        ("render nowhere.json", "nowhere.json: no such file"),
        ("camera sho", "(see mirrorcam camera --help)"),
        ("camera show", "(see mirrorcam camera show --help)"),
    ],
)
def test_a_bad_command_line_is_refused_in_one_line(
    tmp_path: Path,
    arguments: str,
    expected: str,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert_refused_here(arguments.split(" ") if arguments else [], capfd, expected)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", cli.NAMES)
def test_the_help_of_a_command_is_its_docstring(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    summary = next(group[name][1] for group in cli.COMMANDS.values() if name in group)
    for words, command in commands(cli.application(), [name]).items():
        assert cli.main([*words.split(), "--help"]) == 0
        printed = " ".join(capsys.readouterr().out.split())
        assert printed.startswith(f"Usage: mirrorcam {words} ")
        if words == name:
            assert summary in printed
        if command.default_command is not None:
            first, _, _ = (inspect.getdoc(command.default_command) or "").partition("\n\n")
            assert first.replace("\n", " ") in (summary if words == name else printed)
            if command.assemble_argument_collection():
                assert re.search(rf"Examples: mirrorcam {words}( |$)", printed)


def test_help_names_the_groups_and_commands(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["--help"]) == 0
    printed = " ".join(capsys.readouterr().out.replace("\u2502", " ").split())
    for group, members in cli.COMMANDS.items():
        assert f" {group} " in printed
        for name, (_, summary) in members.items():
            assert f" {name} {summary} " in printed


def test_no_help_needs_a_heavy_import(tmp_path: Path) -> None:
    light = [["--help"], ["--version"], *([name, "--help"] for name in LIGHT)]
    others = [[name, "--help"] for name in cli.NAMES if name not in LIGHT]
    program = (
        "import sys; from mirrorcam.cli import main\n"
        "def shown(lines, unwanted):\n"
        "    codes = {main(line) for line in lines}\n"
        "    print(codes, unwanted & {*sys.modules}, file=sys.stderr)\n"
        f"shown({light!r}, {{'numpy', 'pydantic'}})\n"
        f"shown({others!r}, {set(HEAVY)!r})\n"
    )
    result = subprocess.run([sys.executable, "-c", program], cwd=tmp_path, capture_output=True, text=True, check=True)
    assert result.stderr == "{0} set()\n" * 2


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("[design]\nrow = 3", 'Unknown option: "[row]" from mirrorcam.toml'),
        ("[desing]\nrows = 3", "mirrorcam.toml: 'desing' is not a command, did you mean design?"),
        ("[design]\nrows = 'three'", "--rows 'three' of mirrorcam.toml: expected INT"),
        ("[design]\nforce = 'perhaps'", "--force 'perhaps' of mirrorcam.toml: expected BOOL"),
        ("[design.rows]\na = 3", 'Unknown option: "[rows][a]" from mirrorcam.toml'),
        ("design = 3", "must be a mapping"),
        ("[cad]\nadapter = 'own.py'", "mirrorcam.toml: cad.adapter is a file, which only the command line may name"),
        ("[design", "mirrorcam.toml: not valid TOML"),
        ("\n".join(f"design.x{number}.y = 1" for number in range(10_000)), "mirrorcam.toml: is larger than"),
        (f"design{'.a' * 1000} = 1", "a key of more than 32 parts"),
        (f"[design]\ndepths-mm = [{'1,' * 1900}]", "depths_mm: Tuple should have at most 10 items"),
    ],
)
def test_a_bad_configuration_file_is_refused_in_one_line_and_soon(
    text: str, expected: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / cli.CONFIG).write_text(text)
    with soon():
        assert_refused_here(["design"], capfd, expected)


def test_defaults_come_from_the_configuration_and_the_environment(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / cli.CONFIG).write_text('json = true\n[sweep]\nworkers = 0\n[decode]\nout = "elsewhere"\n')
    assert_refused_here(["sweep"], capfd, "--workers '0' of mirrorcam.toml: expected")
    monkeypatch.setenv("MIRRORCAM_SWEEP_WORKERS", "-1")
    assert_refused_here(["sweep"], capfd, "--workers '-1' of the environment: expected")
    assert cli.main(["sweep", "--workers", "-2"]) == 2
    printed = capfd.readouterr()
    assert "--workers '-2': expected" in printed.err
    assert json.loads(printed.out)["exit_code"] == 2


def test_quiet_and_json_print_errors_or_results_alone(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    def run() -> int:
        say("doctor", "hello")
        return 1

    stand_in(monkeypatch, run)
    assert cli.main(["doctor", "--quiet"]) == 1
    assert capfd.readouterr() == ("", "")
    assert cli.main(["--json", "doctor"]) == 1
    expected = {"exit_code": 1, "messages": [{"title": "doctor", "text": "hello"}]}
    assert json.loads(capfd.readouterr().out) == expected
    stand_in(monkeypatch, raising(InputError("a.png: no such file")))
    assert cli.main(["doctor", "--json"]) == 2
    printed = capfd.readouterr()
    assert json.loads(printed.out) == {"exit_code": 2, "error": "a.png: no such file"}
    assert printed.err == "mirrorcam: a.png: no such file\n"


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("bash") is None, reason="needs bash")
def test_the_completion_of_bash_names_commands_and_options(tmp_path: Path) -> None:
    environment = os.environ | {"HOME": str(tmp_path), "SHELL": "/bin/bash"}
    install = [sys.executable, "-m", "mirrorcam", "--install-completion"]
    subprocess.run(install, env=environment, capture_output=True, check=True)
    script = next(tmp_path.rglob("*mirrorcam*"))
    for words, expected in (("mirrorcam des", "design"), ("mirrorcam design --sc", "--scale-mm")):
        count = len(words.split()) - 1
        program = (
            f"source {script}; COMP_WORDS=({words}); COMP_CWORD={count}; COMP_LINE='{words}'; COMP_POINT={len(words)}; "
            "_mirrorcam; echo ${COMPREPLY[@]}"
        )
        done = subprocess.run(["bash", "-c", program], env=environment, capture_output=True, text=True, check=True)
        assert done.stdout.split() == [expected]


def not_a_number(data: dict[str, Any]) -> None:
    data["mirrors"][1]["virtual_centre_in_rig_mm"][2] = float("nan")


def crossing_outline(data: dict[str, Any]) -> None:
    outline = data["mirrors"][1]["outline_in_rig_mm"]
    outline[1], outline[2] = outline[2], outline[1]


def overlapping_outlines(data: dict[str, Any]) -> None:
    data["mirrors"][1] = data["mirrors"][0]


def unknown_key(data: dict[str, Any]) -> None:
    data["mirrors"][1]["curvature"] = 0.1


def unknown_schema(data: dict[str, Any]) -> None:
    data["schema"] = "mirrorcam.layout/99"


@pytest.mark.parametrize(
    ("harm", "expected"),
    [
        (not_a_number, "mirrors.1.virtual_centre_in_rig_mm: holds a value that is NaN"),
        (crossing_outline, "mirrors.1: outline crosses itself, expected a convex polygon"),
        (overlapping_outlines, "outlines of mirrors 0-0 and 0-1 overlap"),
        (unknown_key, "mirrors.1.curvature: not known, did you mean curvature_per_m?"),
        (unknown_schema, "expected 'mirrorcam.layout/1'"),
    ],
)
@pytest.mark.parametrize(
    "command", ["cad", "render", "decode frame.png --layout", "calibrate picture.png --board board.toml --layout"]
)
def test_a_bad_layout_is_refused_in_one_line(
    tmp_path: Path,
    layout_data: dict[str, Any],
    harm: Callable[[dict[str, Any]], None],
    expected: str,
    command: str,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    harm(layout_data)
    (tmp_path / "bad.json").write_text(json.dumps(layout_data))
    save_board(tmp_path / "board.toml", default_board())
    before = sorted(tmp_path.rglob("*"))
    monkeypatch.chdir(tmp_path)
    assert_refused_here(f"{command} bad.json".split(), capfd, "bad.json: ", expected)
    assert sorted(tmp_path.rglob("*")) == before


@pytest.fixture
def frame(tmp_path: Path, layout_data: dict[str, Any]) -> Path:
    """A whole frame of the small layout's camera."""
    rows, columns = np.mgrid[:1080, :1920]
    write_image(tmp_path / "frame.png", np.stack([rows, columns, rows + columns], axis=-1).astype(np.uint8))
    return tmp_path / "frame.png"


def another_size(frame: Path) -> None:
    write_image(frame, np.zeros((540, 960, 3), dtype=np.uint8))


def a_folder(frame: Path) -> None:
    frame.unlink()
    frame.mkdir()


@pytest.mark.parametrize(
    ("harm", "expected"),
    a_few(
        1,
        [
            (another_size, "bad.png: 960x540 px, expected 1920x1080 of layout.json's camera"),
            (a_folder, "bad.png: is a folder, expected a file"),
            (Path.unlink, "bad.png: no such file"),
        ],
    ),
)
def test_one_bad_frame_among_good_ones_leaves_nothing_decoded(
    tmp_path: Path, frame: Path, harm: Callable[[Path], None], expected: str
) -> None:
    bad = tmp_path / "bad.png"
    bad.write_bytes(frame.read_bytes())
    harm(bad)
    assert_refused(tmp_path, "decode frame.png bad.png --layout layout.json --out out", expected)


@pytest.mark.slow
def test_two_frames_of_one_name_are_refused(tmp_path: Path, frame: Path) -> None:
    assert_refused(tmp_path, "decode frame.png ./frame.png --layout layout.json", "two frames are called 'frame'")


def test_decode_writes_every_view_and_a_picture_of_them(tmp_path: Path, frame: Path) -> None:
    result = mirrorcam(tmp_path, "decode frame.png --layout layout.json --out out")
    assert (result.returncode, result.stderr) == (0, "")
    assert results(tmp_path / "out") == ["frame.npz", "frame_views.png"]
    with np.load(tmp_path / "out" / "frame.npz", allow_pickle=False) as light_field:
        rows, cols, height, width, colours = light_field["samples"].shape
        assert (rows, cols, colours) == (1, 2, 3)
        assert light_field["weights"].shape == (1, 2, height, width)
        assert light_field["positions_mm"].shape == (1, 2, 3)
    assert read_image(tmp_path / "out" / "frame_views.png").shape[1] > 2 * width


def test_a_board_too_large_to_be_seen_is_refused(tmp_path: Path, default_layout: Layout) -> None:
    if find_spec("mitsuba") is None:  # not by importing it: that would choose an LLVM
        pytest.skip("rendering needs the extra render")
    default_layout.save(tmp_path / "layout.json")
    save_board(tmp_path / "board.toml", Checkerboard(cols=9, rows=6, square_mm=900.0))
    assert_refused(tmp_path, "render layout.json --board board.toml --out set", "board: too large")


def raising(error: BaseException) -> Callable[[], int]:
    def run() -> int:
        raise error

    return run


def stand_in(monkeypatch: pytest.MonkeyPatch, run: Callable[[], int | None]) -> None:
    """Let another function stand in for a command."""
    monkeypatch.setattr("mirrorcam.run.doctor_command.doctor", run)


def test_verbose_shows_the_traceback(monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> None:
    stand_in(monkeypatch, raising(InputError("nowhere.json: no such file")))
    assert cli.main(["doctor", "-v"]) == 2
    lines = capfd.readouterr().err.splitlines()
    assert lines[0].startswith("Traceback")
    assert lines[-1] == "mirrorcam: nowhere.json: no such file"


@pytest.mark.parametrize(
    ("error", "code", "line"),
    [
        (InputError("two\nlines"), 2, "mirrorcam: two lines"),
        (PermissionError(13, "Permission denied", "out/x"), 2, "mirrorcam: out/x: Permission denied"),
        (KeyboardInterrupt(), 130, "mirrorcam: interrupted; finished files are complete"),
    ],
)
def test_the_end_of_a_command_is_reported_in_one_line(
    error: BaseException, code: int, line: str, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    stand_in(monkeypatch, raising(error))
    assert cli.main(["doctor"]) == code
    assert capfd.readouterr().err == line + "\n"


def test_an_interruption_that_a_library_swallows_still_ends_the_command(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    reached = []

    def run() -> int:
        with long_work("doctor", "deaf work"), suppress(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
        reached.append("next work")
        return 0

    stand_in(monkeypatch, run)
    before = signal.getsignal(signal.SIGINT)
    assert cli.main(["doctor"]) == 130
    assert reached == []
    assert "done" not in capfd.readouterr().out
    assert signal.getsignal(signal.SIGINT) is before
    stand_in(monkeypatch, lambda: 0)
    assert cli.main(["doctor"]) == 0


def test_sigterm_ends_a_command_as_ctrl_c_does(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    stand_in(monkeypatch, lambda: signal.raise_signal(signal.SIGTERM))
    assert cli.main(["doctor"]) == 143
    assert capfd.readouterr().err == "mirrorcam: terminated; finished files are complete\n"


def test_what_a_library_makes_of_a_signal_is_one(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    def load() -> int:
        try:
            signal.raise_signal(signal.SIGTERM)
        except KeyboardInterrupt as error:
            raise ImportError("initialization failed") from error
        return 0

    stand_in(monkeypatch, load)
    assert cli.main(["doctor"]) == 143
    assert capfd.readouterr().err == "mirrorcam: terminated; finished files are complete\n"
    stand_in(monkeypatch, raising(ImportError("of ours")))
    with pytest.raises(ImportError, match="of ours"):
        cli.main(["doctor"])


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a device that is always full")
@pytest.mark.parametrize("arguments", [["--help"], ["board"]])
def test_a_full_standard_output_is_reported_in_one_line(arguments: list[str], tmp_path: Path) -> None:
    with Path("/dev/full").open("w") as full:
        command = [sys.executable, "-m", "mirrorcam", *arguments]
        done = subprocess.run(command, cwd=tmp_path, stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert (done.returncode, done.stderr) == (2, "mirrorcam: cannot write: No space left on device\n")


def test_a_programming_error_is_not_disguised(monkeypatch: pytest.MonkeyPatch) -> None:
    stand_in(monkeypatch, raising(KeyError("bug")))
    with pytest.raises(KeyError):
        cli.main(["doctor"])
