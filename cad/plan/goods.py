"""What each purchased thing is: standard, material, who sells it, search words, price, and what may replace it.

The one table that parts list, guide and drawings read. Prices are in EUR as of `prices.Prices.date`: estimates of
typical retail prices of small quantities in Europe with tax; for small items, the price of a bag divided by their
number.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import NamedTuple, TypeVar

FASTENERS_SHOP = "shop for fasteners or model making; online in bags of 10 to 100"
CRAFT_GLASS_SHOP = "maker of first-surface mirrors, or shop for kaleidoscopes"
OTHER_STOCK = (
    "Another thickness, surface or material only with a new design (`mirrorcam design --mirror`): the seats and the "
    "path of light depend on it."
)
AREA, PIECE = "100 cm²", "piece"
"""Units in which mirrors are priced."""


class Good(NamedTuple):
    """A kind of purchased thing.

    `former` is the designation that shops still use. `search` may contain {size}, the start of the title, such as
    "M3 x 12". `eur` is the price of one by size, by the start of the title; "" is any size. `instead` has sentences in
    Markdown.
    """

    standard: str
    former: str
    material: str
    supplier: str
    search: str
    eur: Mapping[str, float]
    instead: tuple[str, ...] = ()


STAINLESS = "Stainless steel A2 serves as well."
# By the start or the end of a title without its length; the longest name counts. Suppliers of mirrors are the kinds
# that public pages named in 2026-11: shops for kaleidoscopes and stained glass sell first-surface glass in sheets to
# score (clarityglass.com, theavenuestainedglass.com), its makers state 94 % of reflectance and 8 waves per inch for 1/8
# in (firstsurfacemirrors.com); laser shops stock second-surface acrylic of 3 mm, others to order
# (lasersoverlosangeles.com); glaziers and hardware stores cut second-surface glass of 3 and 4 mm to size
# (engineerfix.com), for 8 to 15 USD per square foot installed (thisoldhouse.com), which is 0.9 to 1.6 USD per 100 cm2.
# No page offered first-surface acrylic. The other prices are estimates.
GOODS: Mapping[str, Good] = {
    "screw": Good(
        "ISO 4762, socket head",
        "DIN 912",
        "steel, class 8.8",
        FASTENERS_SHOP,
        "{size} socket head cap screw DIN 912",
        {"M2": 0.10, "M2.5": 0.10, "M3": 0.12, "M4": 0.15, "M5": 0.20, "M6": 0.25},
        (STAINLESS,),
    ),
    "countersunk screw": Good(
        "ISO 10642, hexagon socket",
        "DIN 7991",
        "steel, class 8.8",
        FASTENERS_SHOP,
        "{size} countersunk socket screw DIN 7991",
        {"M3": 0.12, "M4": 0.15},
        (STAINLESS,),
    ),
    **{
        f"{thread} countersunk screw": Good(
            "ISO 7046, cross recess",
            "DIN 965",
            "steel, class 4.8 or 8.8",
            FASTENERS_SHOP,
            "{size} countersunk screw cross recess DIN 965",
            {thread: 0.10},
            (STAINLESS,),
        )
        for thread in ("M2", "M2.5")
    },
    "1/4-20 UNC countersunk screw": Good(
        "ASME B18.3, hexagon socket",
        "",
        "steel",
        "shop for fasteners with inch threads, or camera shop",
        "{size} flat head socket screw",
        {"": 0.40},
    ),
    "thread-forming screw": Good(
        "for plastics, pan head",
        "",
        "steel",
        FASTENERS_SHOP,
        "{size} thread forming screw for plastic pan head",
        {"": 0.12},
    ),
    "washer": Good(
        "ISO 7089",
        "DIN 125 A",
        "steel or stainless steel",
        FASTENERS_SHOP,
        "{size} washer DIN 125 A",
        {"": 0.04},
    ),
    "heat-set insert": Good(
        "brass",
        "",
        "knurled, for pressing into warm plastic",
        "shop for 3-D printing; online in bags of 20 to 100",
        "{size} brass heat set insert",
        {"M2": 0.15, "M2.5": 0.15, "M3": 0.15, "M4": 0.25},
    ),
    "nut": Good(
        "ISO 4032",
        "DIN 934",
        "steel or stainless steel",
        FASTENERS_SHOP,
        "{size} hexagon nut DIN 934",
        {"M2": 0.05, "M2.5": 0.05, "M3": 0.05, "M4": 0.06},
    ),
    "UNC hexagon nut": Good(
        "ASME B18.2.2",
        "",
        "steel or stainless steel",
        "shop for fasteners with inch threads; camera shop",
        "1/4-20 UNC hex nut 7/16",
        {"": 0.40},
        ("No M6 nut: the screws of tripods are 1/4-20 UNC.",),
    ),
    "T-slot nut": Good(
        "for slots of 6 mm",
        "",
        "steel",
        "shop for aluminium profiles",
        "{size} T-slot nut 2020 profile slot 6",
        {"M5": 0.40},
    ),
    "pin": Good(
        "ISO 2338 or a piece of rod",
        "DIN 7",
        "steel",
        FASTENERS_SHOP,
        "{size} mm dowel pin",
        {"": 0.30},
        ("A piece of steel or brass rod of the same diameter.",),
    ),
    "compression spring": Good(
        "spring steel, DIN 2098 or similar",
        "",
        "spring steel",
        "shop for springs; assortments online",
        "compression spring {size} mm (wire, mean diameter, length)",
        {"": 0.60},
        ("Another spring: give it under `[holder.spring]` in a hardware file, and build again.",),
    ),
    "Cable tie": Good(
        "",
        "",
        "polyamide 6.6",
        "hardware store",
        "cable tie 2.5 x 150 mm",
        {"": 0.10},
    ),
    "Double-sided tape": Good(
        "",
        "",
        "polyester or polypropylene film with acrylic adhesive on both sides",
        "stationer, shop for sign making; online",
        "double sided film tape acrylic adhesive 0.2 mm",
        {"": 7.0},
        (
            "A film tape of another thickness: give `tape_mm` under `[holder]` in a hardware file, and build again.",
            "No foam tape: it sets no distance, and creeps.",
            "Glue: build again with `--mounting glue`.",
        ),
    ),
    "Glue for": Good(
        "one-part silicone, neutral cure (oxime or alkoxy)",
        "",
        "",
        "hardware store; glazier",
        "neutral cure silicone mirror",
        {"": 8.0},
        (
            "No superglue, which is brittle, and no silicone that smells of vinegar, which attacks mirrors.",
            "Tape: build again with `--mounting tape`.",
        ),
    ),
    "matt black": Good(
        "1.75 mm",
        "",
        "matt, black",
        "shop for 3-D printing",
        "matt black {size} filament 1.75 mm",
        {},
        ("Any filament under matt black spray paint: mask the pads of the seats, which set the mirrors' directions.",),
    ),
    "any colour": Good(
        "1.75 mm",
        "",
        "of one kind for all parts",
        "shop for 3-D printing",
        "{size} filament 1.75 mm",
        {},
        ("The matt black of the mirror holder.",),
    ),
    "first-surface acrylic mirror": Good(
        "coated on its front",
        "",
        "acrylic (PMMA)",
        "to order from a coating company: no shop found",
        "first surface acrylic mirror sheet",
        {AREA: 6.0, PIECE: 2.0},
        (OTHER_STOCK,),
    ),
    "second-surface acrylic mirror": Good(
        "coated on its back",
        "",
        "acrylic (PMMA)",
        "plastics shop or laser cutting service",
        "silver acrylic mirror sheet laser cut to size",
        {AREA: 2.0, PIECE: 0.5},
        (OTHER_STOCK,),
    ),
    "first-surface glass mirror": Good(
        "coated on its front",
        "",
        "float glass",
        CRAFT_GLASS_SHOP,
        "front surface mirror glass sheet",
        {AREA: 8.0, PIECE: 3.0},
        (OTHER_STOCK,),
    ),
    "second-surface glass mirror": Good(
        "coated on its back",
        "",
        "float glass",
        "glazier or hardware store; craft shop for small sizes",
        "mirror cut to size; mosaic mirror tiles",
        {AREA: 1.5, PIECE: 0.3},
        (OTHER_STOCK,),
    ),
}
CAMERA = Good(
    "",
    "",
    "",
    "electronics shop, or second-hand",
    "{size}",
    {
        "Arducam B0196": 35.0,
        "Intel RealSense D435, colour": 330.0,
        "ELP 4K USB board, 3.6 mm": 60.0,
        "Logitech Brio": 160.0,
        "Logitech C920": 70.0,
        "Logitech C922": 90.0,
        "Luxonis OAK-D, colour": 260.0,
        "Raspberry Pi Camera Module 2": 17.0,
        "Raspberry Pi Camera Module 3": 30.0,
        "Raspberry Pi HQ, CS 6 mm": 85.0,
        "Raspberry Pi HQ, M12 8 mm": 75.0,
        "38 mm USB board, M12 lens": 45.0,
    },
    ("Another camera only with a new design: `mirrorcam camera list` names those that are known.",),
)

Entry = TypeVar("Entry")


def plain_title(title: str) -> str:
    """A title without its length: "M3 screw" for "M3 x 12 screw"."""
    return re.sub(r" x [\d.]+(?= )", "", title)


def by_name(title: str, table: Mapping[str, Entry]) -> Entry | None:
    """The entry of the longest name with which a title starts or ends; None if there is none."""
    matches = [name for name in table if title.startswith(name) or title.endswith(name)]
    return table[max(matches, key=len)] if matches else None


def good_of(title: str) -> Good | None:
    """What a thing is by its title, such as "M3 x 12 screw" or "first-surface glass mirror, 3 mm"; None if unknown."""
    return by_name(plain_title(title), GOODS)


def standard_of(title: str) -> str:
    """The standard of a purchased item by its title, or a description if there is none.

    Raises ValueError for an unknown title.
    """
    if (good := good_of(title)) is None:
        raise ValueError(f"{title=}: expected one that starts or ends with {', '.join(GOODS)}")
    return good.standard


def search_words(title: str, good: Good) -> str:
    """The words to search for."""
    name = max((name for name in GOODS if title.endswith(f" {name}")), key=len, default="")
    return good.search.format(size=title.removesuffix(name).strip().split(" filament")[0])


def price_eur(title: str) -> float | None:
    """Price of one purchased item or camera by its title; None if unknown."""
    good = good_of(title)
    prices = CAMERA.eur if good is None else good.eur
    sizes = [size for size in prices if title.startswith(size) and size not in (AREA, PIECE)]
    return prices[max(sizes, key=len)] if sizes else None
