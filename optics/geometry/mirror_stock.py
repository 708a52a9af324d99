"""Stock that mirrors are cut from: reflecting surface, material and thickness, by names such as second-glass-3."""

from __future__ import annotations

import math
import re
from typing import Literal

import numpy as np

from mirrorcam.core.bounds import LENGTH_MM
from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.layout import Layout

Material = Literal["acrylic", "glass"]
INDICES: dict[Material, float] = {"acrylic": 1.49, "glass": 1.52}
"""Refractive index of each material (float glass)."""
WIDTH_TO_THICKNESS: dict[Material, float] = {"acrylic": 1.0, "glass": 4.0}
"""Smallest ratio of a mirror's width to its thickness: narrower scored glass does not break along the line."""
STOCKS = (
    *("first-glass-3", "first-acrylic-1", "first-acrylic-3"),
    *("second-glass-2", "second-glass-3", "second-acrylic-2", "second-acrylic-3"),
)
"""Common stock, to choose from."""
STOCK_FIELDS = ("surface", "thickness_mm", "refractive_index")
"""Fields of a design's specification that state its stock."""
SOLD_MM = (3.0, 2.0, 1.0)
"""Thicknesses of glass mirrors that shops sell, below the thickest, in mm."""
# How much larger than the smallest layout the suggested one is, since outlines do not grow in proportion.
SCALE_RESERVE = 1.05
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


def stock_name(spec: DesignSpec) -> str:
    """The name of a specification's stock."""
    return f"{spec.surface}-{_material(spec.refractive_index)}-{spec.thickness_mm:g}"


def mirrors_text(spec: DesignSpec) -> str:
    """The mirrors of a specification in words, such as "first-glass-3, rectangles"."""
    shape = spec.shape.replace("stock:", "in stock: ").replace(",", ", ")
    return f"{stock_name(spec)}, {'free outlines' if spec.rectangle_sizes is None else shape}"


def _material(refractive_index: float) -> Material:
    return "glass" if refractive_index >= GLASS_INDEX else "acrylic"


def material_of(layout: Layout) -> Material:
    """The material of a layout's mirrors, by their refractive index."""
    return _material(min(mirror.refractive_index for mirror in layout.mirrors))


def width_mm(outline: FloatArray) -> float:
    """Width of a convex outline (n, 2): the smallest distance between parallel supporting lines, one on an edge."""
    edges = np.roll(outline, -1, axis=0) - outline
    normals = np.column_stack([-edges[:, 1], edges[:, 0]]) / np.linalg.norm(edges, axis=1)[:, None]
    return float(np.ptp(outline @ normals.T, axis=0).min())


def _widths(layout: Layout) -> list[float]:
    """Widths of the mirrors relative to their thicknesses."""
    return [width_mm(mirror.outline_in_plane_mm) / mirror.thickness_mm for mirror in layout.mirrors]


def narrowest(layout: Layout) -> float:
    """Width of the narrowest mirror, relative to the smallest width that can be cut from its stock."""
    return min(_widths(layout)) / WIDTH_TO_THICKNESS[material_of(layout)]


def too_narrow(layout: Layout) -> str:
    """Advice if a mirror is too narrow to be cut from its stock; "" if none is."""
    material = material_of(layout)
    ratio, widths = WIDTH_TO_THICKNESS[material], _widths(layout)
    index = int(np.argmin(widths))
    if widths[index] >= ratio:
        return ""
    return narrow_mirror(layout, index, widths[index] * layout.mirrors[index].thickness_mm, ratio, material)


def narrow_mirror(layout: Layout, index: int, across_mm: float, ratio: float, material: Material) -> str:
    """The message for a mirror less than `ratio` thicknesses across, with stock or a scale that avoids it."""
    mirror = layout.mirrors[index]
    needed = ratio * mirror.thickness_mm
    limit = "its thickness" if ratio == 1.0 else f"{ratio:g} times its thickness"
    thinner = [sold for sold in SOLD_MM if sold < mirror.thickness_mm and ratio * sold <= across_mm]
    stocks = [f"{mirror.surface}-glass-{thinner[0]:g}"] if material == "glass" and thinner else []
    if mirror.thickness_mm > 1.0 or material == "glass":
        stocks.append("first-acrylic-1")
    ways = [f"--mirror {stock}" for stock in stocks]
    factor = SCALE_RESERVE * needed / across_mm
    ways.append(
        f"--scale-mm {math.ceil(factor * layout.spec.scale_mm)}" if layout.spec else f"{factor:.2f} times the scale"
    )
    return (
        f"mirror {layout.mirror_names[index]} is {across_mm:.2f} mm across, expected at least {limit}, {needed:g} mm: "
        f"design with {' or '.join(ways)}"
    )
