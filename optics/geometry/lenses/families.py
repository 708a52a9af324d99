"""The families of lens models by their names in layout.json."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Literal

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.lenses.brown_conrady import BrownConrady
from mirrorcam.optics.geometry.lenses.fisheye import Fisheye
from mirrorcam.optics.geometry.lenses.lens import Lens
from mirrorcam.optics.geometry.lenses.rational import Rational, ThinPrism
from mirrorcam.optics.geometry.lenses.spline import LensGrid, Spline

LensName = Literal["brown_conrady", "rational", "thin_prism", "fisheye", "spline"]

NUMBERED: Mapping[LensName, type[Lens]] = MappingProxyType(
    {"brown_conrady": BrownConrady, "rational": Rational, "thin_prism": ThinPrism, "fisheye": Fisheye}
)
"""Families with a few numbers, the same for every camera."""


def lens_of(name: LensName, coefficients: FloatArray, grid: LensGrid | None = None) -> Lens:
    """The lens of a family.

    Raises ValueError for another number of coefficients than the family has, and for a spline without its grid.
    """
    if (grid is None) == (name == "spline"):
        raise ValueError(f"a {name} lens {'without' if grid is None else 'with'} lens_grid, which a spline lens has")
    lens = NUMBERED[name](coefficients) if grid is None else Spline(coefficients, grid)
    if len(coefficients) != len(lens.names):
        numbers = ", ".join(lens.names) if grid is None else f"k1, k2, p1, p2, k3 and 2 x {grid.count} of its grid"
        raise ValueError(
            f"{len(coefficients)} numbers of distortion, expected the {len(lens.names)} of a {name} lens: {numbers}"
        )
    return lens
