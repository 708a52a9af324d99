"""Mutated layouts: read, and where they are read, used as a user would."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.robustness.damage import damaged_bytes, damaged_value
from benchmarks.robustness.guard import Category, refused_well
from mirrorcam.core.values import InputError
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.light_field.decoder import Decoder

LAYOUT = Path(__file__).parents[2] / "tests" / "data" / "default_layout.json"


@cache
def _text() -> bytes:
    return LAYOUT.read_bytes()


@cache
def _value() -> Any:
    return json.loads(_text())


def attempt(seed: int, folder: Path) -> str:
    """Read a mutated layout, and decode with it where it is one."""
    random = np.random.default_rng(seed)
    path = folder / "layout.json"
    if random.random() < 0.3:
        path.write_bytes(damaged_bytes(_text(), random))
    else:
        path.write_text(json.dumps(damaged_value(_value(), random)), encoding="utf-8")
    try:
        layout = Layout.load(path)
    except InputError as error:
        return refused_well(str(error).replace(str(folder), "")) or ("" if str(path) in str(error) else "names no file")
    try:
        Decoder(layout, width_px=16)
    except InputError as error:
        return refused_well(str(error).replace(str(folder), ""))
    return ""


CATEGORY = Category("layouts", 10_000, attempt)
