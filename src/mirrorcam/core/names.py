"""Names that people give to cameras and materials: what they may be, and how each kind of file takes them as text.

Names come from files of other people. In HTML and XML the writers of those formats escape it.
"""

from __future__ import annotations

import html
import re
from typing import Annotated

from pydantic import AfterValidator, Field

LONGEST = 100
"""Characters of the longest name."""
_MARKDOWN = re.compile(r"[\\`*_\[\]|~#$]")
_FORMULA = ("=", "+", "-", "@", "\uff1d", "\uff0b", "\uff0d", "\uff20", "\t", "\r", "\n")  # \uff..: full-width


def _printable(name: str) -> str:
    if not name.isprintable():
        raise ValueError("holds a character that cannot be printed, expected a name in one line")
    return name


Name = Annotated[str, Field(max_length=LONGEST), AfterValidator(_printable)]
"""A name in a file: printable, in one line."""

Line = Annotated[str, Field(max_length=500), AfterValidator(_printable)]
"""A longer text in a file: printable, in one line."""

Link = Annotated[str, Field(max_length=LONGEST, pattern=r"^[A-Za-z0-9_]+([/.-][A-Za-z0-9_]+)*$")]
"""The name of a link of a robot, which URDF and xacro take as it is."""


def markdown_text(text: str) -> str:
    """Return a text as Markdown that shows it as it is: without tags, links, emphasis or cells of a table."""
    return _MARKDOWN.sub(r"\\\g<0>", html.escape(text, quote=False))


def spreadsheet_text(text: str) -> str:
    """Return a text as a cell of CSV that no spreadsheet takes for a formula: with ' before what would begin one."""
    return f"'{text}" if text.startswith(_FORMULA) else text


def word(text: str) -> str:
    """Return a text as one word, for files whose fields end at a blank: _ for blanks and what cannot be printed."""
    return "".join("_" if char.isspace() or not char.isprintable() else char for char in text)
