"""Parse untrusted YAML into plain values, within limits.

Values are built from the event stream of PyYAML's parser, so a document that is nested too deep or too large is
refused early. Unquoted scalars follow YAML 1.2: no times, no base-60 numbers.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from mirrorcam.core.disk.nested_text import PARSER_ERRORS, integer_of, reason_of
from mirrorcam.core.errors import InputError
from mirrorcam.core.messages import shortened

YAML_SUFFIXES = (".yaml", ".yml")
MAX_DEPTH = 32
MAX_VALUES = 300_000
"""Limit on the values of a file; each use of an alias counts all its values."""
OPENCV_TAGS = frozenset(f"tag:yaml.org,2002:opencv-{kind}" for kind in ("matrix", "nd-matrix"))
"""OpenCV's matrices, read as mappings."""
# PyYAML's wheels include libyaml, which is much faster.
_LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
_OPENCV_HEAD = "%YAML:1.0"
_TAG_DIRECTIVE = re.compile(r"^%TAG", re.MULTILINE)
_NAMED_SCALARS: dict[str, Any] = {
    **dict.fromkeys(("", "~", "null", "Null", "NULL"), None),
    **dict.fromkeys(("true", "True", "TRUE"), True),
    **dict.fromkeys(("false", "False", "FALSE"), False),
    **{f"{sign}.{name}": float(f"{sign}inf") for sign in ("", "+", "-") for name in ("inf", "Inf", "INF")},
    **dict.fromkeys((".nan", ".Nan", ".NaN", ".NAN"), float("nan")),
}
_INTEGER = re.compile(r"[-+]?[0-9]+")
_FLOAT = re.compile(r"[-+]?(?:\.[0-9]++|[0-9]++(?:\.[0-9]*+)?)(?:[eE][-+]?[0-9]++)?")
_NO_KEY = object()


def yaml_of(where: Path | str, raw: bytes) -> Any:
    """Content of a YAML text of one document; raises a one-line InputError, which names `where`."""
    try:
        documents = yaml_documents(raw.decode("utf-8-sig"))
    except UnicodeDecodeError as error:
        raise InputError(f"{where}: not valid YAML: byte {error.start} is not UTF-8 text") from None
    except InputError as error:
        raise InputError(shortened(f"{where}: {error}")) from None
    if len(documents) > 1:
        raise InputError(f"{where}: {len(documents)} documents, expected one")
    return documents[0] if documents else None


def yaml_documents(text: str) -> list[Any]:
    """Content of all documents of a text; raises InputError for anything but plain values."""
    if text.startswith(_OPENCV_HEAD):  # invalid YAML
        text = text.partition("\n")[2]
    if _TAG_DIRECTIVE.search(text):  # PyYAML takes quadratic time for many of them
        raise InputError("not valid YAML: a %TAG directive, expected plain values")
    composer = _Composer()
    try:
        for event in yaml.parse(text, Loader=_LOADER):
            composer.take(event)
    except InputError:
        raise
    except (yaml.YAMLError, *PARSER_ERRORS) as error:
        raise InputError(f"not valid YAML: {reason_of(error)}") from None
    return composer.documents


@dataclass
class _Open:
    """An open list or mapping, the count of values at its start, and the key whose value comes next."""

    value: dict[str, Any] | list[Any]
    anchor: str | None
    count_at_start: int
    key: Any = _NO_KEY


class _Composer:
    """Builds values from the parser's events."""

    def __init__(self) -> None:
        self.documents: list[Any] = []
        self._open: list[_Open] = []
        self._anchors: dict[str, tuple[Any, int]] = {}
        self._count = 0

    def take(self, event: yaml.Event) -> None:
        """Process the next event; raises InputError for anything but plain values."""
        if isinstance(event, yaml.ScalarEvent):
            self._count_values(1)
            if event.tag is not None:
                raise _refusal(f"a tag {event.tag[:60]!r}, expected none", event)
            self._put(event.value if self._at_key else _scalar(event), event)
        elif isinstance(event, yaml.CollectionStartEvent):
            self._count_values(1)
            if len(self._open) >= MAX_DEPTH:
                raise _refusal(f"nested deeper than {MAX_DEPTH}", event)
            if event.tag is not None and event.tag not in OPENCV_TAGS:
                raise _refusal(f"a tag {event.tag[:60]!r}, expected none", event)
            value: dict[str, Any] | list[Any] = {} if isinstance(event, yaml.MappingStartEvent) else []
            self._open.append(_Open(value, event.anchor, self._count))
        elif isinstance(event, yaml.CollectionEndEvent):
            closed = self._open.pop()
            self._put(closed.value, event, closed.anchor, self._count - closed.count_at_start + 1)
        elif isinstance(event, yaml.AliasEvent):
            if event.anchor not in self._anchors:
                raise _refusal(f"an alias {event.anchor[:40]!r} without an anchor before it", event)
            value, size = self._anchors[event.anchor]
            self._count_values(size)
            self._put(value, event)
        elif isinstance(event, yaml.DocumentStartEvent):
            self._count_values(1)
            self._anchors = {}

    @property
    def _at_key(self) -> bool:
        """Whether a key comes next. Keys remain strings: crafted integers could all collide."""
        return bool(self._open) and isinstance(self._open[-1].value, dict) and self._open[-1].key is _NO_KEY

    def _count_values(self, size: int) -> None:
        self._count += size
        if self._count > MAX_VALUES:
            raise InputError(f"not valid YAML: more than {MAX_VALUES} values")

    def _put(self, value: Any, event: yaml.Event, anchor: str | None = None, size: int = 1) -> None:
        """Add a value to the innermost open list or mapping; without one, it is a document."""
        anchor = event.anchor if isinstance(event, yaml.ScalarEvent) else anchor
        if anchor is not None:
            self._anchors[anchor] = value, size
        if not self._open:
            self.documents.append(value)
            return
        parent = self._open[-1]
        if isinstance(parent.value, list):
            parent.value.append(value)
        elif parent.key is not _NO_KEY:
            parent.value[parent.key], parent.key = value, _NO_KEY
        elif not isinstance(value, str):
            raise _refusal("a key that is not a string, expected a name", event)
        elif value in parent.value:
            raise _refusal(f"the key {value[:40]!r} appears twice", event)
        elif value == "<<":
            raise _refusal("a merge key <<, expected plain names", event)
        else:
            parent.key = value


def _scalar(event: yaml.ScalarEvent) -> Any:
    """The value of a scalar; a string if it is quoted."""
    text: str = event.value
    if not event.implicit[0]:
        return text
    if text in _NAMED_SCALARS:
        return _NAMED_SCALARS[text]
    if _INTEGER.fullmatch(text):
        return integer_of(text)
    return float(text) if _FLOAT.fullmatch(text) else text


def _refusal(reason: str, event: yaml.Event) -> InputError:
    return InputError(f"not valid YAML: line {event.start_mark.line + 1}: {reason}")
