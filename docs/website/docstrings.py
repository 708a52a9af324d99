"""Docstrings of the library for Sphinx: fields of frozen values as parameters, with their descriptions."""

from __future__ import annotations

import re
from typing import Any

from docutils import nodes
from pydantic import BaseModel
from sphinx.application import Sphinx
from sphinx.util.docstrings import prepare_docstring

BEFORE_NAPOLEON, AFTER_NAPOLEON = 100, 900
ALIAS = re.compile(r"TypeAliasForwardRef\('(\w+)'\)")

NAME_AND_TEXT = re.compile(r"(\w+(?:, \w+)*) : (.*)")
SECTIONS = ("Parameters", "Attributes", "Raises")


def with_text_below(lines: list[str]) -> list[str]:
    """Lines of a docstring, with the text of `name : text.` below the name: napoleon would take it for a type."""
    result: list[str] = []
    section = ""
    for number, line in enumerate(lines):
        next_line = lines[number + 1] if number + 1 < len(lines) else ""
        if next_line.strip("-") == "" and next_line:
            section = line
        match = NAME_AND_TEXT.fullmatch(line)
        if section in SECTIONS and match and line.endswith(".") and not next_line.startswith(" "):
            result += [match[1], f"    {match[2]}"]
        else:
            result.append(line)
    return result


def _describe(app: Sphinx, kind: str, name: str, value: Any, options: Any, lines: list[str]) -> None:
    lines[:] = with_text_below(lines)
    if kind == "class" and "Attributes" in lines:
        # The attributes of a frozen value are the parameters of its constructor.
        lines[lines.index("Attributes")] = "Parameters"
    # Docstrings mark `names` as in Markdown, which Sphinx would set in italics.
    lines[:] = [re.sub(r"(?<![`:])`([^`]+)`(?!`)", r"``\1``", line) for line in lines]


def _restore(app: Sphinx, kind: str, name: str, value: Any, options: Any, lines: list[str]) -> None:
    """Restore the text of a property with a colon: napoleon takes the words before the colon for the type."""
    if kind == "property":
        lines[:] = prepare_docstring(value.__doc__ or "")
        _describe(app, kind, name, value, options, lines)


def _sign(
    app: Sphinx, kind: str, name: str, value: Any, options: Any, signature: str | None, returns: str | None
) -> tuple[str | None, str | None]:
    if kind == "class" and issubclass(value, BaseModel):
        return "(**fields)", None
    # Replace the aliases that Sphinx leaves inside other types by their names.
    return signature and ALIAS.sub(r"\1", signature), returns and ALIAS.sub(r"\1", returns)


def _dashes(app: Sphinx, doctree: nodes.document) -> None:
    """Replace the two hyphens that Sphinx puts between a type and its text by a dash: two hyphens begin an option."""
    for text in [text for text in doctree.findall(nodes.Text) if text.startswith(" -- ")]:
        text.parent.replace(text, nodes.Text(f" \N{EN DASH} {text.removeprefix(' -- ')}"))


def setup(app: Sphinx) -> dict[str, Any]:
    """Process docstrings before napoleon, which turns sections into fields, and once more after it."""
    app.connect("autodoc-process-docstring", _describe, priority=BEFORE_NAPOLEON)
    app.connect("autodoc-process-docstring", _restore, priority=AFTER_NAPOLEON)
    app.connect("autodoc-process-signature", _sign)
    app.connect("doctree-read", _dashes)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
