"""Messages about a wrong command line, in one line."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from difflib import get_close_matches

import tyro
from pydantic import BaseModel
from pydantic.fields import FieldInfo

from mirrorcam.core.causes import causes
from mirrorcam.core.messages import LONGEST_MESSAGE, shortened
from mirrorcam.core.values import InputError, InvalidValue

Commands = Mapping[str, type[BaseModel]]
"""The options of each command by its name."""
LONGEST_VALUE = 80
_LONG_WORD = re.compile(rf"\S{{{LONGEST_VALUE + 1},}}")
_FRAME = re.compile(r"\x1b\[[0-9;]*m|[─│╭╮╰╯]+|-{20,}")
# Texts of help are indented further than what is missing.
_HELP_INDENT = 9


def one_line_message(message: str, hint: str = "") -> str:
    """A message in one line of printable characters, without the middle of long words and of what is still too long.

    The hint follows it in full.
    """
    line = " ".join(message.split())
    line = "".join(each if each.isprintable() else each.encode("unicode_escape").decode() for each in line)
    most = LONGEST_MESSAGE - len("mirrorcam: ") - len(hint)
    if len(line) > most:
        line = _LONG_WORD.sub(lambda word: shortened(word[0], LONGEST_VALUE), line)
    return shortened(line, most) + hint


def refusal(error: SystemExit, box: str, arguments: Sequence[str], commands: Commands) -> str:
    """The error that tyro reported, in one line: from its cause, else from the box that it printed."""
    for cause in causes(error):
        if isinstance(cause, InvalidValue):
            return _invalid(cause, commands)
        if isinstance(cause, InputError):
            return str(cause)
    return (_unknown(arguments, commands) if "nrecognized" in box else "") or _reason(box)


def option_fields(model: type[BaseModel]) -> Iterator[tuple[type[BaseModel], str, FieldInfo]]:
    """The fields of the options of a command, those of groups of options among them, each with its model."""
    for name, field in model.model_fields.items():
        group = field.annotation
        if isinstance(group, type) and issubclass(group, BaseModel) and tyro.conf.OmitArgPrefixes in field.metadata:
            yield from option_fields(group)
        elif tyro.conf.Suppress not in field.metadata:
            yield model, name, field


def flag(name: str) -> str:
    return "--" + name.replace("_", "-")


def _metavar(name: str, field: FieldInfo) -> str:
    """The placeholder of one value of an option in its help."""
    stated = next((mark.metavar for mark in field.metadata if getattr(mark, "metavar", None)), name.upper())
    return str(stated).strip("[]").removesuffix("...")


def _invalid(error: InvalidValue, commands: Commands) -> str:
    """What is wrong with the value of an option, by the first of pydantic's findings."""
    detail, reason = error.first, error.reason
    if detail is None or not detail["loc"]:
        return reason
    name = str(detail["loc"][0])
    fields = (each for model in commands.values() for each in option_fields(model))
    field = next((field for owner, own, field in fields if own == name and owner.__name__ == error.title), None)
    positional = field is not None and tyro.conf.Positional in field.metadata
    option = _metavar(name, field) if positional and field is not None else flag(name)
    if detail["type"] == "too_short":
        return f"expected at least one {option}" if positional else f"{option}: expected at least one value"
    if detail["type"] == "too_long":
        count, most = detail["ctx"]["actual_length"], detail["ctx"]["max_length"]
        return f"{option}: {count} values, expected {most} or fewer"
    return f"{option} {shortened(repr(detail['input']), LONGEST_VALUE)}: {reason}"


def _unknown(arguments: Sequence[str], commands: Commands) -> str:
    """The first argument that is no command or no option of the command, with what may have been meant; or nothing."""
    command = next((argument for argument in arguments if not argument.startswith("-")), "")
    if command not in commands:
        known, tried = list(commands), [command]
    else:
        known = ["--debug", "--help", *(flag(name) for _, name, _ in option_fields(commands[command]))]
        given = (argument.partition("=")[0].replace("_", "-") for argument in arguments)
        tried = [each for each in given if each.startswith("--") and each not in known]
    if not tried or not tried[0]:
        return ""
    meant = get_close_matches(tried[0], known, n=1)
    return f"Unrecognized options: {tried[0]}" + (f", did you mean {meant[0]}?" if meant else "")


def _choices(found: re.Match[str]) -> str:
    """What may be chosen, which tyro prints as a tuple, without the None of an option that was not given."""
    names = [name.strip().strip("'\"") for name in found[1].split(",")]
    return f", expected one of {', '.join(sorted(name for name in names if name not in ('', 'None')))}"


def _reason(box: str) -> str:
    """The first paragraph of a box that tyro printed, without its frame, its title and texts of help."""
    paragraph: list[str] = []
    for line in box.splitlines()[1:]:
        text = _FRAME.sub("", line)
        if text.strip() and len(text) - len(text.lstrip()) < _HELP_INDENT:
            paragraph.append(text.strip())
        elif not text.strip() and paragraph:
            break
    reason = " ".join(paragraph).rstrip(".")
    reason = re.sub(r" \(applied to [^)]*\)", "", reason)
    reason = re.sub(r"\. Expected one of \(([^()]*)\)", _choices, reason)
    return re.sub(r"no type matching (?:\{None\}\|)?(\S+) could be instantiated from", r"expected \1, not", reason)
