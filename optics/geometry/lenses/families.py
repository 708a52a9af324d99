"""Families of lens models by their names in layout.json."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Literal

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.lenses.fisheye import Fisheye
from mirrorcam.optics.geometry.lenses.lens import Lens
from mirrorcam.optics.geometry.lenses.polynomial import BrownConrady, Rational, ThinPrism
from mirrorcam.optics.geometry.lenses.spline import LensGrid, Spline

LensName = Literal["brown_conrady", "rational", "thin_prism", "fisheye", "spline"]

FIXED_SIZE_FAMILIES: Mapping[LensName, type[Lens]] = MappingProxyType(
    {"brown_conrady": BrownConrady, "rational": Rational, "thin_prism": ThinPrism, "fisheye": Fisheye}
)
"""Families with a fixed number of coefficients."""


def lens_of(name: LensName, coefficients: FloatArray, grid: LensGrid | None = None) -> Lens:
    """The lens of a family.

    Raises ValueError for a wrong number of coefficients, a spline lens without `grid`, and another lens with it.
    """
    if (grid is None) == (name == "spline"):
        given = "without" if grid is None else "with"
        raise ValueError(f"a {name} lens {given} lens_grid, expected one for a spline lens and for no other")
    lens = FIXED_SIZE_FAMILIES[name](coefficients) if grid is None else Spline(coefficients, grid)
    if len(coefficients) != len(lens.names):
        names = ", ".join(lens.names) if grid is None else f"k1, k2, p1, p2, k3 and 2 x {grid.count} of its grid"
        raise ValueError(
            f"{len(coefficients)} distortion coefficients, expected {len(lens.names)} for a {name} lens: {names}"
        )
    return lens
