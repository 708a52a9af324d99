"""What is wrong with a command line, in one line."""

from __future__ import annotations

import re
from collections.abc import Sequence
from difflib import get_close_matches

from cyclopts import CoercionError, CycloptsError, MissingArgumentError, UnknownCommandError, UnusedCliTokensError
from cyclopts import ValidationError as InvalidOption
from pydantic import ValidationError

from mirrorcam.core.causes import causes
from mirrorcam.core.messages import LONGEST_MESSAGE, one_line, shortened
from mirrorcam.core.values import InputError

LONGEST_VALUE = 80
_LONG_WORD = re.compile(rf"\S{{{LONGEST_VALUE + 1},}}")


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


def refusal(error: CycloptsError, commands: Sequence[str]) -> InputError:
    """The parser's error as bad input, with the command whose help explains more; `commands` are the names of all."""
    chain = tuple(error.command_chain or ())
    chain = chain if chain[:1] and chain[0] in commands else ()
    return InputError(one_line_message(_reason(error, commands), f" (see {' '.join(('mirrorcam', *chain))} --help)"))


def _reason(error: CycloptsError, commands: Sequence[str]) -> str:
    for cause in causes(error):
        if isinstance(cause, ValidationError):
            return _invalid(cause)
        if isinstance(cause, InputError):
            return str(cause)
    if isinstance(error, UnknownCommandError):
        given = next(iter(error.unused_tokens or ()), "")
        known = [name for name in error.app or () if not name.startswith("-")] if error.command_chain else commands
        meant = get_close_matches(given, known, n=1)
        expected = f", expected {', '.join(known)}" if error.command_chain else ""
        return f"unknown command {given!r}" + (f", did you mean {meant[0]}?" if meant else expected)
    if isinstance(error, MissingArgumentError) and error.argument is not None:
        name = error.argument.name
        return f"{name}: expected a value" if error.keyword else f"expected {name}"
    if isinstance(error, CoercionError) and error.argument is not None and error.token is not None:
        return f"{error.argument.name} {shortened(repr(error.token.value), LONGEST_VALUE)}: {str(error).rstrip('.')}"
    if isinstance(error, InvalidOption) and error.argument is not None and error.argument.tokens:
        value = shortened(repr(error.argument.tokens[0].value), LONGEST_VALUE)
        return f"{error.argument.name} {value}: {error.exception_message}"
    if isinstance(error, UnusedCliTokensError):
        return f"unknown argument {' '.join(error.unused_tokens or ())}"
    return str(error).rstrip(".")


def _invalid(error: ValidationError) -> str:
    """The first of pydantic's findings about the options of a command, with the option in place of the field."""
    first = error.errors(include_url=False)[0]
    if not first["loc"]:
        return one_line(error)
    option = f"--{str(first['loc'][0]).replace('_', '-')}"
    return f"{option} {shortened(repr(first['input']), LONGEST_VALUE)}: {first['msg'].removeprefix('Value error, ')}"
