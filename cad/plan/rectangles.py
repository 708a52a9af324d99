"""Rectangular mirrors of a layout, and the test mirror for the coupon's seat."""

from __future__ import annotations

from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror import Mirror
from mirrorcam.optics.geometry.mirror_gaps import edges_mm

TEST_MIRROR_MM = (20.0, 15.0)
"""Width and height of the test mirror, if mirrors are cut from a sheet."""


def is_rectangular(layout: Layout) -> bool:
    """Whether a layout was designed for rectangular mirrors."""
    return layout.spec is not None and layout.spec.rectangle_sizes is not None


def is_sold_in_size(layout: Layout) -> bool:
    """Whether a layout was designed for mirrors that are sold in their sizes, so that none is cut."""
    sizes = None if layout.spec is None else layout.spec.rectangle_sizes
    return sizes is not None and sizes.is_stock


def size_mm(mirror: Mirror) -> tuple[float, float]:
    """Longer and shorter side of a rectangular mirror, rounded to a micrometre."""
    shorter, longer = sorted(float(length) for length in edges_mm(mirror)[:2].round(3))
    return longer, shorter


def coupon_mirror_mm(layout: Layout) -> tuple[float, float]:
    """Width and height of a layout's test mirror; of sizes that are sold, a spare mirror of the smallest size."""
    if not is_sold_in_size(layout):
        return TEST_MIRROR_MM
    return min((size_mm(mirror) for mirror in layout.mirrors), key=lambda size: size[0] * size[1])
