"""Names and numbers as text: valid names, and their form in each kind of file and drawing.

Names come from untrusted files. Writers of HTML and XML escape them.
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
"""The name of a robot's link, valid in URDF and xacro without escaping."""
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
    """Escape text for Markdown, so that it contains no tags, links, emphasis or table cells."""
    return _MARKDOWN.sub(r"\\\g<0>", html.escape(text, quote=False))


def anchor_of(heading: str) -> str:
    """The anchor of a heading in Markdown, by the rule of GitHub: lower case, hyphens for spaces, no punctuation."""
    return re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-")


def spreadsheet_text(text: str) -> str:
    """Escape a text for a CSV cell: ' precedes a text that spreadsheets would evaluate as a formula."""
    return f"'{text}" if text.startswith(_FORMULA) else text


def word(text: str) -> str:
    """Return a text as one word, with _ for blanks and unprintable characters."""
    return "".join("_" if char.isspace() or not char.isprintable() else char for char in text)


def number(value: float) -> str:
    """Return the shortest text that is parsed exactly, with a decimal point, and without a negative zero.

    In YAML 1.1, and therefore in PyYAML and Kalibr, `1e-05` is a string.
    """
    text = repr(float(value) + 0.0)
    mantissa, exponent, power = text.partition("e")
    return f"{mantissa if '.' in mantissa else mantissa + '.0'}{exponent}{power}"


def numbers(values: Iterable[float] | FloatArray, separator: str = ", ") -> str:
    """Return several numbers in one line."""
    return separator.join(number(value) for value in values)


def drawable(text: str, glyphs: Container[int]) -> str:
    """Replace each character that is unprintable or missing in the font."""
    return "".join(char if char.isprintable() and ord(char) in glyphs else MISSING for char in text)


def fitted(text: str, width: float, width_of: Callable[[str], float]) -> str:
    """Cut a text wider than `width`, and end it with "..."."""
    start, end = text, ""
    while start and width_of(start + end) > width:
        start, end = start[:-1], "..."
    return start + end
