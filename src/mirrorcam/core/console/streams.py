"""Make standard output and error print any text, even if the terminal or locale lacks characters."""

from __future__ import annotations

import codecs
import logging
import sys
from io import TextIOWrapper

_PLAIN = {
    **{"\N{DEGREE SIGN}": "deg", "\N{MULTIPLICATION SIGN}": "x", "\N{PLUS-MINUS SIGN}": "+-"},
    **{"\N{MICRO SIGN}": "u", "\N{GREEK SMALL LETTER MU}": "u", "\N{GREEK SMALL LETTER SIGMA}": "sigma"},
    **{"\N{SUPERSCRIPT TWO}": "^2", "\N{SUPERSCRIPT THREE}": "^3", "\N{MINUS SIGN}": "-", "\N{EN DASH}": "-"},
    **{"\N{LESS-THAN OR EQUAL TO}": "<=", "\N{GREATER-THAN OR EQUAL TO}": ">=", "\N{HORIZONTAL ELLIPSIS}": "..."},
}
_ERRORS = "mirrorcam_plain"


def _plain(error: UnicodeError) -> tuple[str | bytes, int]:
    """Replace a character that a stream cannot encode by an ASCII spelling, else by its number."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    character = error.object[error.start]
    spelling = _PLAIN.get(character) or character.encode("ascii", "backslashreplace").decode("ascii")
    return spelling, error.start + 1


def quieten_libraries() -> None:
    """Suppress messages of libraries on standard error: matplotlib's on fonts and configuration folders."""
    logging.getLogger("matplotlib").setLevel(logging.ERROR)


def make_readable() -> None:
    """Make both streams replace characters that they cannot encode."""
    codecs.register_error(_ERRORS, _plain)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors=_ERRORS)
