"""The types of printed parts that exports, checks and documents use: plans, purchased items, built parts and joints."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, fields, is_dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Self, TypeVar

import numpy as np

from mirrorcam.core.disk.fingerprint import value_digest
from mirrorcam.core.values import FloatArray, Matrix3, Matrix4, Metric, Value, Vector3

if TYPE_CHECKING:
    from build123d import Part

    Make = TypeVar("Make", bound=Callable[[Any], Part])

Rgb = tuple[float, float, float]

FORMING = " thread-forming"
"""Suffix of the size of a thread-forming screw, which cuts its own thread in plastic."""


_RECIPES: dict[Callable[..., Any], str] = {}


def recipe(name: str) -> Callable[[Make], Make]:
    """Decorator that gives the function that makes a part a fixed name, which enters the part's identity.

    The identity is printed on drawings and stored in 3MF files. The fixed name preserves it when the function moves to
    another module. A function without a fixed name enters the identity under its own name.
    """

    def named(make: Make) -> Make:
        _RECIPES[make] = name
        return make

    return named


def _recipe_of(make: Callable[..., Any]) -> str:
    return _RECIPES.get(make, f"{make.__module__}.{make.__qualname__}")


@dataclass(frozen=True)
class NamedFace:
    """A named flat face of a part: the plane through a point (3,) with an outward normal (3,), in the rig frame, mm.

    It is the face nearest to the point or, with a polygon `within` (n, 3) in that plane, every face whose centre lies
    in the polygon.
    """

    name: str
    point: FloatArray
    normal: FloatArray
    within: FloatArray | None = None


@dataclass(frozen=True)
class PartPlan:
    """A part to print, before it is made: its dimensions, and the function that makes a solid from them.

    Both can be sent to another process. The part is made again only if `plan` changes.

    Parameters
    ----------
    name : str
        File name of the part without extension, unique in a device.
    title, number : str
        Title and part number of the part in documents.
    plan : Any
        The dimensions: a frozen dataclass of numbers, text, arrays, tuples and further dataclasses.
    make : Callable
        Function at module level; `make(plan)` returns one solid in the rig frame, mm, positioned as in the device.
    print_from_rig : (4, 4)
        Pose on the bed: z up, the lowest point at z = 0, mm.
    explode_mm : (3,)
        Displacement in an exploded view, in the rig frame.
    rgb : (float, float, float)
        Colour in pictures, from 0 to 1.
    faces : tuple of NamedFace
        Faces named in the STEP file.
    """

    name: str
    title: str
    number: str
    plan: Any
    make: Callable[[Any], Part]
    print_from_rig: FloatArray
    explode_mm: FloatArray
    rgb: Rgb
    faces: tuple[NamedFace, ...] = ()

    @cached_property
    def identity(self) -> str:
        """Digest of the part's dimensions, twelve hexadecimal digits: parts with the same digest are identical."""
        numbers = {"make": _recipe_of(self.make), "plan": plain(self.plan)}
        return value_digest(numbers)[:12]


def plain(value: Any) -> Any:
    """A plan as nested lists, numbers and text; raises TypeError for other types."""
    if isinstance(value, Value):
        return value.model_dump(mode="json")
    if is_dataclass(value) and not isinstance(value, type):
        return {item.name: plain(getattr(value, item.name)) for item in fields(value)}
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, tuple | list):
        return [plain(item) for item in value]
    if isinstance(value, dict):
        return {str(key): plain(item) for key, item in value.items()}
    if callable(value):
        return _recipe_of(value)
    if value is None or isinstance(value, str | int | float | bool):
        return value
    raise TypeError(f"a plan contains a {type(value).__name__}, expected numbers, text, arrays, tuples and dataclasses")


LICENCE = "CERN-OHL-W-2.0"
"""SPDX identifier of the licence of devices and their files; the program itself is under Apache-2.0."""

BoughtKind = Literal["screw", "washer", "spring", "insert", "nut", "pin"]


@dataclass(frozen=True)
class PurchasedItem:
    """A purchased item with its pose in the device.

    `rig_from_item` (4, 4) has its origin under a screw's head or a washer, or at the mouth of an insert's hole, and z
    along the axis, out of the material. `explode_mm` (3,) is the displacement in an exploded view, in the rig frame;
    `joins` names the parts that the item joins. `exit_moves_mm` (n, 3) are the successive moves in the rig frame by
    which an insert or a nut leaves its seat, the reverse of its assembly; other items have none. The length of a spring
    is its length in the device; its `size` gives wire diameter, mean diameter and free length. `lengths_mm` are the
    shortest and the longest screw that hold as well, if they are known.
    """

    kind: BoughtKind
    size: str
    length_mm: float
    rig_from_item: FloatArray
    explode_mm: FloatArray
    joins: tuple[str, ...]
    exit_moves_mm: FloatArray = field(default_factory=lambda: np.zeros((0, 3)))
    lengths_mm: tuple[float, float] | None = None


class MassProperties(Value):
    """Mass of a body of uniform density, its centre (3,), and its inertia (3, 3) about that centre, along rig axes.

    The density of a printed part is the mass of its walls and infill over its volume.
    """

    volume_mm3: float
    mass_g: float
    centre_in_rig_mm: Vector3
    inertia_g_mm2: Matrix3


class BuiltPart(Value):
    """A part with its files in `folder`: NAME.step, NAME.stl (both in the rig frame, mm) and NAME.3mf (as printed)."""

    name: str
    title: str
    number: str
    folder: Path
    rgb: Rgb
    print_from_rig: Matrix4
    explode_mm: Vector3
    mass: MassProperties
    checks: dict[str, Metric]

    @classmethod
    def of(cls, plan: PartPlan, folder: Path, mass: MassProperties, checks: dict[str, Metric]) -> Self:
        """The built part of a plan."""
        return cls(
            name=plan.name,
            title=plan.title,
            number=plan.number,
            folder=folder,
            rgb=plan.rgb,
            print_from_rig=plan.print_from_rig,
            explode_mm=plan.explode_mm,
            mass=mass,
            checks=checks,
        )

    @property
    def step(self) -> Path:
        return self.folder / f"{self.name}.step"

    @property
    def stl(self) -> Path:
        return self.folder / f"{self.name}.stl"


@dataclass(frozen=True)
class Connection:
    """A joint of two parts: its frame (4, 4) in the rig frame, once as each part's plan defines it.

    z points out of the parent. The child may move by up to `slides_mm` in either direction along the frame's x.
    """

    name: str
    parent: str
    child: str
    rig_from_parent_joint: FloatArray
    rig_from_child_joint: FloatArray
    slides_mm: float = 0.0
