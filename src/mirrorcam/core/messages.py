"""One-line messages, also for pydantic's validation errors."""

from __future__ import annotations

from difflib import get_close_matches
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pydantic import BaseModel, ValidationError

LONGEST_MESSAGE = 300


def shortened(text: str, max_length: int = LONGEST_MESSAGE) -> str:
    """Cut the middle out of a text longer than `max_length`."""
    return text if len(text) <= max_length else f"{text[: max_length * 2 // 3]} ... {text[-max_length // 4 :]}"


def _known_names(schema: Any) -> set[str]:
    """Return the names of all fields in the JSON schema of a model."""
    if isinstance(schema, dict):
        own = set(schema["properties"]) if isinstance(schema.get("properties"), dict) else set()
        return own.union(*map(_known_names, schema.values()))
    return set().union(*map(_known_names, schema)) if isinstance(schema, list) else set()


def one_line(error: ValidationError, model: type[BaseModel] | None = None) -> str:
    """Format the first of pydantic's findings, its location, and the number of others in one line.

    An unknown key takes precedence, and the closest key of `model` is suggested.
    """
    details = error.errors(include_url=False)
    first = next((item for item in details if item["type"] == "extra_forbidden"), details[0])
    location = ".".join(str(part) for part in first["loc"])
    message = first["msg"].removeprefix("Value error, ")
    if first["type"] == "extra_forbidden":
        names = _known_names(model.model_json_schema()) if model is not None else set()
        key = str(first["loc"][-1])
        matches = get_close_matches(key, sorted(names), n=1) if key not in names else []
        message = f"not known, did you mean {matches[0]}?" if matches else "not known"
    if first["type"] == "union_tag_not_found":
        message = f"{first['ctx']['discriminator']} is missing"
    if first["type"] == "union_tag_invalid":
        context = first["ctx"]
        message = f"{context['discriminator']} is {context['tag']!r}, expected one of {context['expected_tags']}"
    more = f" (and {len(details) - 1} more)" if len(details) > 1 else ""
    text = f"{location}: {message}{more}" if location else f"{message}{more}"
    return shortened(" ".join(text.split()))
