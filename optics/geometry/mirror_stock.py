"""Stock that mirrors are cut from: reflecting surface, material and thickness, by names such as second-glass-3."""

from __future__ import annotations

import re
from typing import Literal

from mirrorcam.core.bounds import LENGTH_MM
from mirrorcam.core.errors import InputError
from mirrorcam.optics.geometry.layout import Layout

Material = Literal["acrylic", "glass"]
INDICES: dict[Material, float] = {"acrylic": 1.49, "glass": 1.52}
"""Refractive index of each material (float glass)."""
GLASS_INDEX = sum(INDICES.values()) / 2.0
"""Refractive index from which a mirror counts as glass."""
_NAME = re.compile(r"(first|second)-(acrylic|glass)-(\d+(?:\.\d+)?)")


def stock_fields(name: str) -> dict[str, str | float]:
    """The fields of a design's specification for stock of a name, SURFACE-MATERIAL-THICKNESS in mm.

    Raises InputError for anything else.
    """
    match = _NAME.fullmatch(name)
    if match is None or not LENGTH_MM.min <= float(match[3]) <= LENGTH_MM.max:
        raise InputError(
            f"mirror stock {name}: expected SURFACE-MATERIAL-THICKNESS, such as first-acrylic-1, second-acrylic-3, "
            "first-glass-3 or second-glass-2"
        )
    index = INDICES["glass" if match[2] == "glass" else "acrylic"]
    return {"surface": match[1], "thickness_mm": float(match[3]), "refractive_index": index}


def material_of(layout: Layout) -> Material:
    """The material of a layout's mirrors, by their refractive index."""
    return "glass" if all(mirror.refractive_index >= GLASS_INDEX for mirror in layout.mirrors) else "acrylic"
