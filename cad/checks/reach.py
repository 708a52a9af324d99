"""Access to fasteners: the volumes that they and their tools sweep must be clear of the parts present at that step.

- An insert is pressed into its single part by a soldering iron.
- A screw enters along its axis and is turned by a straight driver or, if that does not reach, by a hex key, which
  swings by a sixth of a turn before it is repositioned (ISO 2936).
- A nut is pushed along its path by a rod as thick as closed tweezers, from 40 mm beyond the outer end of the path.

Inserts and nuts are swept through the meshes of their parts along the exit moves of the guide's pictures.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence

import manifold3d
import numpy as np

from mirrorcam.cad.assembly.build_steps import is_piece_of, parts_when_joined
from mirrorcam.cad.assembly.components import item_names
from mirrorcam.cad.checks.clashes import FASTENERS, PRESSED_MM, ROUNDING_MM, overlap_mm3
from mirrorcam.cad.plan.part_plan import PurchasedItem
from mirrorcam.cad.plan.threads import COUNTERSUNK, SUNK_HEAD, diameter_mm
from mirrorcam.core.values import FloatArray, Metric


def swept(solid: manifold3d.Manifold, moves_mm: np.ndarray) -> manifold3d.Manifold:
    """The volume that the convex hull of a solid sweeps in successive moves (n, 3)."""
    current, hulls = solid.hull(), []
    for move in moves_mm:
        shifted = current.translate(tuple(float(shift) for shift in move))
        hulls.append(manifold3d.Manifold.batch_hull([current, shifted]))
        current = shifted
    return manifold3d.Manifold.batch_boolean(hulls, manifold3d.OpType.Add)


def check_insertion(items: Sequence[PurchasedItem], solids: Mapping[str, manifold3d.Manifold]) -> dict[str, Metric]:
    """Check that every insert and nut can be inserted.

    Parameters
    ----------
    items : sequence of PurchasedItem
        All purchased items of a device, in the order of their names.
    solids : mapping of str to Manifold
        The solids of the assembled device by name, in the rig frame, mm: purchased items, and parts or their pieces.

    Returns
    -------
    dict of str to Metric
        Overlap of the paths to the seats with the parts of the seats, and the number of inserts and nuts whose path
        does not start outside the convex hull of its part.
    """
    overlap, blocked = 0.0, 0
    for name, item in zip(item_names(items), items, strict=True):
        if item.kind not in ("insert", "nut"):
            continue
        seat_solids = [solid for part, solid in solids.items() if re.fullmatch(rf"{item.joins[-1]}(_\d+)?", part)]
        if not seat_solids or not len(item.exit_moves_mm) or name not in solids:
            blocked += 1
            continue
        part = manifold3d.Manifold.compose(seat_solids)
        depth = PRESSED_MM if item.kind == "insert" else ROUNDING_MM
        overlap += overlap_mm3(part, swept(solids[name], item.exit_moves_mm), depth)
        start = solids[name].translate(tuple(float(shift) for shift in item.exit_moves_mm.sum(axis=0)))
        blocked += not (part.hull() ^ start).is_empty()
    return {
        "device.insertion_clash_mm3": Metric(value=overlap, unit="mm3", limit=0.0),
        "device.threads_that_cannot_enter": Metric(value=blocked, unit="", limit=0),
    }


# The barrel of a soldering iron behind its tip, which is inside the insert: diameter and length.
IRON_MM = (8.0, 30.0)
# Diameter and length of a driver's handle, and of its blade by screw diameter.
HANDLE_MM = (20.0, 30.0)
BLADES_MM = {2.0: (3.0, 50.0), 3.0: (4.0, 75.0), 4.0: (4.5, 75.0), 5.0: (5.0, 75.0), 6.0: (6.0, 100.0)}
OTHER_BLADE_MM = (6.0, 100.0)
# Hex keys (ISO 2936): width across corners, short and long arm, by screw diameter.
KEYS_MM = {2.0: (1.7, 14.0, 45.0), 3.0: (2.9, 18.0, 56.0), 4.0: (3.4, 20.0, 63.0), 5.0: (4.6, 25.0, 70.0)}
COUNTERSUNK_KEYS_MM = {3.0: (2.3, 16.0, 50.0), 4.0: (2.9, 18.0, 56.0)}
# Swing of a hex key, and number of tested orientations.
KEY_SWING_DEG, KEY_ORIENTATIONS = 60.0, 12
# Diameter of the rod that pushes a nut, and the distance beyond the path at which it starts.
ROD_MM = (2.5, 40.0)
# Clearance of a tool, such as a soldering iron over the part's face.
CLEARANCE_MM = 0.05
SEGMENTS = 48


def check_tool_reach(items: Sequence[PurchasedItem], solids: Mapping[str, manifold3d.Manifold]) -> dict[str, Metric]:
    """Check that a tool reaches every screw, insert and nut.

    Parameters
    ----------
    items : sequence of PurchasedItem
        All purchased items of a device, in the order of their names.
    solids : mapping of str to Manifold
        The solids of the assembled device by name, in the rig frame, mm: parts, mirrors and camera; fasteners are
        ignored.

    Returns
    -------
    dict of str to Metric
        The largest overlap of a fastener's tool with the parts present, and the overlap of each tool that clashes.
    """
    others = {name: solid for name, solid in solids.items() if not name.startswith(FASTENERS)}
    clashes = {
        name: clash
        for name, item in zip(item_names(items), items, strict=True)
        if (clash := tool_clash_mm3(item, others)) > 0.0
    }
    worst = max(clashes.values(), default=0.0)
    return {
        "device.tool_clash_mm3": Metric(value=round(worst, 3), unit="mm3", limit=0.0),
        **{
            f"{name}.tool_clash_mm3": Metric(value=round(clash, 3), unit="mm3", limit=0.0)
            for name, clash in clashes.items()
        },
    }


def tool_clash_mm3(item: PurchasedItem, solids: Mapping[str, manifold3d.Manifold]) -> float:
    """Overlap in mm3 of the best tool for a fastener with those solids (by name) that are present at its step."""
    if item.kind not in ("insert", "nut", "screw"):
        return 0.0
    if item.kind in ("insert", "nut"):
        obstacles = [solid for name, solid in solids.items() if is_piece_of(name, item.joins[-1])]
    else:
        obstacles = [solids[name] for name in sorted(parts_when_joined(item.joins, solids))]
    return best_tool_clash_mm3(item, obstacles)


def best_tool_clash_mm3(item: PurchasedItem, obstacles: Iterable[manifold3d.Manifold]) -> float:
    """Overlap in mm3 of the best tool for a fastener with obstacles."""
    obstacle, least = manifold3d.Manifold.compose(list(obstacles)), np.inf
    for tool in _tools(item):
        least = min(least, overlap_mm3(obstacle, tool, PRESSED_MM))
        if least == 0.0:
            break
    return least


def _tools(item: PurchasedItem) -> Iterator[manifold3d.Manifold]:
    """The volume that each possible tool for a fastener occupies, in the rig frame."""
    frame = item.rig_from_item
    if item.kind == "insert":
        yield _in_rig(_cylinder(*IRON_MM, CLEARANCE_MM), frame)
        return
    if item.kind == "nut":
        yield _rod_sweep(item)
        return
    diameter = diameter_mm(item.size)
    countersunk = item.size.endswith(COUNTERSUNK)
    head_mm = (SUNK_HEAD * diameter, 0.0) if countersunk else (1.9 * diameter, diameter)
    head = _cylinder(head_mm[0], item.length_mm + head_mm[1], CLEARANCE_MM)
    blade, blade_length = BLADES_MM.get(diameter, OTHER_BLADE_MM)
    top = CLEARANCE_MM + head_mm[1]
    driver = _cylinder(blade, blade_length, top) + _cylinder(*HANDLE_MM, top + blade_length)
    yield _in_rig(head + driver, frame)
    keys = COUNTERSUNK_KEYS_MM if countersunk else KEYS_MM
    key_width, short_arm, long_arm = keys.get(diameter, KEYS_MM[5.0])
    arm = _cylinder(key_width, short_arm, top)
    swings = np.radians(np.linspace(0.0, KEY_SWING_DEG, 7))
    for angle in np.linspace(0.0, 2.0 * np.pi, KEY_ORIENTATIONS, endpoint=False):
        ends = np.array([(long_arm * np.cos(angle + swing), long_arm * np.sin(angle + swing)) for swing in swings])
        fan = manifold3d.Manifold.hull_points(
            np.vstack(
                [[(0.0, 0.0, z), *((x, y, z) for x, y in ends)] for z in (top + short_arm - key_width, top + short_arm)]
            )
        )
        yield _in_rig(head + arm + fan, frame)


def _rod_sweep(item: PurchasedItem) -> manifold3d.Manifold:
    """The sweep of a rod along all legs of a nut's path, and beyond its end."""
    path = item.rig_from_item[:3, 3] + np.concatenate([np.zeros((1, 3)), np.cumsum(item.exit_moves_mm, axis=0)])
    if len(path) > 1:
        direction = item.exit_moves_mm[-1] / np.linalg.norm(item.exit_moves_mm[-1])
        path[-1] = path[-1] + ROD_MM[1] * direction
    to_centre = -item.length_mm / 2.0 * item.rig_from_item[:3, 2]
    ball = manifold3d.Manifold.sphere(ROD_MM[0] / 2.0, 24).translate(tuple(path[0] + to_centre))
    return swept(ball, np.diff(path, axis=0)) if len(path) > 1 else ball


def _cylinder(diameter_mm: float, length_mm: float, start_mm: float) -> manifold3d.Manifold:
    """A cylinder along z that starts at a height."""
    rod = manifold3d.Manifold.cylinder(length_mm, diameter_mm / 2.0, circular_segments=SEGMENTS)
    return rod.translate((0.0, 0.0, start_mm))


def _in_rig(solid: manifold3d.Manifold, rig_from_item: FloatArray) -> manifold3d.Manifold:
    return solid.transform(rig_from_item[:3])
