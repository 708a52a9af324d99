"""Placement of a bent profile on the bed: as it is, at an angle, or cut in two, with blocks for the joining pins."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from shapely import Polygon, get_coordinates

from mirrorcam.cad.plan.cuts import clearance_round_pin_mm
from mirrorcam.cad.plan.hardware import Hardware
from mirrorcam.cad.plan.prisms import along_x
from mirrorcam.cad.plan.seats import Frustum
from mirrorcam.core.values import FloatArray

# Kept to the edge of the bed.
MARGIN_MM = 0.5
TURN_STEP_DEG = 5
# Along a piece of the profile a cut is tried at these parts of it, and at most so far from square.
CUTS_AT = (0.5, 0.45, 0.55, 0.4, 0.6, 0.35, 0.65, 0.3, 0.7, 0.25, 0.75, 0.2, 0.8, 0.15, 0.85)
CUTS_DEG = 32.0
BLOCK_MM = 16.0
FAR_MM = 1e4


@dataclass(frozen=True)
class Lay:
    """A profile (y and z in rig) on the bed, turned about the bed's upright by `turn_deg`.

    Where it fits only in two pieces, `cut_mm` is where along the bed's y it is cut, `at` (2, 2) are the points of its
    inner and outer side there, `along` (2,) is its direction in y and z.
    """

    turn_deg: float
    cut_mm: float | None = None
    at: FloatArray | None = None
    along: FloatArray | None = None


def lay(inner: FloatArray, outer: FloatArray, hardware: Hardware) -> Lay | None:
    """Turn a profile between two polylines (n, 2) as little as lets it fit; else cut its longest piece in two.

    None where neither helps.
    """
    bed = np.array(hardware.printer.bed_mm[:2])
    band = Polygon([*inner, *outer[::-1]]).buffer(MARGIN_MM, join_style="mitre")
    for degrees in range(0, 180, TURN_STEP_DEG):
        if fits(band, float(degrees), bed):
            return Lay(float(degrees))
    lengths = np.linalg.norm(np.diff(inner, axis=0), axis=1)[1:-1]
    if len(lengths) == 0:
        return None
    piece = 1 + int(lengths.argmax())
    along = (inner[piece + 1] - inner[piece]) / lengths.max()
    upright = 90.0 - float(np.degrees(np.arctan2(along[1], along[0])))
    turns = [float(degrees) for degrees in range(-90, 91, TURN_STEP_DEG) if abs(degrees - upright) <= CUTS_DEG]
    # As it is, if it can be.
    for turned in sorted(turns, key=abs):
        for part in CUTS_AT:
            near = inner[piece] + part * (inner[piece + 1] - inner[piece])
            cut = float((turn(turned) @ near)[1])
            if all(fits(half, turned, bed) for half in halves(band, turned, cut)):
                normal = np.array([-along[1], along[0]])
                depth = float((outer[piece] - inner[piece]) @ normal)
                far = near + depth * (normal - np.tan(np.deg2rad(turned - upright)) * along)
                at, long = np.array([near, far]), _block_mm(np.array([near, far]), along, hardware)[1]
                # No block stands out where the skins bend.
                starts = (at - [inner[piece], outer[piece]]) @ along
                ends = ([inner[piece + 1], outer[piece + 1]] - at) @ along
                if min(*starts, *ends) >= long:
                    return Lay(turned, cut, at, along)
    return None


def turn(degrees: float) -> FloatArray:
    """The rotation (2, 2) by an angle."""
    angle = np.deg2rad(degrees)
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


def fits(area: Polygon, degrees: float, bed: FloatArray) -> bool:
    """Return whether an area lies on the bed, turned."""
    return bool((np.ptp(get_coordinates(area) @ turn(degrees).T, axis=0) <= bed).all())


def halves(area: Polygon, degrees: float, cut_mm: float) -> tuple[Polygon, Polygon]:
    """The halves of an area below and above a cut across it as turned, turned back."""
    turned = Polygon(get_coordinates(area.exterior) @ turn(degrees).T)
    parts = (shapely.box(-FAR_MM, -FAR_MM, FAR_MM, cut_mm), shapely.box(-FAR_MM, cut_mm, FAR_MM, FAR_MM))
    below, above = (get_coordinates(turned.intersection(part).convex_hull) @ turn(degrees) for part in parts)
    return Polygon(below), Polygon(above)


def joint_blocks(laid: Lay, skin_mm: float, half_width_mm: float, hardware: Hardware) -> list[Frustum]:
    """Blocks on both skins at both ends of the width, so that a cut has space for its pins; none without a cut.

    Those at the end that prints last stand on slopes of 45 deg.
    """
    if laid.at is None or laid.along is None:
        return []
    normal = np.array([-laid.along[1], laid.along[0]])
    thick, long = _block_mm(laid.at, laid.along, hardware)
    blocks = []
    for point, inwards in zip(laid.at, (normal, -normal), strict=True):
        ends = np.array([point - long * laid.along, point + long * laid.along])
        profile = np.array([*ends, *(ends[::-1] + thick * inwards)])
        root = np.array([*ends, *(ends[::-1] + 0.5 * skin_mm * inwards)])
        blocks.append(along_x(profile, -half_width_mm, -half_width_mm + BLOCK_MM))
        blocks.append(along_x(profile, half_width_mm - BLOCK_MM, half_width_mm))
        top, foot = half_width_mm - BLOCK_MM, half_width_mm - BLOCK_MM - thick
        blocks.append(
            Frustum(
                np.column_stack([np.full(4, foot), root]),
                np.column_stack([np.full(4, top), profile]),
            )
        )
    return blocks


def _block_mm(at: FloatArray, along: FloatArray, hardware: Hardware) -> tuple[float, float]:
    """How thick a block is, and how far it reaches along its skin to either side of the cut through two points."""
    normal, span = np.array([-along[1], along[0]]), at[1] - at[0]
    askew = float(np.abs(span @ along) / np.abs(span @ normal))
    # 1 mm to spare, of which the depth of a pin's hole takes some.
    reach = hardware.holder.pin_mm[1] / 2.0 + hardware.printer.wall_mm + 1.0
    thick = 2.0 * clearance_round_pin_mm(hardware) + 1.0 + 2.0 * reach * askew
    return thick, reach + thick * askew
