"""The backs: what is screwed under the mount's foot, one table of dimensions for each kind. Lengths in mm.

A hardware file chooses one by the key `kind` of its table `[back]`; the others' dimensions are of no concern then.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field

from mirrorcam.optics.base.bounds import PART_GAP_MM, PART_MM, PART_OFFSET_MM, Bounds
from mirrorcam.optics.base.names import Link, Name
from mirrorcam.optics.base.values import InputError, Value


def _size(default: float, description: str) -> Any:
    """A field of a dimension of a part."""
    return PART_MM.field(default, description)


@dataclass(frozen=True)
class RingGauge:
    """A ring to try before all of it is printed: its inner radius, thickness and width."""

    radius_mm: float
    ring_mm: float
    band_mm: float


class BackTable(Value):
    """What the tables of all backs have in common."""

    title: ClassVar[str]
    """What the device is fastened to, in a few words."""

    @property
    def ring_gauge(self) -> RingGauge | None:
        """The ring of the fit coupon, of a back that clamps round something."""
        return None


class TripodNut(Value):
    """A hexagon nut for the screw of a tripod, 1/4-20 UNC (ASME B18.2.2), in the underside of a device."""

    floor_mm: float = _size(0.6, "plastic under the nut, pressed between it and the tripod: three layers")
    screw_mm: float = _size(4.5, "how far the screw of a tripod stands out: at least 4.5 mm (ISO 1222)")


class DeskBack(BackTable):
    """No carrier: a plate as a foot, on which the device stands on a desk. It holds a nut for a tripod."""

    title: ClassVar[str] = "a desk"
    kind: Literal["none"] = "none"
    nut: TripodNut = TripodNut()
    grip_mm: float = _size(5.5, "from the tops of the countersunk heads to the mount's foot")
    tip_deg: float = Bounds(1.0, 45.0).field(10.0, "how far the device may be tipped any way before it falls over")
    spare_deg: float = Bounds(0.0, 45.0).field(
        5.0, "how much more the plate is laid out for: cable, and parts lighter than solid"
    )
    corner_mm: float = PART_GAP_MM.field(8.0, "how much of the plate's corners is cut off")


class Gen2Back(BackTable):
    """The last shell of Kinova's second generation with two fingers, which has no published bolts: a split clamp.

    Measured from `hand_2finger.STL` and `ring_small.STL` of kinova-ros, kinova_description (BSD-3-Clause): see
    `mirrorcam.cad.backs.kinova_gen2`.
    """

    title: ClassVar[str] = "the wrist of a Kinova arm of the second generation"
    kind: Literal["gen2"] = "gen2"
    name: Name = Field(default="Kinova MICO or JACO with two fingers", description="the arm")
    link: Link = Field(
        default="m1n6s200_link_6", description="the link of the arm's URDF that the shell belongs to (kinova-ros)"
    )
    along_mm: float = PART_OFFSET_MM.field(
        14.0, "middle of the clamp from the link's origin towards the fingers, on the band behind the joint's ring"
    )
    diameter_mm: float = _size(63.0, "diameter of the shell")
    band_mm: float = _size(8.0, "width of the clamp: from the joint's ring to where the hand widens")
    ring_mm: float = _size(4.0, "thickness of the clamp's ring")
    gap_mm: float = _size(2.0, "gap between the clamp's halves, closed by its screws")
    riser_mm: float = _size(16.0, "material between the shell and the mount's foot")
    joint_mm: float = _size(6.0, "space over the shell beside the clamp, for the joint's ring")
    grip_mm: float = _size(1.6, "material under the heads of the screws that hold the saddle to the mount's foot")

    @property
    def ring_gauge(self) -> RingGauge:
        return RingGauge(self.diameter_mm / 2.0, self.ring_mm, self.band_mm)


Kind = Literal["none", "gen2"]
AnyBack = Annotated[DeskBack | Gen2Back, Field(discriminator="kind")]
BACKS: dict[str, type[DeskBack | Gen2Back]] = {"none": DeskBack, "gen2": Gen2Back}
"""The tables by their kinds, in the order in which they are listed for people."""


def back_of(kind: str) -> AnyBack:
    """The table of a kind with its own dimensions; raises InputError for a kind that there is none of."""
    if kind not in BACKS:
        raise InputError(f"adapter {kind}: expected one of {', '.join(BACKS)}")
    return BACKS[kind]()
