"""Whether inserts and nuts get to their seats, by the way that the pictures show: swept through their parts' meshes."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

import manifold3d
import numpy as np

from mirrorcam.cad.assembly.pieces import item_names
from mirrorcam.cad.checks.clashes import PRESSED_MM, ROUNDING_MM, common_mm3
from mirrorcam.cad.plan.part_plan import BoughtItem
from mirrorcam.core.values import Metric


def swept(solid: manifold3d.Manifold, moves_mm: np.ndarray) -> manifold3d.Manifold:
    """What the hull of a solid passes over by moves (n, 3), one after the other."""
    place, passed = solid.hull(), []
    for move in moves_mm:
        moved = place.translate(tuple(float(by) for by in move))
        passed.append(manifold3d.Manifold.batch_hull([place, moved]))
        place = moved
    return manifold3d.Manifold.batch_boolean(passed, manifold3d.OpType.Add)


def check_insertion(items: Sequence[BoughtItem], solids: Mapping[str, manifold3d.Manifold]) -> dict[str, Metric]:
    """Check that every insert and nut can be put in.

    Parameters
    ----------
    items : sequence of BoughtItem
        All bought items of a device, in the order of their names.
    solids : mapping of str to Manifold
        The solids of the assembled device by name, in rig, mm: bought items, and parts, which may be in pieces.

    Returns
    -------
    dict of str to Metric
        Volume that the ways to the seats have in common with the part that holds the seat, and the number of inserts
        and nuts whose way does not begin outside the hull of that part.
    """
    common, inside = 0.0, 0
    for name, item in zip(item_names(items), items, strict=True):
        if item.kind not in ("insert", "nut"):
            continue
        home = [solid for part, solid in solids.items() if re.fullmatch(rf"{item.joins[-1]}(_\d+)?", part)]
        if not home or not len(item.way_out_mm) or name not in solids:
            inside += 1
            continue
        part = manifold3d.Manifold.compose(home)
        pressed = PRESSED_MM if item.kind == "insert" else ROUNDING_MM
        common += common_mm3(part, swept(solids[name], item.way_out_mm), pressed)
        outside = solids[name].translate(tuple(float(by) for by in item.way_out_mm.sum(axis=0)))
        inside += not (part.hull() ^ outside).is_empty()
    return {
        "device.insertion_clash_mm3": Metric(value=common, unit="mm3", limit=0.0),
        "device.threads_that_cannot_enter": Metric(value=inside, unit="", limit=0),
    }
