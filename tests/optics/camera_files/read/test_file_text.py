"""YAML of other tools: OpenCV's header and matrices, and plain data only."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from benchmarks.robustness.damage import damaged_bytes
from mirrorcam.core.disk.yaml_text import MAX_VALUES, yaml_documents
from mirrorcam.core.errors import InputError
from mirrorcam.optics.camera_files.read.file_text import MAX_BYTES, entry, read_text, read_yaml, table
from tests.soon import soon

GOOD = "%YAML:1.0\n---\na: &x [1, 2.e-05, .Inf, 'n o', \"t\\u00e9\"]\nb: {c: *x, d: ~}\ne: |\n  x\n...\n---\nf: true\n"
TEXTS = st.text("ab", max_size=4) | st.sampled_from(["1", "true", "~", "", "<<", "1:2", "2020-01-01", "- a", "#", "é"])
VALUES = st.recursive(
    st.none() | st.booleans() | st.integers(-(2**63), 2**63) | st.floats(allow_nan=False) | TEXTS,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text("ab", min_size=1, max_size=4), inner),
    max_leaves=20,
)


def test_matrices_of_opencv_are_mappings(tmp_path: Path) -> None:
    path = tmp_path / "a.yaml"
    path.write_text("%YAML:1.0\n---\nm: !!opencv-matrix\n   rows: 1\n   cols: 2\n   dt: d\n   data: [ 1., 2.e-05 ]\n")
    assert read_yaml(path) == {"m": {"rows": 1, "cols": 2, "dt": "d", "data": [1.0, 2e-5]}}


def test_a_large_file_and_one_that_is_no_text_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.yaml"
    path.write_bytes(b"#" * (MAX_BYTES + 1))
    with pytest.raises(InputError, match="is larger than 5 MB"):
        read_text(path)
    path.write_bytes(b"\xff\xfe")
    with pytest.raises(InputError, match="not UTF-8"):
        read_text(path)


def test_tables_and_entries() -> None:
    with pytest.raises(InputError, match="here: expected names with values"):
        table({1: 2}, "here")
    with pytest.raises(InputError, match="here: a is missing"):
        entry({"a": None}, "a", "here")
    assert entry({"a": 0}, "a", "here") == 0


@given(VALUES)
def test_what_pyyaml_writes_is_read_back(value: Any) -> None:
    assert yaml_documents(yaml.safe_dump(value, allow_unicode=True)) == [value]


def test_plain_texts_are_values_as_in_yaml_1_2() -> None:
    text = "[1, -2, 2., .5, 1e-05, .Inf, -.inf, true, ~, yes, 0x10, 010, 1:1:1, 2020-01-01, '1', \"true\", 1_0]"
    expected: list[Any] = [1, -2, 2.0, 0.5, 1e-05, np.inf, -np.inf, True, None]
    expected += ["yes", "0x10", 10, "1:1:1", "2020-01-01", "1", "true", "1_0"]
    assert yaml_documents(text) == [expected]


def test_damaged_text_is_values_or_refused_in_one_line() -> None:
    yaml_documents(GOOD)
    for seed in range(400):
        raw = damaged_bytes(GOOD.encode(), np.random.default_rng(seed))
        try:
            yaml_documents(raw.decode("utf-8", "replace"))
        except InputError as error:
            assert "\n" not in str(error)


@given(st.text("[]{}&*!?|>-:%@'\"# \n\tab1<.", max_size=60))
def test_any_text_is_values_or_refused(text: str) -> None:
    try:
        yaml_documents(text)
    except InputError as error:
        assert "\n" not in str(error)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[" * 1_000_000, "nested deeper"),
        ("- " * 50_000 + "a", "nested deeper"),
        ("? " * 50_000 + "a", "nested deeper"),
        ("\n".join(" " * depth + "a:" for depth in range(500)), "nested deeper"),
        ("[" + "1," * 1_000_000 + "]", f"more than {MAX_VALUES} values"),
        ("---\n" * 1_000_000, f"more than {MAX_VALUES} values"),
        ("[&a x," + "*a," * 1_000_000 + "]", f"more than {MAX_VALUES} values"),
        ("&a [*a]", "an alias 'a' without an anchor"),
        ("a: &x {b: 1}\nc: {<<: *x}", "line 2: a merge key"),
        ("a: 1\na: 2", "line 2: the key 'a' appears twice"),
        ("? [a]\n: b", "a key that is not a string"),
        ('a: !!int ""', "a tag 'tag:yaml.org,2002:int'"),
        ("a: !!set {b}", "a tag 'tag:yaml.org,2002:set'"),
        ("a: !!binary |\n  aaa", "a tag"),
        ("!!python/object/apply:os.system [ls]", "a tag"),
        ("".join(f"%TAG !a{number}! tag:a\n" for number in range(100_000)) + "---\na", "%TAG"),
        ("a: " + "1" * 1_000_000, "an integer of 1000000 digits"),
        ("a: \x00", "unacceptable character"),
    ],
)
def test_hostile_yaml_is_refused_at_once(text: str, message: str) -> None:
    with soon(), pytest.raises(InputError) as caught:
        yaml_documents(text)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "text",
    [
        "a: " + "1:" * 300_000 + "1",
        "a: " + "x\n " * 500_000,
        "a: |\n" + " x\n" * 500_000,
        "a: " + "1" * 1_000_000 + "x",
        "{" + ",".join(f"{number * (2**61 - 1)}: 1" for number in range(50_000)) + "}",
    ],
)
def test_long_yaml_is_read_at_once(text: str) -> None:
    with soon():
        assert len(yaml_documents(text)) == 1
