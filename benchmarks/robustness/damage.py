"""Damage to bytes, texts and structured values, drawn from a random generator."""

from __future__ import annotations

import copy
import re
from typing import Any

import numpy as np

ODD_VALUES: tuple[Any, ...] = (
    *(None, True, False, 0, -1, 1, 2, 0.5, 1e-300, 1e308, -1e308, 10**400, float("nan"), float("inf"), -float("inf")),
    *("", "1", "nan", "a" * 5000, "../../etc/passwd", "/etc/passwd", "\x00", "<img src=x onerror=alert(1)>", "=1+1"),
    *([], {}, [[]], [None], {"": ""}, [1, 2, 3], [[1.0] * 3] * 3),
)


def damaged_bytes(raw: bytes, random: np.random.Generator) -> bytes:
    """Damage bytes in one way: truncate, write zeros or noise, flip bits, repeat, insert or remove a block."""
    data, length = bytearray(raw), max(len(raw), 1)
    at = int(random.integers(length))
    size = int(random.integers(1, max(length // 4, 2)))
    kind = random.choice(["cut", "zeros", "noise", "flips", "repeat", "insert", "lose"])
    if kind == "cut":
        return bytes(data[:at])
    if kind == "zeros":
        data[at : at + size] = bytes(len(data[at : at + size]))
    elif kind == "noise":
        data[at : at + size] = random.bytes(len(data[at : at + size]))
    elif kind == "flips":
        for index in random.integers(len(data) or 1, size=int(random.integers(1, 9))) if data else ():
            data[index] ^= 1 << int(random.integers(8))
    elif kind == "repeat":
        data[at:at] = data[at : at + size]
    elif kind == "insert":
        data[at:at] = random.bytes(min(size, 64))
    else:
        del data[at : at + size]
    return bytes(data)


def damaged_value(value: Any, random: np.random.Generator) -> Any:
    """Return a deep copy of nested dicts and lists with one to three entries changed, removed, added or renamed."""
    value = copy.deepcopy(value)
    for _ in range(int(random.integers(1, 4))):
        entries = list(_entries(value))
        if not entries:
            return ODD_VALUES[int(random.integers(len(ODD_VALUES)))]
        container, key = entries[int(random.integers(len(entries)))]
        odd = copy.deepcopy(ODD_VALUES[int(random.integers(len(ODD_VALUES)))])
        kind = random.choice(["replace", "scale", "remove", "add", "rename"], p=[0.45, 0.25, 0.1, 0.1, 0.1])
        if kind == "scale" and _is_scalable(container[key]):
            container[key] = container[key] * float(random.choice([-1.0, 0.0, 1e-3, 0.5, 2.0, 1e3, 1e9]))
        elif kind == "remove":
            del container[key]
        elif kind == "add" and isinstance(container, list):
            container.insert(key, odd)
        elif kind in ("add", "rename") and isinstance(container, dict):
            container[f"{key}s"] = container.pop(key) if kind == "rename" else odd
        else:
            container[key] = odd
    return value


def _is_scalable(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < 1e300


def _entries(value: Any) -> Any:
    """Yield every entry of nested dicts and lists, as its container and key."""
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, inner in items:
        yield value, key
        yield from _entries(inner)


_NUMBER = re.compile(r"-?\d[\d.e+-]*")
_HOSTILE: dict[str, tuple[str, ...]] = {
    ".yaml": (
        *('!!int ""', "!!float x", "!!set {a}", "!!binary |\n  aaa", "!!timestamp 2020-01-01", "!a b", "!!omap [a]"),
        *("&a [*a]", "*a", "&a 1", "{<<: *a}", "1:1:1", "0x1F", "010", "1_0", ".nan", "-.Inf", "~", "2020-01-01"),
        *("? a", "|\n  a", "'...'", "\n---\na: 1\n", "\n...\n", "%TAG ! a", "\t", "- - a", '"\\ud800"'),
    ),
    ".toml": (
        *("nan", "-inf", "0xFFFFFFFFFFFFFFFFFF", "1_0", "2020-01-01", "07:32:00", "'''a'''", '"""a""""', "[[[]]]"),
        *("{a = 1}", "{a.b.c = 1}", "\n[a]\n", "\n[[a]]\n", "\n[a.b]\n", '"\\ud800"', "\na.b.c = 1\n", "1e999"),
    ),
    ".json": ("NaN", "-Infinity", '"\\ud800"', "[[[]]]", "{}", "1e999", "null", "[],", '{"a": 1, "a": 2}', "'a'"),
}
"""Hostile texts in place of a value, by the suffix of the format."""
_LONG = (
    *("1", "1:", "[", "{", "[],", "a.", "- ", "? ", "&a ", '"', "'", "#", "\\", "---\n", "[[a]]\n", "0", " "),
    *("\n", "{a: "),
)
"""Texts to repeat many times."""


def damaged_text(text: str, suffix: str, random: np.random.Generator) -> str:
    """Return a text with one to three changes: unexpected values of the format, and very long ones."""
    for _ in range(int(random.integers(1, 4))):
        lines, numbers = text.splitlines(keepends=True) or [""], list(_NUMBER.finditer(text))
        line = int(random.integers(len(lines)))
        kind = random.choice(["value", "long value", "repeat a line", "insert", "long line"])
        odd = _HOSTILE[suffix][int(random.integers(len(_HOSTILE[suffix])))]
        if kind.startswith("long"):
            odd = _LONG[int(random.integers(len(_LONG)))] * int(random.choice([50, 5_000, 200_000]))
        if kind.endswith("value") and numbers:
            number = numbers[int(random.integers(len(numbers)))]
            text = text[: number.start()] + odd + text[number.end() :]
        elif kind == "repeat a line":
            lines.insert(int(random.integers(len(lines) + 1)), lines[line])
            text = "".join(lines)
        else:
            index = int(random.integers(len(text) + 1)) if kind == "insert" else len("".join(lines[:line]))
            text = text[:index] + odd + text[index:]
    return text
