"""The backs: what is screwed under the mount's foot, one table of dimensions for each kind. Lengths in mm.

A hardware file chooses one by the key `kind` of its table `[back]`; the others' dimensions are of no concern then.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field

from mirrorcam.core.bounds import PART_GAP_MM, PART_MM, PART_OFFSET_MM, Bounds
from mirrorcam.core.errors import InputError
from mirrorcam.core.names import Link, Name
from mirrorcam.core.values import Value


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
    """Base of the tables of all backs."""

    title: ClassVar[str]
    """The support of the device, in a few words."""
    parts: ClassVar[tuple[str, ...]]
    """Names of the printed parts."""
    on_arm: ClassVar[bool] = False
    """Whether it is fastened to a robot's arm, which gets a description of the device."""

    @property
    def ring_gauge(self) -> RingGauge | None:
        """The ring of the fit coupon, of a back that clamps round something."""
        return None


class TripodNut(Value):
    """A hexagon nut for the screw of a tripod, 1/4-20 UNC (ASME B18.2.2), in the underside of a device."""

    floor_mm: float = _size(0.6, "plastic under the nut, pressed between it and the tripod: three layers")
    screw_mm: float = _size(4.5, "how far the screw of a tripod stands out: at least 4.5 mm (ISO 1222)")
    pocket_mm: float = _size(13.1, "width of the nut's pocket over its corners")


class DeskBack(BackTable):
    """No carrier: a plate as a foot, on which the device stands on a desk. It holds a nut for a tripod."""

    title: ClassVar[str] = "a desk"
    parts: ClassVar[tuple[str, ...]] = ("adapter_desk",)
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
    parts: ClassVar[tuple[str, ...]] = ("adapter_saddle", "adapter_cap")
    on_arm: ClassVar[bool] = True
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


class TripodBack(BackTable):
    """A tripod or anything else with a 1/4 in screw: a small plate with a nut."""

    title: ClassVar[str] = "a tripod"
    parts: ClassVar[tuple[str, ...]] = ("adapter_tripod",)
    kind: Literal["tripod"] = "tripod"
    nut: TripodNut = TripodNut()
    grip_mm: float = _size(5.5, "from the tops of the countersunk heads to the mount's foot")


class ArcaBack(BackTable):
    """A clamp of the kind of Arca-Swiss: a dovetail. No standard states it, and clamps vary.

    Width and angle as makers of plates and clamps commonly state them (38 mm, 45 deg); lip and neck are guessed.
    """

    title: ClassVar[str] = "a clamp of the kind of Arca-Swiss"
    parts: ClassVar[tuple[str, ...]] = ("adapter_arca",)
    kind: Literal["arca"] = "arca"
    width_mm: float = _size(38.0, "width of the dovetail over its lips")
    fit_mm: float = PART_OFFSET_MM.field(0.1, "how much less it is on each side: more for a clamp that is tight")
    lip_mm: float = _size(1.5, "height of the upright edge below the slope (guessed)")
    neck_mm: float = _size(30.0, "width over the slope: no more than the jaws leave (guessed)")
    height_mm: float = _size(11.0, "from the lower face to the mount's foot: jaws reach up to 9 mm (guessed)")
    grip_mm: float = _size(5.5, "material under the heads of the screws that hold the back to the mount's foot")


class Iso9409Back(BackTable):
    """An arm's flange ISO 9409-1-50-4-M6 (UR3e to UR16e and many others), the views along its axis."""

    title: ClassVar[str] = "an arm's flange ISO 9409-1-50-4-M6"
    parts: ClassVar[tuple[str, ...]] = ("adapter_flange", "adapter_centring")
    on_arm: ClassVar[bool] = True
    kind: Literal["iso9409"] = "iso9409"
    link: Link = Field(default="tool0", description="the link of the arm's URDF at the flange, z out of it (REP 199)")
    circle_mm: float = _size(50.0, "diameter of the circle of the four M6 threads (ISO 9409-1)")
    centre_mm: float = _size(31.5, "diameter of the flange's centring recess, H7 (ISO 9409-1)")
    centre_deep_mm: float = _size(3.0, "how far the centring ring reaches into it: less than 3.5 mm")
    pin_mm: float = _size(6.0, "diameter of the locating pin's hole, H7 (ISO 9409-1)")
    flange_mm: float = _size(63.0, "outer diameter of the flange (ISO 9409-1)")
    arm_mm: float = _size(75.0, "diameter of the arm behind the flange, kept clear: that of a UR3e to UR10e (guessed)")
    below_mm: float = _size(43.0, "axis of the flange below the mount's foot")
    plate_mm: float = _size(10.0, "thickness of the plate on the flange")
    screw_mm: float = _size(16.0, "length of the M6 screws: 6 mm of thread in the flange")
    grip_mm: float = _size(5.5, "material under the heads of the screws that hold the back to the mount's foot")


class Gen3Back(BackTable):
    """Kinova Gen3: four threads in the face of the interface module, a rim round it, the views along its axis.

    Measured from `bracelet_no_vision_link.STL` of ros2_kortex, kortex_description (BSD-3-Clause): see
    `mirrorcam.cad.backs.brackets`. Threads are taken for M5 by their core holes of 4.2 mm: no drawing was read.
    """

    title: ClassVar[str] = "the interface module of a Kinova Gen3"
    parts: ClassVar[tuple[str, ...]] = ("adapter_flange", "adapter_spacer")
    on_arm: ClassVar[bool] = True
    kind: Literal["gen3"] = "gen3"
    link: Link = Field(default="end_effector_link", description="the link of the arm's URDF at the face (ros2_kortex)")
    holes_mm: tuple[float, float] = Field(default=(27.0, 16.0), description="the threads, from the axis along x and y")
    rim_mm: tuple[float, float, float] = Field(
        default=(35.4, 37.5, 2.9), description="the rim round the face: inner and outer radius, height"
    )
    spacer_mm: tuple[float, float] = Field(
        default=(35.0, 4.0), description="radius and thickness of the disc between face and plate, inside of the rim"
    )
    below_mm: float = _size(45.0, "axis of the face below the mount's foot")
    plate_mm: float = _size(10.0, "thickness of the plate")
    screw_mm: float = _size(20.0, "length of the M5 screws: 6 mm of thread in the arm")
    grip_mm: float = _size(5.5, "material under the heads of the screws that hold the back to the mount's foot")


class ProfileBack(BackTable):
    """An aluminium profile of 20 mm with slots of 6 mm, type I (also called type B of 20 mm): two T-nuts M5."""

    title: ClassVar[str] = "an aluminium profile of 20 mm, slot 6"
    parts: ClassVar[tuple[str, ...]] = ("adapter_profile",)
    kind: Literal["profile20"] = "profile20"
    profile_mm: float = _size(20.0, "side of the profile")
    plate_mm: float = _size(8.0, "thickness of the plate")
    sunk_mm: float = _size(2.0, "how deep the heads of the M5 screws lie in the plate")
    lip_mm: float = _size(2.0, "material of the profile over the T-nut (1.8 to 2 mm)")
    nut_mm: float = _size(4.0, "thickness of the T-nut")
    screw_mm: float = _size(12.0, "length of the M5 screws")
    grip_mm: float = _size(5.5, "from the tops of the countersunk heads to the mount's foot")


class VesaBack(BackTable):
    """A stand or an arm for monitors, VESA MIS-D (FDMI): four M4 screws on a square of 75 or 100 mm."""

    title: ClassVar[str] = "a VESA arm for monitors"
    parts: ClassVar[tuple[str, ...]] = ("adapter_vesa",)
    kind: Literal["vesa"] = "vesa"
    square_mm: float = _size(75.0, "side of the square of screws: 75 or 100 mm; most arms take both")
    arm_mm: float = _size(2.6, "thickness of the arm's plate (FDMI)")
    plate_mm: float = _size(8.0, "thickness of the plate")
    screw_mm: float = _size(12.0, "length of the M4 screws, which come with most arms")
    grip_mm: float = _size(5.5, "material under the heads of the screws that hold the back to the mount's foot")


class MonitorBack(BackTable):
    """The upper edge of a monitor: a hook in front of it and a jaw behind it, which slides and is screwed tight."""

    title: ClassVar[str] = "the upper edge of a monitor"
    parts: ClassVar[tuple[str, ...]] = ("adapter_hook", "adapter_jaw")
    kind: Literal["monitor"] = "monitor"
    thick_mm: float = _size(20.0, "thickness of the monitor, for pictures and clearances")
    range_mm: tuple[float, float] = Field(
        default=(8.0, 40.0), description="thinnest and thickest monitor that it takes"
    )
    plate_mm: float = _size(8.0, "thickness of the plate")
    hook_mm: float = _size(8.0, "how far the hook reaches over the screen: less than the frame is wide")
    jaw_mm: float = _size(40.0, "how far the jaw reaches down behind")
    grip_mm: float = _size(3.6, "material under the heads of the screws that hold the back to the mount's foot")


Kind = Literal["none", "tripod", "arca", "iso9409", "gen3", "gen2", "profile20", "vesa", "monitor"]
Table = DeskBack | TripodBack | ArcaBack | Iso9409Back | Gen3Back | Gen2Back | ProfileBack | VesaBack | MonitorBack
AnyBack = Annotated[Table, Field(discriminator="kind")]
BACKS: dict[str, type[Table]] = {
    table.model_fields["kind"].default: table
    for table in (
        *(DeskBack, TripodBack, ArcaBack, Iso9409Back, Gen3Back, Gen2Back, ProfileBack, VesaBack, MonitorBack),
    )
}
"""The tables by their kinds, in the order in which they are listed for people."""


def back_of(kind: str) -> AnyBack:
    """The table of a kind with its own dimensions; raises InputError for a kind that there is none of."""
    if kind not in BACKS:
        raise InputError(f"adapter {kind}: expected one of {', '.join(BACKS)}")
    return BACKS[kind]()
