"""The interface of a back of your own: a function gets the face of the mount's foot, and returns a part under it.

Both are in the frame of that face, in mm: the origin is the centre of the four screws, x points to the right, y level
towards the scene, and z up into the mount, so that the part has z <= 0.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from mirrorcam.cad.plan.threads import thread_of
from mirrorcam.core.errors import InputError
from mirrorcam.core.names import LONGEST

if TYPE_CHECKING:
    from build123d import Plane, Solid

    from mirrorcam.cad.plan.seats import Frustum

Point = tuple[float, float, float]


@dataclass(frozen=True)
class MountFace:
    """The lower face of the mount's foot, and the device above it, in the frame of that face, mm.

    Attributes
    ----------
    screws_mm : tuple of (float, float)
        x and y of the four screws, whose holes are cut into the part.
    thread : str
        Thread of the screws, such as "M3".
    grip_mm : float
        Height of the material between the face and the heads of the screws.
    head_mm : float
        Diameter of the holes for heads and screwdriver, which are cut down from there: leave a wall round them.
    low_mm, high_mm : (float, float)
        x and y of the rear left and the front right corner of the face.
    look : (float, float, float)
        Unit vector of the views.
    load_g, load_mm : float, (float, float, float)
        Upper bound of the mass of mount, mirrors and camera, and its centre.
    light_volumes : tuple of Frustum
        Convex volumes that light passes.
    """

    screws_mm: tuple[tuple[float, float], ...]
    thread: str
    grip_mm: float
    head_mm: float
    low_mm: tuple[float, float]
    high_mm: tuple[float, float]
    look: Point
    load_g: float
    load_mm: Point
    light_volumes: tuple[Frustum, ...] = ()

    @property
    def light(self) -> tuple[Solid, ...]:
        """Solids that light passes, which the part must not enter."""
        from mirrorcam.cad.holder.holder_solid import solid_of

        return tuple(solid_of(volume) for volume in self.light_volumes)


@dataclass(frozen=True)
class Fastener:
    """A purchased fastener of an adapter, for the parts list, the pictures and the checks; its hole is the part's.

    Parameters
    ----------
    kind : "screw", "nut", "insert" or "washer"
        Kind of the fastener.
    size : str
        Its thread, such as "M4" or "1/4-20 UNC"; "M4 countersunk" for a countersunk screw.
    length_mm : float
        Length of a screw under its head (over all if countersunk), height of a nut or an insert.
    plane : Plane
        Origin under the head of a screw, or at the outer end of a nut or an insert; z out of the material.
    """

    kind: Literal["screw", "nut", "insert", "washer"]
    size: str
    length_mm: float
    plane: Plane

    def __post_init__(self) -> None:
        kinds = ("screw", "nut", "insert", "washer")
        if self.kind not in kinds:
            raise InputError(f"kind of a fastener is {self.kind!r}, expected one of {', '.join(kinds)}")
        try:
            thread_of(self.size)
        except ValueError as error:
            raise InputError(str(error)) from None


@dataclass(frozen=True)
class Adapter:
    """A part that carries the device, in the frame of the `MountFace`, with all that is known of it.

    Parameters
    ----------
    part : Part or Solid
        One valid solid, without the holes of the foot's four screws.
    title : str
        Title in documents, such as "Wedge".
    print_up : (float, float, float)
        Direction that points up on the printer's bed.
    stands_on : Plane, optional
        The desk on which a free-standing device stands; z points up. Without it, nothing is known of the support.
    fasteners : tuple of Fastener
        Further purchased items.
    lengths : tuple of ((float, float, float), (float, float, float))
        Pairs of points whose distances the drawing states, besides the overall ones and the holes.
    steps : tuple of str
        Sentences of the guide, in Markdown, after the one that screws the part to the mount.
    """

    part: Any
    title: str = "Adapter"
    print_up: Point = (0.0, 0.0, 1.0)
    stands_on: Plane | None = None
    fasteners: tuple[Fastener, ...] = ()
    lengths: tuple[tuple[Point, Point], ...] = ()
    steps: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        from build123d import Shape, Vector

        if not isinstance(self.part, Shape):
            raise InputError(f"part is a {type(self.part).__name__}, expected a Part or Solid of build123d")
        solids = self.part.solids()
        if len(solids) != 1:
            raise InputError(f"part has {len(solids)} solids, expected one")
        if not solids[0].is_valid or not solids[0].volume > 0.0:
            raise InputError(f"part is no valid solid (volume {solids[0].volume:.4g} mm3), expected a closed one")
        if not self.title or len(self.title) > LONGEST or not self.title.isprintable():
            raise InputError(f"title is {self.title!r}, expected one line of at most {LONGEST} characters")
        if not np.linalg.norm(tuple(Vector(self.print_up))) > 0.0:
            raise InputError(f"print_up is {self.print_up}, expected a direction")
        if self.stands_on is not None and not self.stands_on.z_dir.Z > 0.5:
            raise InputError(
                f"z of stands_on is {tuple(self.stands_on.z_dir)}, expected to point up, at most 60 deg off"
            )
