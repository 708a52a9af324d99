"""Printed parts as exports, checks and documents see them: plans and joints before, files after they are made."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, fields, is_dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Self

import numpy as np

from mirrorcam.core.disk.fingerprint import value_digest
from mirrorcam.core.values import FloatArray, Matrix3, Matrix4, Metric, Value, Vector3

if TYPE_CHECKING:
    from build123d import Part

Rgb = tuple[float, float, float]

FORMING = " thread-forming"
"""End of the size of a screw that cuts its thread itself, in plastic."""


@dataclass(frozen=True)
class NamedFace:
    """A flat face of a part that has a name: in the plane of a point (3,) and its outward normal (3,), in rig, mm.

    It is the nearest face to the point; with a polygon `within` (n, 3) in that plane, each face with its middle in it.
    """

    name: str
    point: FloatArray
    normal: FloatArray
    within: FloatArray | None = None


@dataclass(frozen=True)
class PartPlan:
    """A part to print, before it is made: plain numbers, and the function that makes a solid of them.

    Both travel to another process, and `plan` alone decides whether the part has to be made again.

    Parameters
    ----------
    name : str
        Stem of the part's files, unique in a device.
    title, number : str
        Title and part number of the part in documents.
    plan : Any
        The numbers: a frozen dataclass of numbers, text, arrays, tuples and further such dataclasses.
    make : Callable
        `make(plan)` gives one solid in rig, mm, as it stands in the assembled device; a function of a module.
    print_from_rig : (4, 4)
        Lays the part on the bed: z up, the lowest point at z = 0, mm.
    explode_mm : (3,)
        How far the part is moved, in rig, in an exploded view.
    rgb : (float, float, float)
        Colour in pictures, from 0 to 1.
    faces : tuple of NamedFace
        Faces that have names in its STEP file.
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
        """Twelve hexadecimal digits over the part's numbers and the name of the function that makes it of them.

        The same identity means the same part, in whatever module the function stands. It is engraved into the part,
        printed on its drawing and kept in its 3MF file.
        """
        numbers = {"make": self.make.__name__, "plan": plain(self.plan)}
        return value_digest(numbers)[:12]


def plain(value: Any) -> Any:
    """A plan as nested lists, numbers and text; raises TypeError for anything that is not plain data."""
    if isinstance(value, Value):
        return value.model_dump(mode="json")
    if is_dataclass(value) and not isinstance(value, type):
        return {each.name: plain(getattr(value, each.name)) for each in fields(value)}
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, tuple | list):
        return [plain(item) for item in value]
    if isinstance(value, dict):
        return {str(key): plain(item) for key, item in value.items()}
    if callable(value):
        return value.__name__
    if value is None or isinstance(value, str | int | float | bool):
        return value
    raise TypeError(f"a plan holds a {type(value).__name__}, expected numbers, text, arrays, tuples and dataclasses")


LICENCE = "CERN-OHL-W-2.0"
"""Of devices and their files, by its SPDX identifier; the program that makes them is under Apache-2.0."""

BoughtKind = Literal["screw", "washer", "spring", "insert", "nut", "pin"]


@dataclass(frozen=True)
class BoughtItem:
    """A bought piece in its place.

    `rig_from_item` (4, 4) has its origin under a screw's head or a washer, or at the mouth of an insert's hole, and z
    along the axis, out of the material. `explode_mm` (3,) is how far it is moved, in rig, in an exploded view; `joins`
    are the names of the parts that it joins. `way_out_mm` (n, 3) are the moves in rig, one after the other, by which an
    insert or a nut leaves its seat; backwards, they are how it is put in. Others have none. A spring is as long
    as it is in the device; its `size` has wire, mean diameter and free length.
    """

    kind: BoughtKind
    size: str
    length_mm: float
    rig_from_item: FloatArray
    explode_mm: FloatArray
    joins: tuple[str, ...]
    way_out_mm: FloatArray = field(default_factory=lambda: np.zeros((0, 3)))


class MassProperties(Value):
    """A solid of uniform density: mass, its centre (3,) in rig, inertia (3, 3) about that, along the rig's axes."""

    volume_mm3: float
    mass_g: float
    centre_in_rig_mm: Vector3
    inertia_g_mm2: Matrix3


class BuiltPart(Value):
    """A part with its files: `folder` holds NAME.step, NAME.stl (both in rig, mm) and NAME.3mf (as printed)."""

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
    """A joint of two parts: the same frame, once from the plan of each; both (4, 4) in rig.

    z points out of the parent. `slides_mm` is how far the child may move either way along the frame's x.
    """

    name: str
    parent: str
    child: str
    rig_from_parent_joint: FloatArray
    rig_from_child_joint: FloatArray
    slides_mm: float = 0.0
