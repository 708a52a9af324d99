"""What a drawing says of a hole: its size, its depth in the material or that it goes through, and what it is for."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from itertools import pairwise

import numpy as np
from build123d import Part
from OCP.BRepClass3d import BRepClass3d_SolidClassifier
from OCP.gp import gp_Dir, gp_Lin, gp_Pnt
from OCP.IntCurvesFace import IntCurvesFace_ShapeIntersector
from OCP.TopAbs import TopAbs_State

from mirrorcam.cad.plan.dimension import Hole
from mirrorcam.cad.plan.fasteners import NUT_FIT_MM, OUTSIDE_MM
from mirrorcam.cad.plan.hardware import Fastening
from mirrorcam.core.values import FloatArray

THROUGH = "through"
INSERT, NUT = "for M3 insert", "for M3 nut"
DEPTH = "↧"
"""The symbol of depth (ISO 129-1)."""

PRESSED = "±0.1"
"""Tolerance of what holds an insert or a nut: by so much the steps of the fit coupon differ, and only one fits."""

# The wall of a hole is looked for this far outside it, its floor or shoulder at this share of its radius. One that
# closes by a cone has its shoulder somewhat later, by up to this share.
BESIDE_MM = 0.05
INWARD = 0.9
BEYOND_MM = 0.03
CONE = 0.15
SAME_MM = 1e-3


class Material:
    """Where a solid has material, asked along lines and at points in rig, mm."""

    def __init__(self, solid: Part) -> None:
        shape = solid.wrapped
        self._inside = BRepClass3d_SolidClassifier(shape)
        self._crossed = IntCurvesFace_ShapeIntersector()
        self._crossed.Load(shape, 1e-6)

    def holds(self, point: FloatArray) -> bool:
        """Whether a point (3,) lies inside the material."""
        self._inside.Perform(gp_Pnt(*point.tolist()), 1e-6)
        return bool(self._inside.State() == TopAbs_State.TopAbs_IN)

    def along(self, start: FloatArray, way: FloatArray, length_mm: float) -> list[tuple[float, float]]:
        """The stretches (from, to) of a line from a point (3,) along a unit vector (3,) that run in the material."""
        self._crossed.Perform(gp_Lin(gp_Pnt(*start.tolist()), gp_Dir(*way.tolist())), 0.0, length_mm)
        found = [self._crossed.WParameter(i + 1) for i in range(self._crossed.NbPnt())]
        stops = np.unique(np.round([0.0, *found, length_mm], 6))
        return [
            (float(low), float(high))
            for low, high in pairwise(stops)
            if high - low > SAME_MM and self.holds(start + (low + high) / 2.0 * way)
        ]


def called_out(holes: Iterable[Hole], solid: Part, screw: Fastening, pressed: str = PRESSED) -> tuple[Hole, ...]:
    """The holes with their full text; the axis of a blind one then runs from its open end into the material.

    Parameters
    ----------
    holes : iterable of Hole
        Those without `cut_mm` stay as they are.
    solid : Part
        The part, in rig.
    screw : Fastening
        What says which holes are for an insert, a nut or a screw.
    pressed : str
        The tolerance of those for an insert or a nut, "" of gauges, which differ by as much.
    """
    material = Material(solid)
    return tuple(hole if hole.cut_mm is None else _called_out(hole, material, screw, pressed) for hole in holes)


def _called_out(hole: Hole, material: Material, screw: Fastening, pressed: str) -> Hole:
    axis = hole.axis_in_rig / np.linalg.norm(hole.axis_in_rig)
    assert hole.cut_mm is not None
    if hole.form == "countersink":
        # Its axis already runs from its mouth into the material.
        return hole
    start, end = hole.centre_in_rig, hole.centre_in_rig + hole.cut_mm * axis
    across = _across(axis)
    radius = hole.diameter_mm / 2.0

    def floor(end: FloatArray, out: FloatArray) -> bool:
        """Whether material faces the tool's end: all round, so that another cut beside it is not taken for none."""
        return any(
            sum(material.holds(end + beyond * out + INWARD * radius * way) for way in across) >= len(across) / 2
            for beyond in (BEYOND_MM, CONE * radius)
        )

    closed_start = floor(start - OUTSIDE_MM * axis, -axis)
    closed_end = floor(end, axis)
    if closed_start == closed_end:
        return replace(hole, text=_joined(hole.text, THROUGH, _purpose(hole, screw, through=True)))
    # From its closed end to the last of the walls that follow.
    origin, way = (end, -axis) if closed_end else (start - OUTSIDE_MM * axis, axis)
    # Of a slot the walls are across its length: of eight ways one is within 22.5 deg of square to that.
    beside = (radius + BESIDE_MM) / (np.cos(np.pi / 8.0) if hole.travel_mm else 1.0)
    walls = [high for side in across for _, high in material.along(origin + beside * side, way, hole.cut_mm)[-1:]]
    deep = max(walls, default=hole.cut_mm)
    depth = f"{DEPTH}{deep:.2f}".rstrip("0").rstrip(".")
    purpose = _purpose(hole, screw, through=False)
    text = _joined(hole.text, pressed if purpose in (INSERT, NUT) else "", depth, purpose)
    return replace(hole, text=text, centre_in_rig=origin + deep * way, axis_in_rig=-way)


def _across(axis: FloatArray) -> list[FloatArray]:
    """Eight directions (3,) across an axis (3,)."""
    first = np.cross(axis, np.eye(3)[int(np.argmin(np.abs(axis)))])
    first /= np.linalg.norm(first)
    second = np.cross(axis, first)
    turns = np.deg2rad(22.5 + 45.0 * np.arange(8))
    return [np.cos(turn) * first + np.sin(turn) * second for turn in turns]


def _purpose(hole: Hole, screw: Fastening, *, through: bool) -> str:
    def same(size_mm: float) -> bool:
        return abs(hole.diameter_mm - size_mm) < SAME_MM

    if hole.form == "hexagon":
        return NUT if same(screw.nut_flats_mm + NUT_FIT_MM) else ""
    if screw.kind == "insert" and not through and same(screw.insert_hole_mm):
        return INSERT
    return "for M3" if through and same(screw.clearance_hole_mm) else ""


def _joined(*texts: str) -> str:
    return " ".join(text for text in texts if text)
