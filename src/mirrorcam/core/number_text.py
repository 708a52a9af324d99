"""Numbers as text that every reader takes for the same number."""

from __future__ import annotations

from collections.abc import Iterable

from mirrorcam.core.values import FloatArray


def number(value: float) -> str:
    """The shortest text that reads back to the bit, with a point, and without a negative zero.

    YAML 1.1 takes `1e-05` for a string: PyYAML, and Kalibr with it, would read it as one.
    """
    text = repr(float(value) + 0.0)
    mantissa, exponent, power = text.partition("e")
    return f"{mantissa if '.' in mantissa else mantissa + '.0'}{exponent}{power}"


def numbers(values: Iterable[float] | FloatArray, separator: str = ", ") -> str:
    """Several numbers in one line."""
    return separator.join(number(value) for value in values)
