"""Docstrings of frozen values: their fields as parameters, with the descriptions and ranges that the models state."""

from __future__ import annotations

import re
from typing import Any

from pydantic import BaseModel
from pydantic_core import PydanticUndefined
from sphinx.application import Sphinx
from sphinx.util.inspect import stringify_annotation

SECTION = re.compile(r"^(Parameters|Attributes)$")


def field_lines(model: type[BaseModel]) -> list[str]:
    """A section "Parameters" in NumPy's style of the fields of a model."""
    lines = ["", "Parameters", "----------"]
    for name, field in model.model_fields.items():
        kind = stringify_annotation(field.annotation, "smart").replace("~", "")
        kind = re.sub(r"[a-z_]+(?:\.[a-z_]+)*\.(?=[A-Z])", "", kind)
        default = "" if field.default in (PydanticUndefined, None) else f"; default {field.default!r}"
        lines += [f"{field.alias or name} : {kind}{default}", f"    {field.description or ''}".rstrip()]
    return lines


def _describe(app: Sphinx, what: str, name: str, found: Any, options: Any, lines: list[str]) -> None:
    if what == "class" and issubclass(found, BaseModel) and not any(map(SECTION.match, lines)):
        lines += field_lines(found)
    # Docstrings write `names` in Markdown's way, which is italic text in that of Sphinx.
    lines[:] = [re.sub(r"(?<![`:])`([^`]+)`(?!`)", r"``\1``", line) for line in lines]


def _sign(app: Sphinx, what: str, name: str, found: Any, *rest: Any) -> tuple[str, None] | None:
    if what == "class" and issubclass(found, BaseModel):
        return "(**fields)", None
    return None


def setup(app: Sphinx) -> dict[str, Any]:
    """Come before napoleon, which turns sections into fields."""
    app.connect("autodoc-process-docstring", _describe, priority=100)
    app.connect("autodoc-process-signature", _sign)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
