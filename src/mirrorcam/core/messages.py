"""One-line messages, also for pydantic's validation errors."""

from __future__ import annotations

import re
from collections.abc import Sequence
from difflib import get_close_matches
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pydantic import BaseModel, ValidationError

LONGEST_MESSAGE = 300
_BRANCH = re.compile(r"\[.*\]|^constrained-|^(int|float|str|bool)$")


def shortened(text: str, max_length: int = LONGEST_MESSAGE) -> str:
    """Cut the middle out of a text longer than `max_length`."""
    return text if len(text) <= max_length else f"{text[: max_length * 2 // 3]} ... {text[-max_length // 4 :]}"


def _known_names(schema: Any) -> set[str]:
    """Return the names of all fields in the JSON schema of a model."""
    if isinstance(schema, dict):
        own = set(schema["properties"]) if isinstance(schema.get("properties"), dict) else set()
        return own.union(*map(_known_names, schema.values()))
    return set().union(*map(_known_names, schema)) if isinstance(schema, list) else set()


def _location(parts: Sequence[int | str]) -> str:
    """Return the dotted location of a finding, without the branches of unions such as constrained-float."""
    return ".".join(str(part) for part in parts if not _BRANCH.search(str(part)))


def one_line(error: ValidationError, model: type[BaseModel] | None = None) -> str:
    """Format the first of pydantic's findings, its location, and the number of others in one line.

    Another schema takes precedence, then an unknown key, for which the closest key of `model` is suggested.
    """
    # A default that depends on an invalid field is no finding of its own.
    details = [item for item in error.errors(include_url=False) if item["type"] != "default_factory_not_called"]
    schemas = [item for item in details if item["loc"][-1:] == ("schema",) and item["type"] == "literal_error"]
    details = schemas or details
    first = next((item for item in details if item["type"] == "extra_forbidden"), details[0])
    locations = {_location(item["loc"]) for item in details}
    location = _location(first["loc"])
    message = first["msg"].removeprefix("Value error, ")
    given = type(first["input"]).__name__
    if first["type"] == "extra_forbidden":
        names = sorted(_known_names(model.model_json_schema())) if model is not None else []
        key = str(first["loc"][-1])
        longer = [name for name in names if name.startswith(f"{key}_")]
        matches = longer or get_close_matches(key, names, n=1) if key not in names else []
        message = f"not known, did you mean {matches[0]}?" if matches else "not known"
    if schemas:
        message = f"{first['input']!r}, expected {first['ctx']['expected']}"
    if first["type"] == "model_type" and "instance of" in message:
        message = f"{given}, expected {first['ctx']['class_name']} or a table of its fields"
    if first["type"] == "path_type":
        message = f"{given}, expected str or os.PathLike[str]"
    if first["type"] == "union_tag_not_found":
        message = f"{first['ctx']['discriminator']} is missing"
    if first["type"] == "union_tag_invalid":
        context = first["ctx"]
        message = f"{context['discriminator']} is {context['tag']!r}, expected one of {context['expected_tags']}"
    more = f" (and {len(locations) - 1} more)" if len(locations) > 1 else ""
    text = f"{location}: {message}{more}" if location else f"{message}{more}"
    return shortened(" ".join(text.split()))
