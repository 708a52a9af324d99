"""The dust cover over the assembled device: it meets nothing where it sits, nor on its way off."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import manifold3d
import numpy as np

from mirrorcam.cad.checks.clashes import ROUNDING_MM, common_mm3
from mirrorcam.cad.parts.dust_cover import CoverPlan
from mirrorcam.core.values import FloatArray, Metric

# The way is looked at in steps of this length.
STEP_MM = 4.0
# Catches give way by less than this as they pass the flange.
GIVES_MM = 0.3


def check_cover(
    plan: CoverPlan, cover: manifold3d.Manifold, solids: Mapping[str, manifold3d.Manifold]
) -> dict[str, Metric]:
    """Check the cover against all other solids of a device, in rig, mm.

    Returns
    -------
    dict of str to Metric
        Volume that the cover has in common with another solid where it sits, and the largest on its way off, at steps
        along the moves of its plan.
    """
    others = manifold3d.Manifold.compose(list(solids.values()))
    passed = [common_mm3(cover.translate(tuple(move.tolist())), others, GIVES_MM) for move in _places(plan.way_mm)]
    return {
        "dust_cover.clash_mm3": Metric(value=common_mm3(cover, others, ROUNDING_MM), unit="mm3", limit=0.0),
        "dust_cover.way_clash_mm3": Metric(value=max(passed), unit="mm3", limit=0.0),
    }


def _places(way_mm: FloatArray) -> Iterator[FloatArray]:
    """Shifts (3,) from the seat along moves (n, 3), one after the other."""
    done = np.zeros(3)
    for move in way_mm:
        steps = max(int(np.ceil(np.linalg.norm(move) / STEP_MM)), 1)
        yield from (done + move * share for share in np.arange(1, steps + 1) / steps)
        done = done + move
