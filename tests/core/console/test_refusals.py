"""What is wrong with a command line takes one short line, and every number has a range that its help states."""

from __future__ import annotations

from typing import Any, get_args

import pytest
from cyclopts import App
from cyclopts.argument import Argument

from docs.website.command_pages import commands
from mirrorcam import cli
from mirrorcam.core.console.refusals import one_line_message
from tests.command_line import assert_refused_here


def test_messages_are_short_and_printable() -> None:
    assert one_line_message("a\n  b\x1b[31m\x00") == "a b\\x1b[31m\\x00"
    message = one_line_message(f"{'p' * 250}: {'long ' * 20}reason of it", " (see help)")
    assert message.endswith("reason of it (see help)")
    assert len(one_line_message("w" * 900 + " reason", " (see help)")) <= 300 - len("mirrorcam: ")


@pytest.mark.parametrize(
    "arguments", [f"design --rows {'x' * 900}", f"design --{'y' * 900}", f"sweep --table {'z' * 900}", "a" * 900]
)
@pytest.mark.parametrize("encoding", ["utf-8", "ascii"])
def test_a_refusal_of_long_arguments_is_short(
    arguments: str, encoding: str, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("PYTHONIOENCODING", encoding)
    assert cli.main(arguments.split()) == 2
    refused = capfd.readouterr().err
    assert refused.count("\n") == 1
    assert len(refused) <= 301


def options(command: App) -> list[Argument]:
    """The arguments and options of a command or subcommand."""
    found = command.assemble_argument_collection() if command.default_command is not None else ()
    return [each for each in found if not each.children]


def is_number(kind: Any) -> bool:
    return kind in (int, float) or any(map(is_number, get_args(kind)))


def required(command: App) -> list[str]:
    """What a command needs: its arguments, and options with values of their choices, if they have any."""
    needed = [each for each in options(command) if each.required]
    words = ["x" for each in needed if each.index is not None]
    for each in (each for each in needed if each.index is None):
        words += [each.name, *map(str, get_args(each.hint)[:1] or "x")]
    return words


@pytest.mark.parametrize("name", cli.NAMES)
def test_every_number_has_a_range_in_its_help_and_is_refused_beyond(
    name: str, capfd: pytest.CaptureFixture[str]
) -> None:
    for words, command in commands(cli.application(), [name]).items():
        for option in (each for each in options(command) if is_number(each.hint)):
            assert " to " in (option.parameter.help or ""), f"{words} {option.name}"
            count, _ = option.token_count()
            for number in ("1e308", "-1e308", "nan", "9" * 40):
                arguments = [*words.split(), *required(command), option.name, *[number] * count]
                assert_refused_here(arguments, capfd, option.name)
