"""Cards of devices that nobody has made, for tests of the page."""

from __future__ import annotations

from docs.gallery.page import AtDepth, GalleryCard

NINE = GalleryCard(
    name="nine-views",
    title="Nine views",
    purpose="for a first light field camera",
    views="3 x 3",
    mirror_count=9,
    camera="Logitech C920",
    mount="a desk, or a tripod",
    mirrors="first-surface acrylic, 1 mm, glued",
    fasteners="heat-set inserts",
    size_mm=(101.0, 214.4, 130.2),
    mass_g=403.2,
    price=91.4,
    currency="EUR",
    print_minutes=1077.0,
    at_depths=(
        AtDepth(depth_mm=300.0, pixel_efficiency=0.691, usable_efficiency=0.604, sigma_mm=0.0889),
        AtDepth(depth_mm=500.0, pixel_efficiency=0.635, usable_efficiency=0.556, sigma_mm=0.172),
    ),
    focus_mm=411.0,
    checks=184,
    zip_bytes=12_300_000,
)
TWO = NINE.replaced(
    name="two-views",
    title="Two views",
    purpose="for a course in stereo vision",
    views="1 x 2",
    mirror_count=2,
    camera="Raspberry Pi Camera Module 3",
    mount="a tripod",
    mass_g=120.0,
    price=40.0,
    print_minutes=420.0,
    checks=160,
)
HEX = NINE.replaced(
    name="seven-views", title="Seven views", views="hex7", mirror_count=7, mount="a tripod", price=140.0
)
CARDS = (NINE, TWO, HEX)
