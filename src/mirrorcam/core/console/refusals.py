"""Parser errors of the command line as one-line messages."""

from __future__ import annotations

import re
from collections.abc import Sequence
from difflib import get_close_matches
from typing import TYPE_CHECKING, Any, Literal, get_args, get_origin

from cyclopts import (
    CoercionError,
    CycloptsError,
    MissingArgumentError,
    UnknownCommandError,
    UnusedCliTokensError,
    ValidationError,
)
from cyclopts.annotations import get_hint_name
from cyclopts.argument import Argument

from mirrorcam.core.causes import causes
from mirrorcam.core.errors import InputError
from mirrorcam.core.messages import LONGEST_MESSAGE, one_line, shortened

if TYPE_CHECKING:
    from pydantic import ValidationError as PydanticError

LONGEST_VALUE = 80
_LONG_WORD = re.compile(rf"\S{{{LONGEST_VALUE + 1},}}")


def one_line_message(message: str, hint: str = "") -> str:
    """Format a message as one line of printable characters; long words and texts are cut in the middle.

    The hint that follows is never cut.
    """
    line = " ".join(message.split())
    line = "".join(char if char.isprintable() else char.encode("unicode_escape").decode() for char in line)
    max_length = LONGEST_MESSAGE - len("mirrorcam: ") - len(hint)
    if len(line) > max_length:
        line = _LONG_WORD.sub(lambda word: shortened(word[0], LONGEST_VALUE), line)
    return shortened(line, max_length) + hint


def refusal(error: CycloptsError, commands: Sequence[str]) -> InputError:
    """Convert a parser's error to an InputError that names the relevant help; `commands` are all command names."""
    chain = tuple(error.command_chain or ())
    chain = chain if chain[:1] and chain[0] in commands else ()
    return InputError(one_line_message(_reason(error, commands), f" (see {' '.join(('mirrorcam', *chain))} --help)"))


def _reason(error: CycloptsError, commands: Sequence[str]) -> str:
    from pydantic import ValidationError as PydanticError

    for cause in causes(error):
        if isinstance(cause, PydanticError):
            return _described_finding(cause, error.argument)
        if isinstance(cause, InputError):
            return str(cause)
    if isinstance(error, UnknownCommandError):
        unknown = next(iter(error.unused_tokens or ()), "")
        names = [name for name in error.app or () if not name.startswith("-")] if error.command_chain else commands
        matches = get_close_matches(unknown, names, n=1)
        expected = f", expected {', '.join(names)}" if error.command_chain else ""
        return f"unknown command {unknown!r}" + (f", did you mean {matches[0]}?" if matches else expected)
    if isinstance(error, MissingArgumentError) and error.argument is not None:
        name = error.argument.name
        return f"{name}: expected a value" if error.keyword else f"expected {name}"
    if isinstance(error, CoercionError) and error.argument is not None and error.token is not None:
        return f"{_described_option(error.argument, error.token.value)}: expected {_described_type(error.target_type)}"
    if isinstance(error, ValidationError) and error.argument is not None and error.argument.tokens:
        values = " ".join(token.value for token in error.argument.tokens)
        return f"{_described_option(error.argument, values)}: {error.exception_message}"
    if isinstance(error, UnusedCliTokensError):
        return f"unknown argument {' '.join(error.unused_tokens or ())}"
    return str(error).rstrip(".")


def _described_type(kind: Any) -> str:
    """Describe the values of a type: its choices, or its name."""
    if get_origin(kind) is Literal:
        return f"one of {', '.join(get_args(kind))}" if len(get_args(kind)) > 1 else str(get_args(kind)[0])
    if inner := [member for member in get_args(kind) if member is not type(None)]:
        return " or ".join(map(_described_type, inner))
    return get_hint_name(kind).upper()


def _described_option(argument: Argument, value: object) -> str:
    """Describe an option with its value and, unless it is the command line, its source."""
    source = next((token.source for token in argument.tokens if token.source not in ("", "cli")), "")
    origin = {"": "", "env": " of the environment"}.get(source, f" of {source}")
    return f"{argument.name} {shortened(repr(value), LONGEST_VALUE)}{origin}"


def _described_finding(error: PydanticError, argument: Argument | None) -> str:
    """Describe the first of pydantic's findings about a command's options, with the option in place of the field."""
    first = error.errors(include_url=False)[0]
    if not first["loc"]:
        return one_line(error)
    cause = first.get("ctx", {}).get("error")
    if isinstance(cause, InputError):
        return str(cause)
    option = f"--{str(first['loc'][0]).replace('_', '-')}"
    if first["type"] == "too_short":
        return f"{option}: expected at least one value"
    if first["type"] == "too_long":
        context = first["ctx"]
        return f"{option}: {context['actual_length']} values, expected {context['max_length']} or fewer"
    own = next((child for child in argument.children if child.name == option), None) if argument is not None else None
    value = first["input"]
    described = (
        _described_option(own, value) if own is not None else f"{option} {shortened(repr(value), LONGEST_VALUE)}"
    )
    return f"{described}: {first['msg'].removeprefix('Value error, ')}"
