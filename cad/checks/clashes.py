"""Clashes, contacts and clearances between the solids of a device, in the rig frame, mm, and of its dust cover."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from itertools import combinations

import manifold3d
import numpy as np

from mirrorcam.cad.parts.dust_cover import CoverPlan
from mirrorcam.cad.plan.device_names import CAMERA, CARRIER, HOLDER
from mirrorcam.core.values import FloatArray, Metric

# Largest overlap of touching faces due to the rounding of numbers in files.
ROUNDING_MM = 1e-4
# Largest overlap, and largest gap of a contact, of round shapes with one diameter, whose meshes have different corners.
PRESSED_MM = 0.1
TOUCH_MM = 0.08
# A pin is glued into slightly wider holes in two parts, and counts as fastened across a gap of this width.
PINNED_MM = 0.2
# Upper limit of measured gaps between solids.
MAX_GAP_MM = 10.0
# Prefixes of the names of fasteners, and of the threads that hold screws.
FASTENERS = ("screw", "washer", "spring", "insert", "nut", "pin")
THREADS = ("insert", "nut")
# Name of thread-forming screws, and their largest overlap with plastic: holes have about 0.8 of a screw's diameter.
FORMING = "screw_forming"
FORMED_MM = 0.25
# Name of screws in a camera's own threads.
IN_CAMERA = "screw_camera"
# The shell of the robot's wrist, and the clamp round it, bored to its diameter.
WRIST, CLAMP = "wrist", "adapter_"


@dataclass(frozen=True)
class SolidPair:
    """Two solids by name, with their overlap and the gap between them."""

    names: tuple[str, str]
    overlap_mm3: float
    gap_mm: float


def close_pairs(solids: Mapping[str, manifold3d.Manifold]) -> list[SolidPair]:
    """Pairs of solids closer to each other than `MAX_GAP_MM`."""
    boxes = {name: np.array(solid.bounding_box()).reshape(2, 3) for name, solid in solids.items()}
    pairs = []
    for names in combinations(solids, 2):
        (first_low, first_high), (second_low, second_high) = (boxes[name] for name in names)
        box_gap = float(np.maximum(first_low - second_high, second_low - first_high).max())
        if box_gap >= MAX_GAP_MM:
            continue
        first, second = (solids[name] for name in names)
        gap = first.min_gap(second, MAX_GAP_MM)
        depth = FORMED_MM if _forms(*names) else PRESSED_MM if _pressed(*names) else ROUNDING_MM
        if gap < MAX_GAP_MM:
            pairs.append(SolidPair(names, overlap_mm3(first, second, depth) if box_gap <= 0.0 else 0.0, gap))
    return pairs


def overlap_mm3(first: manifold3d.Manifold, second: manifold3d.Manifold, depth_mm: float = ROUNDING_MM) -> float:
    """Volume of the intersection of two solids, without contacts: pieces whose mean thickness is below `depth_mm`.

    The mean thickness of a thin piece is twice its volume over its surface.
    """
    (first_low, first_high), (second_low, second_high) = (
        np.array(solid.bounding_box()).reshape(2, 3) for solid in (first, second)
    )
    if (first_low >= second_high).any() or (second_low >= first_high).any():
        return 0.0
    pieces = (first ^ second).decompose()
    return float(sum(piece.volume() for piece in pieces if 2.0 * piece.volume() > depth_mm * piece.surface_area()))


def check_clashes(
    solids: Mapping[str, manifold3d.Manifold],
    min_mm: float,
    supports: Collection[str] = (),
    *,
    behind_mirrors_mm: float = 0.0,
) -> dict[str, Metric]:
    """Check overlaps of solids, gaps between solids that do not touch, and fasteners without contact.

    Reports on each part, the camera, each support, and each mirror or fastener that clashes. A gap of less than
    `min_mm` is neither a contact nor a clearance. The fits of fasteners in their holes are not checked. Solids named
    in `supports`, outside the device, have their own threads. Tape of the thickness `behind_mirrors_mm` connects
    mirrors to the holder.
    """
    pairs = close_pairs(solids)
    fasteners = [name for name in solids if name.startswith(FASTENERS)]
    others = [name for name in solids if name not in fasteners]
    overlaps = dict.fromkeys(solids, 0.0)
    gaps = dict.fromkeys(others, MAX_GAP_MM)
    touched: dict[str, set[str]] = {name: set() for name in solids}
    for pair in pairs:
        for name, other in (pair.names, pair.names[::-1]):
            overlaps[name] += pair.overlap_mm3
            taped = HOLDER in pair.names and any(map(is_mirror, pair.names))
            within_mm = PINNED_MM if name.startswith("pin") else TOUCH_MM + behind_mirrors_mm if taped else TOUCH_MM
            if pair.gap_mm <= within_mm:
                touched[name].add(other)
            elif name in gaps and other in gaps:
                gaps[name] = min(gaps[name], pair.gap_mm)
    mirrors = [name for name in others if is_mirror(name)]
    threadless = [
        name
        for name in fasteners
        if name.startswith("screw")
        and not any(
            _forms(name, other) or _in_camera(name, other) or other.startswith(THREADS) or other in supports
            for other in touched[name]
        )
    ]
    # A pin touches both parts that it joins.
    loose = [len(touched[name]) < (2 if name.startswith("pin") else 1) for name in fasteners]
    return {
        "device.clash_mm3": Metric(value=sum(pair.overlap_mm3 for pair in pairs), unit="mm3", limit=0.0),
        "device.clearance_mm": _clearance(min(gaps.values(), default=MAX_GAP_MM), min_mm),
        "device.mirrors_off_their_seats": Metric(
            value=sum(not any(n.startswith((HOLDER, CARRIER)) for n in touched[name]) for name in mirrors),
            unit="",
            limit=0,
        ),
        "device.fasteners_loose": Metric(value=sum(loose), unit="", limit=0),
        "device.screws_without_thread": Metric(value=len(threadless), unit="", limit=0),
        **{
            f"{name}.clash_mm3": Metric(value=volume, unit="mm3", limit=0.0)
            for name, volume in overlaps.items()
            if volume > 0.0 or not (is_mirror(name) or name in fasteners)
        },
        **{f"{name}.clearance_mm": _clearance(gap, min_mm) for name, gap in gaps.items() if not is_mirror(name)},
    }


def is_mirror(name: str) -> bool:
    """Return whether a piece of this name is a mirror."""
    return name.startswith("mirror_") and not name.startswith(HOLDER)


def _clearance(gap_mm: float, min_mm: float) -> Metric:
    return Metric(value=round(gap_mm, 4), unit="mm", limit=min_mm, lower_is_better=False)


def _forms(first: str, second: str) -> bool:
    """Return whether one of two solids is a thread-forming screw and the other a part."""
    return any(
        inner.startswith(FORMING) and not (outer.startswith(FASTENERS) or outer == CAMERA or is_mirror(outer))
        for inner, outer in ((first, second), (second, first))
    )


def _in_camera(screw: str, other: str) -> bool:
    """Return whether a solid is a screw in a camera's own thread, and the other the camera."""
    return screw.startswith(IN_CAMERA) and other == CAMERA


def _pressed(first: str, second: str) -> bool:
    """Return whether one of two solids sits in a hole of the same diameter in the other.

    Such pairs are an insert or pin in a part, a screw in its thread, and the wrist in its clamp.
    """
    for inner, outer in ((first, second), (second, first)):
        if inner == WRIST and outer.startswith(CLAMP):
            return True
        if inner.startswith(("insert", "pin")) and not outer.startswith(FASTENERS):
            return True
        if inner.startswith("screw") and (outer.startswith(THREADS) or _in_camera(inner, outer)):
            return True
    return False


# Step along the removal of the cover.
STEP_MM = 4.0
# Upper bound of the deflection of catches as they pass the flange.
DEFLECTION_MM = 0.3


def check_cover(
    plan: CoverPlan, cover: manifold3d.Manifold, solids: Mapping[str, manifold3d.Manifold]
) -> dict[str, Metric]:
    """Check the cover against all other solids of a device, in the rig frame, mm.

    Returns
    -------
    dict of str to Metric
        Overlap of the seated cover with other solids, and the largest overlap at steps along its removal.
    """
    others = manifold3d.Manifold.compose(list(solids.values()))
    overlaps = [
        overlap_mm3(cover.translate(tuple(shift.tolist())), others, DEFLECTION_MM)
        for shift in _removal_shifts(plan.way_mm)
    ]
    return {
        "dust_cover.clash_mm3": Metric(value=overlap_mm3(cover, others, ROUNDING_MM), unit="mm3", limit=0.0),
        "dust_cover.way_clash_mm3": Metric(value=max(overlaps), unit="mm3", limit=0.0),
    }


def _removal_shifts(moves_mm: FloatArray) -> Iterator[FloatArray]:
    """Shifts (3,) from the seat along successive moves (n, 3)."""
    start = np.zeros(3)
    for move in moves_mm:
        steps = max(int(np.ceil(np.linalg.norm(move) / STEP_MM)), 1)
        yield from (start + move * fraction for fraction in np.arange(1, steps + 1) / steps)
        start = start + move
