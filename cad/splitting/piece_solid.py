"""A piece of a part as a B-rep solid: what lies between two cuts, with holes for its pins."""

from __future__ import annotations

import json
from collections.abc import Callable
from copy import deepcopy
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import numpy as np
from build123d import (
    Box,
    BuildPart,
    BuildSketch,
    Circle,
    Location,
    Locations,
    Mode,
    Part,
    Plane,
    Polygon,
    extrude,
    insert,
)

from mirrorcam.cad.plan.cuts import PiecePlan
from mirrorcam.cad.plan.fasteners import ROOF_DEG
from mirrorcam.cad.plan.part_plan import plain, recipe
from mirrorcam.core.values import FloatArray, InputError


@dataclass(frozen=True)
class _Whole:
    """A part before it is cut; the same numbers, the same part."""

    numbers: str
    plan: Any = field(compare=False)
    make: Callable[[Any], Part] = field(compare=False)


def whole_part(plan: Any, make: Callable[[Any], Part]) -> Part:
    """A part before it is cut, made once for all its pieces; each gets a copy, since booleans change their operands."""
    numbers = json.dumps([f"{make.__module__}.{make.__qualname__}", plain(plan)])
    return deepcopy(_make_whole(_Whole(numbers, plan, make)))


@lru_cache(maxsize=1)
def _make_whole(whole: _Whole) -> Part:
    return whole.make(whole.plan)


@recipe("cad.split.make_piece")
def make_piece(plan: PiecePlan) -> Part:
    """Cut a piece out of its part, and drill its holes for pins; raises InputError where it is not one solid."""
    low, high = np.array(plan.low_mm), np.array(plan.high_mm)
    with BuildPart() as piece:
        insert(whole_part(plan.whole, plan.make))
        with Locations(_plane(plan.rig_from_bed)), Locations(Location(tuple((low + high) / 2.0))):
            width, length, height = (high - low).tolist()
            Box(width, length, height, mode=Mode.INTERSECT)
        for frame in plan.rig_from_pins:
            # A hole lies when printed: its ceiling is a roof that needs no support.
            with BuildSketch(_plane(frame)):
                Circle(plan.hole_mm[0] / 2.0)
                Polygon(*_roof(plan.hole_mm[0] / 2.0), align=None)
            extrude(amount=plan.hole_mm[1], mode=Mode.SUBTRACT)
    solids = [solid for solid in piece.solids() if solid.volume > plan.crumb_mm**3]
    if len(solids) != 1:
        raise InputError(f"a piece cut for the printer's bed falls apart into {len(solids)}, expected one")
    return Part(solids)


def _plane(frame: FloatArray) -> Plane:
    """The plane z = 0 of a frame (4, 4)."""
    return Plane(origin=tuple(frame[:3, 3]), x_dir=tuple(frame[:3, 0]), z_dir=tuple(frame[:3, 2]))


def _roof(radius_mm: float) -> tuple[tuple[float, float], ...]:
    """The triangle on a circle whose upper sides are its tangents, `ROOF_DEG` from upright."""
    steep = np.radians(ROOF_DEG)
    side, height = radius_mm * np.cos(steep), radius_mm * np.sin(steep)
    return (-side, height), (side, height), (0.0, radius_mm / np.sin(steep))
