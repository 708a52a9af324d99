"""Checks of the back: that the device stands, that a tripod's screw holds, and the stress where its load passes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import manifold3d
import numpy as np

from mirrorcam.cad.assembly.pieces import item_names
from mirrorcam.cad.backs.back import Back, Stand
from mirrorcam.cad.backs.blocks import TRIPOD
from mirrorcam.cad.plan.fasteners import thread_of
from mirrorcam.cad.plan.part_plan import BoughtItem, MassProperties
from mirrorcam.core.values import FloatArray, Metric

STANDARD_GRAVITY = 9.80665
# A device that is carried, knocked or moved by an arm bears so many times its weight.
TIMES_ITS_WEIGHT = 3.0
# Stress that a print bears across its layers for years: a sixth of what breaks it there at once, about 30 MPa of PLA
# (Kuznetsov et al., Strength of PLA components fabricated with fused deposition technology, Polymers 10, 2018).
STRESS_MPA = 5.0
TURNS = 3.0


def check_back(
    back: Back, items: Sequence[BoughtItem], solids: Mapping[str, manifold3d.Manifold], whole: MassProperties
) -> dict[str, Metric]:
    """Check a back under a device.

    Parameters
    ----------
    back : Back
        Its plan.
    items : sequence of BoughtItem
        All bought items of the device, in the order of their names.
    solids : mapping of str to Manifold
        The solids of the assembled device by name, in rig, mm.
    whole : MassProperties
        Of all pieces together.

    Returns
    -------
    dict of str to Metric
        The largest stress where the back's load passes, which is so many times the device's weight in any direction;
        of a device that stands by itself how far it can be tipped; and how many turns of a tripod's screw are in the
        nut that the back holds.
    """
    force = TIMES_ITS_WEIGHT * whole.mass_g / 1000.0 * STANDARD_GRAVITY
    stress = max((neck.stress_mpa(force, whole.centre_in_rig_mm) for neck in back.necks), default=0.0)
    checks = {"device.back_stress_mpa": Metric(value=round(stress, 3), unit="MPa", limit=STRESS_MPA)}
    if back.stand is not None:
        tips = tips_at_deg(back.stand, whole.centre_in_rig_mm)
        limit = back.stand.tip_deg
        checks["device.tips_at_deg"] = Metric(value=round(tips, 2), unit="deg", limit=limit, lower_is_better=False)
    for name, item in zip(item_names(items), items, strict=True):
        if item.kind == "nut" and item.size == TRIPOD:
            turns = tripod_turns(back.table.nut.screw_mm, solids.get(name), solids.get(item.joins[0]))
            checks["device.tripod_turns"] = Metric(value=round(turns, 2), unit="", limit=TURNS, lower_is_better=False)
    return checks


def tips_at_deg(stand: Stand, centre_mm: FloatArray) -> float:
    """The angle in deg by which a device may be tipped over any side of its support; negative where it falls at once.

    Its centre of mass (3,) passes over the side when tipped by atan(d / h), d its distance from the side as seen from
    above, h its height.
    """
    starts, ends = stand.corners, np.roll(stand.corners, -1, axis=0)
    ways = (ends - starts) / np.linalg.norm(ends - starts, axis=1)[:, None]
    inside = np.column_stack([-ways[:, 1], ways[:, 0]])
    middle = stand.corners.mean(axis=0)
    inside *= np.sign(((middle - starts) * inside).sum(axis=1))[:, None]
    distance = float(((centre_mm[:2] - starts) * inside).sum(axis=1).min())
    return float(np.degrees(np.arctan2(distance, centre_mm[2] - stand.z_mm)))


def tripod_turns(screw_mm: float, nut: manifold3d.Manifold | None, part: manifold3d.Manifold | None) -> float:
    """Turns of a screw that stands out by `screw_mm` in a nut over the lower face of a part; 0 where one is missing."""
    if nut is None or part is None:
        return 0.0
    under = nut.bounding_box()[2] - part.bounding_box()[2]
    thread = thread_of(TRIPOD)
    return max(0.0, min(screw_mm - under, thread.nut_height_mm)) / thread.pitch_mm
