"""JSON and TOML from outside: a value, or one line within a second, whatever the text is."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchmarks.robustness.damage import damaged_bytes
from mirrorcam.core.disk.nested_text import MAX_DEPTH, MAX_KEYS, MAX_TABLES, json_value, toml_value
from mirrorcam.core.errors import InputError
from tests.soon import soon

JSON = b'{"a": [1, -2.5e3, true, null, "\\u00e9 \\"[{,"], "b": {"c": {}}}'
TOML = b'a.b = "x # [" # [[\n[t."u.v"]\nc = [1, {d = 0x1F}]\n[[e]]\nf = \'\'\'x\'\'\'\ng = """y""""\n'


def refusal(read: Callable[[bytes], Any], raw: bytes) -> str:
    """The one line of a refusal, which comes within a second of processor time."""
    with soon(), pytest.raises(InputError) as caught:
        read(raw)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 200
    return str(caught.value)


@given(st.recursive(st.none() | st.booleans() | st.integers(-(2**63), 2**63) | st.text(), st.lists, max_leaves=20))
def test_json_is_read_as_it_was_written(value: Any) -> None:
    assert json_value(json.dumps({"a": value}).encode()) == {"a": value}


@pytest.mark.parametrize(("read", "good"), [(json_value, JSON), (toml_value, TOML)])
def test_damaged_text_is_a_value_or_refused_in_one_line(read: Callable[[bytes], Any], good: bytes) -> None:
    read(good)
    for seed in range(300):
        raw = damaged_bytes(good * (1 + seed % 3), np.random.default_rng(seed))
        try:
            read(raw)
        except InputError as error:
            assert "\n" not in str(error)


@given(st.binary(max_size=60) | st.text("[]{}\"'\\#.=,\n ab1", max_size=60).map(str.encode))
def test_any_bytes_are_a_value_or_refused(raw: bytes) -> None:
    for read in (json_value, toml_value):
        try:
            read(raw)
        except InputError as error:
            assert "\n" not in str(error)


@given(st.text("[]{}\"'\\#.=,\n ab1", max_size=40))
def test_the_bounds_of_toml_refuse_nothing_that_is_small(text: str) -> None:
    try:
        expected = tomllib.loads(text)
    except tomllib.TOMLDecodeError:
        return
    assert toml_value(text.encode()) == expected


@pytest.mark.parametrize(
    ("raw", "message"),
    [
        (b"[" * 1_000_000, "nested deeper"),
        (b'{"a":' * (MAX_DEPTH + 1) + b"1" + b"}" * (MAX_DEPTH + 1), "nested deeper"),
        (b"[" + b"[]," * (MAX_TABLES + 1) + b"0]", "lists, tables and keys"),
        (b"1" * 1_000_000, "an integer of 1000000 digits"),
        (b'"\\ud800"', "surrogate"),
        (b'{"a": 1, "a": 2}', "'a' appears twice"),
        ("{}".encode("utf-16"), "is not UTF-8 text"),
        (b"", "Expecting value"),
    ],
)
def test_hostile_json_is_refused_at_once(raw: bytes, message: str) -> None:
    assert message in refusal(json_value, raw)


LONG_KEY = ".".join(["a"] * 50_000).encode()


@pytest.mark.parametrize(
    ("raw", "message"),
    [
        (LONG_KEY + b" = 1", "a key of more than"),
        (b"[" + LONG_KEY + b"]", "a key of more than"),
        (b"[[ " + LONG_KEY.replace(b".", b" . ") + b"]]", "a key of more than"),
        (b"a = [1, {" + LONG_KEY + b" = 1}]", "a key of more than"),
        (b'a = {b = """x"""", ' + LONG_KEY + b" = 1}", "a key of more than"),
        (b"'a'." * 1000 + b"b = 1", "a key of more than"),
        (b"a = " + b"[" * 200_000, "nested deeper"),
        (b"a = " + b"{a = " * 1000, "nested deeper"),
        (b"a = 0x" + b"f" * 200_000, "an integer of more than"),
        (b"a = " + b"1" * 200_000, "an integer of more than"),
        (b'a = """\n' + b'\\"""\n' * 40_000 + b"\\", "not valid TOML"),
        (b"a = 1\n" * 2, "Cannot overwrite"),
        (b"\xff", "is not UTF-8 text"),
        (b"#" * 250_001, "is larger than 0.25 MB"),
    ],
)
def test_hostile_toml_is_refused_at_once(raw: bytes, message: str) -> None:
    assert message in refusal(toml_value, raw)


def test_brackets_and_dots_in_texts_and_comments_are_none() -> None:
    many = "[{" * 1000 + "a." * 1000
    assert toml_value(f'a = "{many}" # {many}\nb = \'{many}\'\nc = """{many}"""'.encode()) == dict.fromkeys("abc", many)
    assert json_value(json.dumps([[]] * MAX_DEPTH + [many]).encode())[-1] == many


def test_a_number_that_is_none_is_left_to_who_expects_one() -> None:
    assert np.isnan(json_value(b"[NaN]")[0])
    assert np.isnan(toml_value(b"a = nan")["a"])


def test_a_table_of_very_many_keys_is_refused() -> None:
    raw = json.dumps({f"a{number}": 1 for number in range(MAX_KEYS + 1)}).encode()
    assert f"{MAX_KEYS + 1} keys in one table, expected {MAX_KEYS} or fewer" in refusal(json_value, raw)
