"""Numbers as text that every reader takes for the same number."""

from __future__ import annotations

import yaml

from mirrorcam.core.number_text import number, numbers


def test_numbers_stay_numbers_in_yaml() -> None:
    values = [1e-05, -3.25e-17, 1e22, 0.1, -0.0, 1360.38, 5.0]
    read = yaml.safe_load("[" + ", ".join(number(value) for value in values) + "]")
    assert all(type(value) is float for value in read)
    assert read == values
    # What this is about: PyYAML takes Python's own text of the first for a string.
    assert isinstance(yaml.safe_load(repr(values[0])), str)


def test_numbers_read_back_to_the_bit_and_zero_has_no_sign() -> None:
    values = [0.1 + 0.2, -1e-300, 2.0**-1074, 123456789.0, -0.0]
    text = numbers(values, " ")
    assert [float(word) for word in text.split()] == values
    assert text.endswith(" 0.0")
