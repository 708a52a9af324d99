"""Estimate the plastic of a print, with its infill, before it is sliced."""

from __future__ import annotations

import numpy as np
from manifold3d import JoinType, Manifold

from mirrorcam.cad.plan.hardware import PRINT_SETTINGS

SLICE_MM = 0.5
# Depth of a print's closed layers at faces that are not upright: three layers, and what the slicer adds below them to
# anchor bridges. With it, estimates are 0.95 to 1.01 times PrusaSlicer's mass over the holders of 19 devices, 1.07 to
# 1.08 times over their mounts, 1.0 to 1.3 times over their other parts, and 1.04 to 1.08 times over a device.
CLOSED_MM = 1.0
# Smallest area with infill (`write.slicer.LAYERS`).
INFILL_MM2 = 10.0


def printed_mm3(body: Manifold, wall_mm: float) -> float:
    """Volume of plastic of a body that prints along z, with closed walls and layers, and infill inside."""
    *_, low, _, _, high = body.bounding_box()
    count = max(1, int(np.ceil((high - low) / SLICE_MM)))
    step = (high - low) / count
    inside = 0.0
    for z in low + (np.arange(count) + 0.5) * step:
        if z - CLOSED_MM > low and z + CLOSED_MM < high:
            above, below = body.slice(z + CLOSED_MM), body.slice(z - CLOSED_MM)
            area = body.slice(z).offset(-wall_mm, JoinType.Miter) ^ above ^ below
            inside += step * sum(part.area() for part in area.decompose() if part.area() > INFILL_MM2)
    return float(body.volume()) - (1.0 - PRINT_SETTINGS.infill_percent / 100.0) * inside
