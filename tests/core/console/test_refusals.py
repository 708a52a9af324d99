"""What is wrong with a command line takes one short line, which names options that exist."""

from __future__ import annotations

from typing import Any

import pytest

from mirrorcam import cli
from mirrorcam.core.console.refusals import flag, one_line_message, option_fields
from mirrorcam.core.values import InputError
from tests.command_line import assert_refused_here


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        ("depth", "expected at least one LIGHTFIELD (see"),
        ("calibrate --board board.toml", "expected pictures, or --corners FILE (see"),
        ("design --depths-mm", "--depths-mm: expected at least one value"),
        (f"design --depths-mm {'3 ' * 11}", "--depths-mm: 11 values, expected 10 or fewer"),
        ("depth a.npz --naer-mm 3", "Unrecognized options: --naer-mm, did you mean --near-mm?"),
        ("export a.npz --too ply", "Unrecognized options: --too, did you mean --to?"),
        ("sweep --scale-mm 80", "Unrecognized options: --scale-mm, did you mean --scales-mm?"),
        (
            "calibrate a.png --board b --layout l --lens pinhole",
            "'--lens', expected one of brown_conrady, fisheye, rational, spline, thin_prism (see",
        ),
        ("decode a.png --layout b --to png", "'--to', expected one of hci, stanford, zarr (see"),
        ("design --rows 3 4 5", "Unrecognized options: 5"),
        ("desing", "Unrecognized options: desing, did you mean design?"),
        ("export a.npz", "Missing from mirrorcam export: --to {colmap,"),
        ("decode a.png --layout b --reference-depth-mm x", "--reference-depth-mm: expected FLOAT, not ['x']"),
        ("design --scale-mm 1e308", "--scale-mm 1e+308: Input should be less than or equal to 100000"),
        ("design --tolerance --tilt-deg 99", "--tilt-deg 99.0: Input should be less than or equal to 45"),
        ("decode a.png --layout b --reference-depth-mm 1e308", "--reference-depth-mm 1e+308: Input should be less"),
        ("depth a.npz --near-mm -5 --far-mm 0", "--near-mm -5.0: Input should be greater"),
        ("depth a.npz --near-mm 500 --far-mm 400", "--near-mm 500 --far-mm 400: expected a nearest depth below"),
        ("features a.npz --near-mm 5 --far-mm 5", "expected a nearest depth below the farthest"),
        ("refocus a.npz --near-mm 5 --far-mm 4", "expected a nearest depth below the farthest"),
        (f"design --rows {'x' * 900}", "--rows: invalid literal"),
        (f"design --camera {'y' * 900}.toml", "File name too long"),
        (f"design --camera {'y' * 900}", "expected one of arducam_b0196, board_38"),
    ],
)
def test_a_refusal_is_one_short_line(
    arguments: str, expected: str, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    for terminal in ("unicode", "plain"):
        if terminal == "plain":
            monkeypatch.setenv("PYTHONIOENCODING", "ascii")
        assert_refused_here(arguments.split(), capfd, expected)


def test_messages_are_short_and_printable() -> None:
    assert one_line_message("a\n  b\x1b[31m\x00") == "a b\\x1b[31m\\x00"
    message = one_line_message(f"{'p' * 250}: {'long ' * 20}reason of it", " (see help)")
    assert message.endswith("reason of it (see help)")
    assert len(one_line_message("w" * 900 + " reason", " (see help)")) <= 300 - len("mirrorcam: ")


def test_a_null_character_is_refused() -> None:
    with pytest.raises(InputError, match="null character"):
        cli.parse(["cameras", "layout.json", "--out", "x\x00y"])


def _numbers(kind: Any) -> bool:
    return kind in (int, float) or any(map(_numbers, getattr(kind, "__args__", ())))


@pytest.mark.parametrize("command", cli.COMMANDS)
def test_the_range_of_every_number_is_in_its_help(command: str) -> None:
    for _, name, field in option_fields(cli.COMMANDS[command]):
        if _numbers(field.annotation):
            words = f"{field.description}"
            assert " to " in words, f"{command} {flag(name)}: {words}"


@pytest.mark.parametrize("command", cli.COMMANDS)
def test_a_number_of_no_range_is_refused(command: str, capfd: pytest.CaptureFixture[str]) -> None:
    for _, name, field in option_fields(cli.COMMANDS[command]):
        if _numbers(field.annotation):
            for number in ("1e308", "-1e308", "nan", "9" * 40):
                code = cli.main([command, "x", flag(name), *[number] * 5])
                assert code == 2, f"{flag(name)} {number}"
    assert all(len(line) <= 300 for line in capfd.readouterr().err.splitlines())
