"""Docstrings of the library for Sphinx: fields of frozen values as parameters, with what the models state of them."""

from __future__ import annotations

import re
from typing import Any

from docutils import nodes
from pydantic import BaseModel
from pydantic_core import PydanticUndefined
from sphinx.application import Sphinx
from sphinx.util.docstrings import prepare_docstring

BEFORE_NAPOLEON, AFTER_NAPOLEON = 100, 900
ALIAS = re.compile(r"TypeAliasForwardRef\('(\w+)'\)")
ANNOTATED = re.compile(r"Annotated\[(\w+), [^\]]*\]")

STATED = re.compile(r"(\w+(?:, \w+)*) : (.*)")
SECTIONS = ("Parameters", "Attributes", "Raises")


def stated_below(lines: list[str]) -> list[str]:
    """Lines of a docstring in which `name : what it is.` has its text below it, where napoleon looks for no type."""
    found: list[str] = []
    section = ""
    for number, line in enumerate(lines):
        following = lines[number + 1] if number + 1 < len(lines) else ""
        if following.strip("-") == "" and following:
            section = line
        stated = STATED.fullmatch(line)
        if section in SECTIONS and stated and line.endswith(".") and not following.startswith(" "):
            found += [stated[1], f"    {stated[2]}"]
        else:
            found.append(line)
    return found


def field_lines(model: type[BaseModel]) -> list[str]:
    """A section "Parameters" in NumPy's style of the fields of a model."""
    lines = ["", "Parameters", "----------"]
    for name, field in model.model_fields.items():
        written = next(each.__annotations__[name] for each in model.__mro__ if name in vars(each)["__annotations__"])
        default = "" if field.default in (PydanticUndefined, None) else f", default {field.default!r}"
        kind = ANNOTATED.sub(r"\1", str(written))
        lines += [f"{field.alias or name} : {kind}{default}"]
        lines += [f"    {field.description}"] if field.description else []
    return lines


def _describe(app: Sphinx, what: str, name: str, found: Any, options: Any, lines: list[str]) -> None:
    lines[:] = stated_below(lines)
    if what == "class" and "Attributes" in lines:
        # What a frozen value holds is what it is made of.
        lines[lines.index("Attributes")] = "Parameters"
    elif what == "class" and issubclass(found, BaseModel):
        lines += field_lines(found)
    # Docstrings write `names` in Markdown's way, which is italic text in that of Sphinx.
    lines[:] = [re.sub(r"(?<![`:])`([^`]+)`(?!`)", r"``\1``", line) for line in lines]


def _restore(app: Sphinx, what: str, name: str, found: Any, options: Any, lines: list[str]) -> None:
    """Undo what napoleon makes of a property whose text has a colon: it takes what stands before it for the type."""
    if what == "property":
        lines[:] = prepare_docstring(found.__doc__ or "")
        _describe(app, what, name, found, options, lines)


def _sign(
    app: Sphinx, what: str, name: str, found: Any, options: Any, signature: str | None, returns: str | None
) -> tuple[str | None, str | None]:
    if what == "class" and issubclass(found, BaseModel):
        return "(**fields)", None
    # Inside other types, names of types are left as Sphinx holds them.
    return signature and ALIAS.sub(r"\1", signature), returns and ALIAS.sub(r"\1", returns)


def _dashes(app: Sphinx, doctree: nodes.document) -> None:
    """What Sphinx writes between a type and its text becomes a dash: elsewhere two hyphens begin an option."""
    for text in [text for text in doctree.findall(nodes.Text) if text.startswith(" -- ")]:
        text.parent.replace(text, nodes.Text(f" \N{EN DASH} {text.removeprefix(' -- ')}"))


def setup(app: Sphinx) -> dict[str, Any]:
    """Come before napoleon, which turns sections into fields, and once more after it."""
    app.connect("autodoc-process-docstring", _describe, priority=BEFORE_NAPOLEON)
    app.connect("autodoc-process-docstring", _restore, priority=AFTER_NAPOLEON)
    app.connect("autodoc-process-signature", _sign)
    app.connect("doctree-read", _dashes)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
