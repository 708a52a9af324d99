"""How far from the views things are, as the layout says: where it was calibrated, and what it was designed for."""

from __future__ import annotations

import numpy as np

from mirrorcam.optics.geometry.layout import Layout

METRIC = "working_distance_mm"
"""Median distance of the calibration's corners from the views, in the metrics of a calibrated layout."""
VOLUME = (0.7, 1.0, 1.4)
"""Distances within the working volume, relative to the working distance."""


def working_distance_mm(layout: Layout) -> float | None:
    """Where the calibration's boards were, or the middle of the depths that the device was designed for."""
    found = layout.metrics.get(METRIC)
    if found is not None and found.known:
        return found.value
    return None if layout.spec is None else float(np.mean(layout.spec.depths_mm))


def working_range_mm(layout: Layout) -> tuple[float, float] | None:
    """Least and greatest distance of the working volume around the boards and of the depths of the design."""
    depths = [] if layout.spec is None else list(layout.spec.depths_mm)
    found = layout.metrics.get(METRIC)
    if found is not None and found.known:
        depths += [factor * found.value for factor in VOLUME]
    return (min(depths), max(depths)) if depths else None
