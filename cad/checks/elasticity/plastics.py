"""Plastics for printing: what elasticity, warmth and time make of them."""

from __future__ import annotations

from dataclasses import dataclass, replace

from mirrorcam.core.values import InputError


@dataclass(frozen=True)
class Plastic:
    """A plastic as printed, at 20 to 25 deg C.

    `creep` is how much of the elastic strain is added in 1000 h under the same small stress, `swelling` the strain from
    dry to the air of a room. Where `source` says "from memory", the number is that of common data sheets, not looked
    up.
    """

    name: str
    modulus_mpa: float
    density_g_per_cm3: float
    strain_per_k: float
    glass_c: float
    creep: float
    swelling: float
    source: str


PLASTICS = (
    Plastic(
        "PLA", 2300.0, 1.24, 68e-6, 60.0, 0.5, 3e-4,
        "modulus: Polymaker PolyTerra, 2.0 to 2.2 GPa, Stratasys 2.5 to 3.0; Tg 60.6 C (PolyTerra), 63 C (Stratasys); "
        "expansion from memory (Stratasys has 101e-6); creep from memory",
    ),
    Plastic(
        "PETG", 1900.0, 1.27, 60e-6, 80.0, 0.5, 3e-4,
        "modulus 2 to 3 GPa, density, Tg 75 to 85 C: additive.tools; expansion and creep from memory",
    ),
    Plastic("ASA", 1900.0, 1.07, 95e-6, 100.0, 0.6, 3e-4, "all from memory"),
    Plastic("ABS", 1900.0, 1.04, 90e-6, 105.0, 0.7, 3e-4, "modulus 2.0 GPa: Wohlers 2011; the rest from memory"),
    Plastic(
        "PA-CF", 3500.0, 1.2, 60e-6, 60.0, 0.9, 5e-3,
        "expansion 22e-6 along the lines, 248e-6 across layers, swelling .5 to 1.5 %: Faust et al. 2021, "
        "doi 10.3390/polym13213637, of which this is a mean in a layer; the rest from memory, of moist nylon",
    ),
)  # fmt: skip
MIRROR_PER_K = {"acrylic": 70e-6, "glass": 9e-6}
"""Expansion of mirrors, by their material: of cast acrylic and of float glass, from memory."""
STEEL_PER_K = 12e-6
"""Expansion of what the foot is screwed to."""


def plastic_named(name: str, modulus_mpa: float, density_g_per_cm3: float) -> Plastic:
    """A plastic of the table with a printer's modulus and density; raises InputError where it is not in the table."""
    for plastic in PLASTICS:
        if plastic.name.casefold() == name.casefold():
            return replace(plastic, modulus_mpa=modulus_mpa, density_g_per_cm3=density_g_per_cm3)
    raise InputError(
        f"printer.plastic = {name}: its expansion and creep are not known, expected one of "
        f"{', '.join(plastic.name for plastic in PLASTICS)} for finite elements"
    )
