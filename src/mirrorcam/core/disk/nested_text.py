"""Parse untrusted JSON and TOML into plain values: limits are checked before the parser runs; errors are one line."""

from __future__ import annotations

import json
import re
import tomllib
from typing import Any

import numpy as np

from mirrorcam.core.errors import InputError

MAX_DEPTH = 32
"""Maximum nesting depth of lists and tables, and parts of a dotted TOML key."""
MAX_VALUES, MAX_TABLES = 5_000_000, 1_000_000
"""Maximum numbers of values, and of lists, tables and keys, in one text: more take seconds and gigabytes."""
MAX_KEYS = 500_000
"""Maximum number of keys of one JSON table: enough for several files per picture of the largest set."""
LARGEST_TOML_BYTES = 250_000
"""TOML files are written by hand; parsing this much takes up to a second."""
MAX_DIGITS = 300
"""Maximum number of digits of an integer, so that it converts to a finite float."""
PARSER_ERRORS = (ValueError, TypeError, LookupError, AttributeError, ArithmeticError, RecursionError)
"""Exceptions of parsers for invalid text."""

# An unterminated string extends to the end of the line or the text, so that each byte is read once.
_JSON_STRING = re.compile(rb'"[^"\\]*+(?:\\.[^"\\]*+)*+"?', re.DOTALL)
_TOML_STRING = re.compile(
    rb'"""(?:[^"\\]|\\.?|"(?!""))*+"{0,5}+'  # one or two quotes may precede the three that end the string
    rb"|'''(?:[^']|'(?!''))*+'{0,5}+"
    rb'|"(?:[^"\\\n]|\\.?)*+"?'
    rb"|'[^'\n]*+'?"
    rb"|#[^\n]*+",
    re.DOTALL,
)
_TOML_KEY = re.compile(rb"[\w.-]+")
_NO_BRACKETS = bytes(set(range(256)) - set(b"[]{}"))
_STEPS = np.zeros(256, np.int8)
_STEPS[list(b"[{")], _STEPS[list(b"]}")] = 1, -1
_SURROGATE = re.compile(r"\\u[dD][89a-fA-F]")


def json_value(raw: bytes) -> Any:
    """Parse a JSON text (UTF-8); raises a one-line InputError, also for a duplicate key.

    NaN and Infinity are read as numbers: a later check for finite values can name the field.
    """
    text = _decoded(raw, "JSON")
    if raw.count(b"[") + raw.count(b"{") > MAX_DEPTH or raw.count(b",") > MAX_VALUES:
        if raw.count(b'"') > 2 * MAX_VALUES:
            raise InputError(f"not valid JSON: more than {MAX_VALUES} strings")
        _check_outline(_JSON_STRING.sub(b"s", raw), "JSON")
    try:
        value = _DECODER.decode(text)
        if _SURROGATE.search(text):
            json.dumps(value, ensure_ascii=False).encode()
    except UnicodeEncodeError:
        raise InputError("not valid JSON: half of a surrogate pair, expected characters") from None
    except PARSER_ERRORS as error:
        raise InputError(f"not valid JSON: {reason_of(error)}") from None
    return value


def toml_value(raw: bytes) -> dict[str, Any]:
    """Parse a TOML text; raises a one-line InputError."""
    if len(raw) > LARGEST_TOML_BYTES:
        raise InputError(f"is larger than {LARGEST_TOML_BYTES / 1e6:g} MB, expected a smaller file of TOML")
    text, outline = _decoded(raw, "TOML"), _TOML_STRING.sub(b"s", raw)
    _check_outline(outline, "TOML")
    words = _TOML_KEY.findall(outline.translate(None, b" \t"))
    if max((word.count(b".") for word in words), default=0) >= MAX_DEPTH:
        raise InputError(f"not valid TOML: a key of more than {MAX_DEPTH} parts")
    try:
        value = tomllib.loads(text)
    except PARSER_ERRORS as error:
        raise InputError(f"not valid TOML: {reason_of(error)}") from None
    _check_integers(value)
    return value


def reason_of(error: BaseException) -> str:
    """Return a parser's error message in one line."""
    reason = " ".join(str(error).split()) or type(error).__name__
    return f"an integer of more than {MAX_DIGITS} digits" if reason.startswith("Exceeds the limit") else reason


def integer_of(digits: str) -> int:
    """Convert digits to an integer; raises ValueError beyond the range of floats."""
    if len(digits) > MAX_DIGITS:
        raise ValueError(f"an integer of {len(digits)} digits, expected {MAX_DIGITS} or fewer")
    return int(digits)


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Return a JSON object as a dict; raises ValueError for a duplicate key, and for too many keys."""
    if len(pairs) > MAX_KEYS:
        raise ValueError(f"{len(pairs)} keys in one table, expected {MAX_KEYS} or fewer")
    table: dict[str, Any] = {}
    for key, value in pairs:
        if key in table:
            raise ValueError(f"the key {key[:80]!r} appears twice")
        table[key] = value
    return table


_DECODER = json.JSONDecoder(object_pairs_hook=_unique, parse_int=integer_of)


def _decoded(raw: bytes, language: str) -> str:
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"not valid {language}: byte {error.start} is not UTF-8 text") from None


def _check_outline(outline: bytes, language: str) -> None:
    """Refuse a text, passed without its strings, with too many values or too deep nesting."""
    tables = outline.count(b"[") + outline.count(b"{") + outline.count(b":")
    if tables > MAX_TABLES:
        raise InputError(f"not valid {language}: more than {MAX_TABLES} lists, tables and keys")
    if outline.count(b",") > MAX_VALUES:
        raise InputError(f"not valid {language}: more than {MAX_VALUES} values")
    brackets = outline.translate(None, _NO_BRACKETS)
    if np.cumsum(_STEPS[np.frombuffer(brackets, np.uint8)], dtype=np.int64).max(initial=0) > MAX_DEPTH:
        raise InputError(f"not valid {language}: nested deeper than {MAX_DEPTH}")


def _check_integers(value: Any) -> None:
    """Refuse integers beyond the range of floats, also in other bases."""
    pending = [value]
    while pending:
        item = pending.pop()
        if isinstance(item, int) and abs(item) >= 10**MAX_DIGITS:
            raise InputError(f"not valid TOML: an integer of more than {MAX_DIGITS} digits")
        pending += item.values() if isinstance(item, dict) else item if isinstance(item, list) else ()
