"""Names and numbers as text: what names may be, and how each kind of file and of drawn page takes them.

Names come from files of other people. In HTML and XML the writers of those formats escape it.
"""

from __future__ import annotations

import html
import re
from collections.abc import Callable, Container, Iterable
from typing import Annotated

from pydantic import AfterValidator, Field

from mirrorcam.core.values import FloatArray

LONGEST = 100
"""Characters of the longest name."""
_MARKDOWN = re.compile(r"[\\`*_\[\]|~#$]")
_FORMULA = ("=", "+", "-", "@", "\uff1d", "\uff0b", "\uff0d", "\uff20", "\t", "\r", "\n")  # \uff..: full-width
Link = Annotated[str, Field(max_length=LONGEST, pattern=r"^[A-Za-z0-9_]+([/.-][A-Za-z0-9_]+)*$")]
"""The name of a link of a robot, which URDF and xacro take as it is."""
MISSING = "\N{REPLACEMENT CHARACTER}"


def _printable(name: str) -> str:
    if not name.isprintable():
        raise ValueError("holds a character that cannot be printed, expected a name in one line")
    return name


Name = Annotated[str, Field(max_length=LONGEST), AfterValidator(_printable)]
"""A name in a file: printable, in one line."""


Line = Annotated[str, Field(max_length=500), AfterValidator(_printable)]
"""A longer text in a file: printable, in one line."""


def markdown_text(text: str) -> str:
    """Return a text as Markdown that shows it as it is: without tags, links, emphasis or cells of a table."""
    return _MARKDOWN.sub(r"\\\g<0>", html.escape(text, quote=False))


def spreadsheet_text(text: str) -> str:
    """Return a text as a cell of CSV that no spreadsheet takes for a formula: with ' before what would begin one."""
    return f"'{text}" if text.startswith(_FORMULA) else text


def word(text: str) -> str:
    """Return a text as one word, for files whose fields end at a blank: _ for blanks and what cannot be printed."""
    return "".join("_" if char.isspace() or not char.isprintable() else char for char in text)


def number(value: float) -> str:
    """The shortest text that reads back to the bit, with a point, and without a negative zero.

    YAML 1.1 takes `1e-05` for a string: PyYAML, and Kalibr with it, would read it as one.
    """
    text = repr(float(value) + 0.0)
    mantissa, exponent, power = text.partition("e")
    return f"{mantissa if '.' in mantissa else mantissa + '.0'}{exponent}{power}"


def numbers(values: Iterable[float] | FloatArray, separator: str = ", ") -> str:
    """Several numbers in one line."""
    return separator.join(number(value) for value in values)


def drawable(text: str, glyphs: Container[int]) -> str:
    """Return a text with a mark in place of each character that the font lacks or that is not printable."""
    return "".join(char if char.isprintable() and ord(char) in glyphs else MISSING for char in text)


def fitted(text: str, width: float, width_of: Callable[[str], float]) -> str:
    """Return a text, cut and ended by "..." where it is wider than `width`."""
    kept, end = text, ""
    while kept and width_of(kept + end) > width:
        kept, end = kept[:-1], "..."
    return kept + end
