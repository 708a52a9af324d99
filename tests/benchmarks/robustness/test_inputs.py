"""Mutated files are TOML and JSON as their names say, and what is good passes."""

from __future__ import annotations

import tomllib
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from benchmarks.robustness.guard import Category
from benchmarks.robustness.inputs import CATEGORIES, toml_text
from mirrorcam.core.disk.files import write_json


def test_a_table_is_written_as_toml() -> None:
    table = {
        "name": 'a\n"b"',
        "on": True,
        "size": [1.5, 2],
        "camera": {"x y": {"deep": float("inf")}, "list": [{"a": 1}]},
    }
    assert tomllib.loads(toml_text(table)) == table


@pytest.mark.parametrize("category", CATEGORIES, ids=lambda category: category.name)
def test_files_without_damage_are_used(category: Category, tmp_path: Path) -> None:
    assert isinstance(category.attempt, partial)
    parts = category.attempt.keywords
    name = parts["names"][-1]
    value = parts["good"](np.random.default_rng(0))
    path = tmp_path / name
    if path.suffix == ".toml":
        path.write_text(toml_text({k: v for k, v in value.items() if v is not None}), encoding="utf-8")
    else:
        write_json(path, value)
    parts["use"](path)
