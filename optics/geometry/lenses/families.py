"""The families of lens models by their names in layout.json."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Literal

from mirrorcam.optics.base.values import FloatArray
from mirrorcam.optics.geometry.lenses.brown_conrady import BrownConrady
from mirrorcam.optics.geometry.lenses.fisheye import Fisheye
from mirrorcam.optics.geometry.lenses.lens import Lens
from mirrorcam.optics.geometry.lenses.rational import Rational
from mirrorcam.optics.geometry.lenses.thin_prism import ThinPrism

LensName = Literal["brown_conrady", "rational", "thin_prism", "fisheye"]

FAMILIES: Mapping[LensName, type[Lens]] = MappingProxyType(
    {"brown_conrady": BrownConrady, "rational": Rational, "thin_prism": ThinPrism, "fisheye": Fisheye}
)


def lens_of(name: LensName, coefficients: FloatArray) -> Lens:
    """The lens of a family; raises ValueError for another number of coefficients than the family has."""
    family = FAMILIES[name]
    if len(coefficients) != len(family.NAMES):
        raise ValueError(
            f"{len(coefficients)} numbers of distortion, expected the {len(family.NAMES)} of a {name} lens: "
            f"{', '.join(family.NAMES)}"
        )
    return family(coefficients)
