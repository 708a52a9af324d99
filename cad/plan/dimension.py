"""Dimensions of a part for its drawing, in the rig frame: lengths, holes, datums and tables."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any, Literal, Protocol, Self, runtime_checkable

import numpy as np

from mirrorcam.cad.plan.fasteners import OUTSIDE_MM, Bore, Countersink, Hexagon
from mirrorcam.core.values import FloatArray

GENERAL_MM = 0.2
"""General tolerance of a drawing, plus or minus: the gap between parts and the light (`fit.light_mm`) absorbs it."""


@dataclass(frozen=True)
class Length:
    """The distance between two points (2, 3) in the rig frame, mm, drawn in a view that shows its true length.

    `way_in_rig` (3,), a unit vector, selects the component of the distance along that direction. `before` stands
    before the number ("Ø" for a diameter, "4x " for a repeated length, "R" for the radius from a centre to its arc),
    `text` after it. `minus_mm` and `plus_mm` are the deviations that its function permits.
    """

    points_in_rig: FloatArray
    text: str = ""
    way_in_rig: FloatArray | None = None
    before: str = ""
    minus_mm: float = GENERAL_MM
    plus_mm: float = GENERAL_MM

    @property
    def tolerance(self) -> str:
        """The permitted deviations after the number; empty where the general tolerance is sufficient."""
        if min(self.minus_mm, self.plus_mm) >= GENERAL_MM:
            return ""
        if self.minus_mm == self.plus_mm:
            return f" ±{self.plus_mm:g}"
        return f" +{self.plus_mm:g}/{-self.minus_mm or 0.0:g}"

    @property
    def span_in_rig(self) -> FloatArray:
        """The vector (3,) from the first point to the second, projected on `way_in_rig` if that is given."""
        first, second = self.points_in_rig
        direction = self.way_in_rig
        return np.asarray(second - first if direction is None else direction * ((second - first) @ direction))

    def rotated(self, rotation: FloatArray) -> Self:
        """The length in a frame rotated by (3, 3) about the origin."""
        way = None if self.way_in_rig is None else rotation @ self.way_in_rig
        return replace(self, points_in_rig=self.points_in_rig @ rotation.T, way_in_rig=way)


@dataclass(frozen=True)
class Datum:
    """A point (3,) in the rig frame from which holes are dimensioned, and the name of the feature at that point."""

    point_in_rig: FloatArray
    name: str


@dataclass(frozen=True)
class Hole:
    """A hole or a cylinder: centre of its mouth (3,) and axis (3,) in the rig frame; `text` follows the diameter.

    Holes with the same diameter, axis and text share one callout: "4x Ø3.4". If the tool's length along the axis,
    `cut_mm`, is given, the drawing states the hole's depth in the solid, or that it is a through hole. The diameter is
    the width across flats of a hexagon, the largest diameter of a countersink, and the width of a slot, which is longer
    by `travel_mm`. Without a `datum`, positions are measured from the edges of the view.
    """

    centre_in_rig: FloatArray
    axis_in_rig: FloatArray
    diameter_mm: float
    text: str = ""
    cut_mm: float | None = None
    form: Literal["round", "hexagon", "countersink"] = "round"
    travel_mm: float = 0.0
    datum: Datum | None = None

    def rotated(self, rotation: FloatArray) -> Self:
        """The hole in a frame rotated by (3, 3) about the origin."""
        datum = self.datum and replace(self.datum, point_in_rig=rotation @ self.datum.point_in_rig)
        centre, axis = rotation @ self.centre_in_rig, rotation @ self.axis_in_rig
        return replace(self, centre_in_rig=centre, axis_in_rig=axis, datum=datum)


@dataclass(frozen=True)
class DrawingTable:
    """A table of a drawing, with `notes` (short lines) below it; `left_aligned` are indices of columns."""

    title: str
    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    notes: tuple[str, ...] = ()
    left_aligned: tuple[int, ...] = ()


@runtime_checkable
class Dimensioned(Protocol):
    """A plan with dimensions for its drawing, in addition to the overall ones."""

    @property
    def dimensions(self) -> tuple[Length | Hole, ...]: ...


def holes(cuts: Iterable[Any]) -> tuple[Hole, ...]:
    """The holes among the cuts of a part: bores, slots, countersinks and pockets for nuts."""
    return tuple(_hole(cut) for cut in cuts if isinstance(cut, Bore | Countersink | Hexagon))


def _hole(cut: Bore | Countersink | Hexagon) -> Hole:
    mouth, depth = cut.mouth + OUTSIDE_MM * cut.axis, cut.depth_mm - OUTSIDE_MM
    if isinstance(cut, Countersink):
        tangent = (cut.radius_mm - cut.end_radius_mm) / cut.depth_mm
        radius = cut.radius_mm - OUTSIDE_MM * tangent
        angle = 2.0 * np.degrees(np.arctan(tangent))
        text = f"x {angle:.0f}°"
        return Hole(mouth, cut.axis, round(2.0 * radius, 3), text, depth, "countersink", cut.travel_mm)
    if isinstance(cut, Hexagon):
        return Hole(cut.mouth, cut.axis, round(cut.flats_mm, 3), "", cut.depth_mm, "hexagon")
    return Hole(mouth, cut.axis, round(2.0 * cut.radius_mm, 3), "", depth, travel_mm=cut.travel_mm)


def length(
    start: FloatArray, end: FloatArray, text: str = "", direction: FloatArray | None = None, before: str = ""
) -> Length:
    """The distance between two points (3,) in the rig frame, or its component along a direction (3,)."""
    return Length(np.array([start, end]), text, direction, before)
