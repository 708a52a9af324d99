"""The command: bad input ends in one line on standard error, exit 2 and no file; help comes without heavy imports."""

from __future__ import annotations

import json
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

from mirrorcam import cli
from mirrorcam.core.console.progress import long_work
from mirrorcam.core.images.pictures import read_image, write_image
from mirrorcam.core.values import InputError
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.targets import Checkerboard, default_board, save_board
from mirrorcam.optics.geometry.tolerances import Tolerances
from mirrorcam.simulation.camera_options import tolerances_from_text
from mirrorcam.simulation.render_command import RenderOptions
from tests.command_line import assert_refused, assert_refused_here, mirrorcam, results

HEAVY = ("casadi", "scipy", "cv2", "shapely", "matplotlib", "build123d", "trimesh", "ezdxf", "mitsuba", "drjit")


@pytest.fixture
def layout_data(tmp_path: Path, small_layout: Layout) -> dict[str, Any]:
    """What a small layout.json, which lies in `tmp_path`, holds."""
    small_layout.save(tmp_path / "layout.json")
    data: dict[str, Any] = json.loads((tmp_path / "layout.json").read_text())
    return data


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        ("", "Expected one of {"),
        ("desing", "Unrecognized options: desing"),
        ("design --tradeof 0.3", "--tradeof"),
        ("design --tradeoff 2", "--tradeoff 2.0: Input should be less than or equal to 1"),
        ("design --rows 0", "--rows 0: Input should be greater than or equal to 1"),
        ("design --rows three", "--rows: invalid literal"),
        ("design --rows 1 --cols 1", "rows x cols is 1, expected at least two mirrors"),
        ("design --scale-mm nan", "--scale-mm nan"),
        ("design --pattern hex8", "pattern hex8: expected hex with one of 7, 19, 37, 61, 91, 127 views"),
        ("design --pattern mine.toml", "mine.toml: no such file"),
        ("design --pattern ring8 --rows 2", "rows or cols are given with a pattern, expected one of the two"),
        ("design --depths-mm", "--depths-mm: expected at least one value"),
        ("design --surface third", "invalid choice 'third' for argument '--surface'"),
        ("design --camera nikon.json", "nikon.json: no such file"),
        ("decode --layout layout.json", "expected frames, videos, or --live NUMBER"),
        ("decode frame.png", "--layout"),
        ("decode frame.png --layout nowhere.json", "nowhere.json: no such file"),
        ("render nowhere.json", "nowhere.json: no such file"),
        ("render layout.json --frames 0", "--frames 0: Input should be greater than or equal to 1"),
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
    assert_refused_here(arguments.split(), capfd, expected)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("arguments", "page"),
    [
        ("render --frames x", "mirrorcam render --help"),
        ("--debug board --pag a4", "mirrorcam board --help"),
        ("render", "mirrorcam render --help"),
        ("desing --rows 2", "mirrorcam --help"),
        ("", "mirrorcam --help"),
    ],
)
def test_a_bad_command_line_is_referred_to_the_help_of_its_command(arguments: str, page: str) -> None:
    with pytest.raises(InputError) as caught:
        cli.parse(arguments.split())
    assert str(caught.value).endswith(f"(see {page})")


@pytest.mark.parametrize(
    ("command", "words"),
    [
        ("board", "[BOARD]"),
        ("render", "[LAYOUT]"),
        ("decode", "[FRAME|VIDEO...]"),
        ("scene", "LAYOUT"),
        ("render", "--no-maps leave out the maps"),
    ],
)
def test_help_shows_what_may_be_left_out(command: str, words: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        cli.parse([command, "--help"])
    assert f" {words} " in " ".join(capsys.readouterr().out.replace("\u2502", " ").split())


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
        (unknown_schema, "schema: Input should be 'mirrorcam.layout/1'"),
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
    [
        (another_size, "bad.png: 960x540 px, expected 1920x1080 of layout.json's camera"),
        (a_folder, "bad.png: is a folder, expected a file"),
        (Path.unlink, "bad.png: no such file"),
    ],
)
def test_one_bad_frame_among_good_ones_leaves_nothing_decoded(
    tmp_path: Path, frame: Path, harm: Callable[[Path], None], expected: str
) -> None:
    bad = tmp_path / "bad.png"
    bad.write_bytes(frame.read_bytes())
    harm(bad)
    assert_refused(tmp_path, "decode frame.png bad.png --layout layout.json --out out", expected)


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


def test_debug_shows_the_traceback(tmp_path: Path) -> None:
    result = mirrorcam(tmp_path, "cad nowhere.json --debug")
    assert result.returncode == 2
    assert "Traceback" in result.stderr
    assert result.stderr.splitlines()[-1] == "mirrorcam: nowhere.json: no such file"


def test_help_names_the_commands_and_needs_no_heavy_import(tmp_path: Path) -> None:
    program = (
        "import sys; from mirrorcam.cli import main\n"
        "try: main(['--help'])\n"
        f"finally: print(sorted(set(sys.modules) & {set(HEAVY)!r}), file=sys.stderr)"
    )
    result = subprocess.run([sys.executable, "-c", program], cwd=tmp_path, capture_output=True, text=True, check=True)
    assert result.stderr == "[]\n"
    for options in cli.RUNNERS:
        assert (options.__doc__ or "").split(":")[0].split(";")[0][:40] in result.stdout


def raising(error: BaseException) -> Callable[[object], int]:
    def run(options: object) -> int:
        raise error

    return run


@pytest.mark.parametrize(
    ("error", "code", "line"),
    [
        (InputError("two\nlines"), 2, "mirrorcam: two lines"),
        (PermissionError(13, "Permission denied", "out/x"), 2, "mirrorcam: out/x: Permission denied"),
        (KeyboardInterrupt(), 130, "mirrorcam: interrupted; finished files are whole"),
    ],
)
def test_what_ends_a_command_is_told_in_one_line(
    error: BaseException, code: int, line: str, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    options = next(options for options in cli.RUNNERS if options.__name__ == "CadOptions")
    monkeypatch.setitem(cli.RUNNERS, options, raising(error))
    assert cli.main(["cad", "layout.json"]) == code
    assert capfd.readouterr().err == line + "\n"


def test_an_interruption_that_a_library_swallows_still_ends_the_command(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    reached = []

    def run(options: object) -> int:
        with long_work("design", "deaf work"), suppress(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
        reached.append("next work")
        return 0

    options = next(options for options in cli.RUNNERS if options.__name__ == "CadOptions")
    monkeypatch.setitem(cli.RUNNERS, options, run)
    before = signal.getsignal(signal.SIGINT)
    assert cli.main(["cad", "layout.json"]) == 130
    assert reached == []
    assert "done" not in capfd.readouterr().out
    assert signal.getsignal(signal.SIGINT) is before
    monkeypatch.setitem(cli.RUNNERS, options, lambda options: 0)
    assert cli.main(["cad", "layout.json"]) == 0


def test_sigterm_ends_a_command_as_ctrl_c_does(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    options = next(options for options in cli.RUNNERS if options.__name__ == "CadOptions")
    monkeypatch.setitem(cli.RUNNERS, options, lambda options: signal.raise_signal(signal.SIGTERM))
    assert cli.main(["cad", "layout.json"]) == 143
    assert capfd.readouterr().err == "mirrorcam: terminated; finished files are whole\n"


def test_what_a_library_makes_of_a_signal_is_one(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    def load(options: object) -> int:
        try:
            signal.raise_signal(signal.SIGTERM)
        except KeyboardInterrupt as error:
            raise ImportError("initialization failed") from error
        return 0

    options = next(options for options in cli.RUNNERS if options.__name__ == "CadOptions")
    monkeypatch.setitem(cli.RUNNERS, options, load)
    assert cli.main(["cad", "layout.json"]) == 143
    assert capfd.readouterr().err == "mirrorcam: terminated; finished files are whole\n"
    monkeypatch.setitem(cli.RUNNERS, options, raising(ImportError("of ours")))
    with pytest.raises(ImportError, match="of ours"):
        cli.main(["cad", "layout.json"])


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a device that is always full")
@pytest.mark.parametrize("arguments", [["--help"], ["board"]])
def test_a_full_standard_output_is_told_in_one_line(arguments: list[str], tmp_path: Path) -> None:
    with Path("/dev/full").open("w") as full:
        command = [sys.executable, "-m", "mirrorcam", *arguments]
        done = subprocess.run(command, cwd=tmp_path, stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert (done.returncode, done.stderr) == (2, "mirrorcam: cannot write: No space left on device\n")


def test_a_programming_error_is_not_disguised(monkeypatch: pytest.MonkeyPatch) -> None:
    options = next(options for options in cli.RUNNERS if options.__name__ == "CadOptions")
    monkeypatch.setitem(cli.RUNNERS, options, raising(KeyError("bug")))
    with pytest.raises(KeyError):
        cli.main(["cad", "layout.json"])


def test_render_offers_the_tolerances_of_a_set_with_their_own_defaults() -> None:
    options = cli.parse(["render", "layout.json"]).command
    assert isinstance(options, RenderOptions)
    assert tolerances_from_text(options.as_built) == Tolerances()
