"""Dimensions of the adapters under the mount's foot (`[back]`): one table for each kind. Lengths in mm.

The key `kind` of a hardware file's table `[back]` selects the kind; only that kind's dimensions are then valid.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field, ValidationInfo, field_validator
from pydantic.json_schema import SkipJsonSchema

from mirrorcam.core.bounds import PART_GAP_MM, PART_MM, PART_OFFSET_MM, Bounds
from mirrorcam.core.errors import InputError
from mirrorcam.core.names import Link, Name
from mirrorcam.core.values import Value

_size = PART_MM.field


@dataclass(frozen=True)
class RingGauge:
    """The ring of a clamp, of which the fit coupon has a segment: inner radius, thickness and width."""

    radius_mm: float
    ring_mm: float
    band_mm: float


class BackTable(Value):
    """Base of the tables of all adapters."""

    title: ClassVar[str]
    """Short name of the support."""
    parts: ClassVar[tuple[str, ...]]
    """Names of the printed parts."""
    on_arm: ClassVar[bool] = False
    """Whether the device is on a robot's arm, for which a robot description is written."""
    look_deg: float = Bounds(-90.0, 90.0).field(
        0.0, "angle of the views above the horizon as the device stands, or above the axis of an arm's flange"
    )
    grip_mm: float = _size(5.5, "thickness of plastic between the heads of the foot's screws and the mount's foot")

    @property
    def source(self) -> Path | None:
        """The file that the adapter is made from, if it is not this program."""
        return None

    @property
    def not_checked(self) -> str:
        """What no check covers; "" if it is only what every device leaves open."""
        return ""

    @property
    def ring_gauge(self) -> RingGauge | None:
        """The ring of an adapter that clamps, for the fit coupon; None for others."""
        return None

    @property
    def grips_mm(self) -> tuple[float, ...]:
        """Material that its screws into inserts or nuts pass through; the mount's foot comes first."""
        return (self.grip_mm,)


class TripodNut(Value):
    """A hexagon nut for a tripod's screw, 1/4-20 UNC (ASME B18.2.2), in the underside of a device."""

    floor_mm: float = _size(0.6, "plastic under the nut, clamped between nut and tripod: three layers")
    screw_mm: float = _size(4.5, "length of a tripod's screw above its plate: at least 4.5 mm (ISO 1222)")
    pocket_mm: float = _size(13.1, "width of the nut's pocket across corners")


class DeskBack(BackTable):
    """A plate on which the device stands on a desk. It also holds a nut for a tripod."""

    title: ClassVar[str] = "a desk"
    parts: ClassVar[tuple[str, ...]] = ("adapter_desk",)
    kind: Literal["none"] = "none"
    nut: TripodNut = TripodNut()
    grip_mm: float = _size(5.5, "from the tops of the countersunk heads to the mount's foot")
    tip_deg: float = Bounds(1.0, 45.0).field(10.0, "smallest tilt in any direction at which the device falls over")
    spare_deg: float = Bounds(0.0, 45.0).field(
        5.0, "additional tilt that the plate is designed for: pull of the cable, and parts lighter than solid"
    )
    corner_mm: float = PART_GAP_MM.field(8.0, "chamfer of the plate's corners")


# Thickness of the ears of a clamp's cap.
CAP_EAR_MM = 5.0


class Gen2Back(BackTable):
    """A split clamp round the last shell of a second-generation Kinova arm with two fingers; its bolts are unpublished.

    Measured from `hand_2finger.STL` and `ring_small.STL` of kinova-ros, kinova_description (BSD-3-Clause): see
    `mirrorcam.cad.backs.kinova_gen2`.
    """

    title: ClassVar[str] = "the wrist of a Kinova arm of the second generation"
    parts: ClassVar[tuple[str, ...]] = ("adapter_saddle", "adapter_cap")
    on_arm: ClassVar[bool] = True
    kind: Literal["gen2"] = "gen2"
    name: Name = Field(default="Kinova MICO or JACO with two fingers", description="the arm")
    link: Link = Field(
        default="m1n6s200_link_6", description="link of the arm's URDF to which the shell belongs (kinova-ros)"
    )
    along_mm: float = PART_OFFSET_MM.field(
        14.0,
        "distance of the clamp's centre from the link's origin towards the fingers, behind the joint's ring",
    )
    diameter_mm: float = _size(63.0, "diameter of the shell")
    band_mm: float = _size(8.0, "width of the clamp: from the joint's ring to where the hand widens")
    ring_mm: float = _size(4.0, "thickness of the clamp's ring")
    gap_mm: float = _size(2.0, "gap between the clamp's halves, which the screws close")
    riser_mm: float = _size(16.0, "material between the shell and the mount's foot")
    joint_mm: float = _size(6.0, "clearance over the shell next to the clamp, for the joint's ring")
    grip_mm: float = _size(1.6, "material under the heads of the screws that hold the saddle to the mount's foot")

    @property
    def grips_mm(self) -> tuple[float, ...]:
        return self.grip_mm, CAP_EAR_MM + self.gap_mm

    @property
    def ring_gauge(self) -> RingGauge:
        return RingGauge(self.diameter_mm / 2.0, self.ring_mm, self.band_mm)


class TripodBack(BackTable):
    """A small plate with a nut, for a tripod or any other support with a 1/4 in screw."""

    title: ClassVar[str] = "a tripod"
    parts: ClassVar[tuple[str, ...]] = ("adapter_tripod",)
    kind: Literal["tripod"] = "tripod"
    nut: TripodNut = TripodNut()
    grip_mm: float = _size(5.5, "from the tops of the countersunk heads to the mount's foot")


class ArcaBack(BackTable):
    """A dovetail for Arca-Swiss clamps. No standard defines it, and clamps vary.

    Width and angle are those that makers of plates and clamps commonly state (38 mm, 45 deg); lip and neck are guessed.
    """

    title: ClassVar[str] = "an Arca-Swiss clamp"
    parts: ClassVar[tuple[str, ...]] = ("adapter_arca",)
    kind: Literal["arca"] = "arca"
    width_mm: float = _size(38.0, "width of the dovetail over its lips")
    fit_mm: float = PART_OFFSET_MM.field(0.1, "clearance on each side: increase it if the clamp is tight")
    lip_mm: float = _size(1.5, "height of the upright edge below the slope (guessed)")
    neck_mm: float = _size(30.0, "width above the slope: at most the gap between the jaws (guessed)")
    height_mm: float = _size(11.0, "from the lower face to the mount's foot: jaws reach up to 9 mm (guessed)")


class Iso9409Back(BackTable):
    """An arm's flange ISO 9409-1-50-4-M6 (UR3e to UR16e and many others), with the views along its axis."""

    title: ClassVar[str] = "an arm's flange ISO 9409-1-50-4-M6"
    parts: ClassVar[tuple[str, ...]] = ("adapter_flange", "adapter_centring")
    on_arm: ClassVar[bool] = True
    kind: Literal["iso9409"] = "iso9409"
    link: Link = Field(default="tool0", description="link of the arm's URDF at the flange, z outwards (REP 199)")
    circle_mm: float = _size(50.0, "diameter of the circle of the four M6 threads (ISO 9409-1)")
    centre_mm: float = _size(31.5, "diameter of the flange's centring recess, H7 (ISO 9409-1)")
    centre_deep_mm: float = _size(3.0, "depth of the centring ring in the recess: less than 3.5 mm")
    pin_mm: float = _size(6.0, "diameter of the locating pin's hole, H7 (ISO 9409-1)")
    flange_mm: float = _size(63.0, "outer diameter of the flange (ISO 9409-1)")
    arm_mm: float = _size(75.0, "diameter of the arm behind the flange, for clearances: UR3e to UR10e (guessed)")
    below_mm: float = _size(43.0, "distance of the flange's axis below the mount's foot")
    plate_mm: float = _size(10.0, "thickness of the plate on the flange")
    screw_mm: float = _size(16.0, "length of the M6 screws: 6 mm of thread in the flange")


class Gen3Back(BackTable):
    """Kinova Gen3: four threads in the face of the interface module, with a rim round it and the views along its axis.

    Measured from `bracelet_no_vision_link.STL` of ros2_kortex, kortex_description (BSD-3-Clause): see
    `mirrorcam.cad.backs.brackets`. The tap-drill holes of 4.2 mm suggest M5 threads; no drawing confirms it.
    """

    title: ClassVar[str] = "the interface module of a Kinova Gen3"
    parts: ClassVar[tuple[str, ...]] = ("adapter_flange", "adapter_spacer")
    on_arm: ClassVar[bool] = True
    kind: Literal["gen3"] = "gen3"
    link: Link = Field(default="end_effector_link", description="link of the arm's URDF at the face (ros2_kortex)")
    holes_mm: tuple[float, float] = Field(
        default=(27.0, 16.0), description="distances of the threads from the axis along x and y"
    )
    rim_mm: tuple[float, float, float] = Field(
        default=(35.4, 37.5, 2.9), description="rim round the face: inner radius, outer radius, height"
    )
    spacer_mm: tuple[float, float] = Field(
        default=(35.0, 4.0), description="radius and thickness of the disc between face and plate, inside the rim"
    )
    below_mm: float = _size(45.0, "distance of the face's axis below the mount's foot")
    plate_mm: float = _size(10.0, "thickness of the plate")
    screw_mm: float = _size(20.0, "length of the M5 screws: 6 mm of thread in the arm")


class ProfileBack(BackTable):
    """A 20 mm aluminium extrusion with 6 mm slots, type I (also sold as type B, 20 mm), and two M5 T-nuts."""

    title: ClassVar[str] = "an aluminium profile of 20 mm, slot 6"
    parts: ClassVar[tuple[str, ...]] = ("adapter_profile",)
    kind: Literal["profile20"] = "profile20"
    profile_mm: float = _size(20.0, "side of the profile")
    plate_mm: float = _size(8.0, "thickness of the plate")
    sunk_mm: float = _size(2.0, "depth of the counterbores for the heads of the M5 screws")
    lip_mm: float = _size(2.0, "thickness of the profile's lip over the T-nut (1.8 to 2 mm)")
    nut_mm: float = _size(4.0, "thickness of the T-nut")
    screw_mm: float = _size(12.0, "length of the M5 screws")
    grip_mm: float = _size(5.5, "from the tops of the countersunk heads to the mount's foot")


class VesaBack(BackTable):
    """A stand or arm for monitors, VESA MIS-D (FDMI): four M4 screws on a square of 75 or 100 mm."""

    title: ClassVar[str] = "a VESA arm for monitors"
    parts: ClassVar[tuple[str, ...]] = ("adapter_vesa",)
    kind: Literal["vesa"] = "vesa"
    square_mm: float = _size(75.0, "side of the square of screws: 75 or 100 mm; most arms take both")
    arm_mm: float = _size(2.6, "thickness of the arm's plate (FDMI)")
    plate_mm: float = _size(8.0, "thickness of the plate")
    screw_mm: float = _size(12.0, "length of the M4 screws, which come with most arms")


class MonitorBack(BackTable):
    """A holder for the upper edge of a monitor, between a hook in front of it and a jaw that slides up behind it."""

    title: ClassVar[str] = "the upper edge of a monitor"
    parts: ClassVar[tuple[str, ...]] = ("adapter_hook", "adapter_jaw")
    kind: Literal["monitor"] = "monitor"
    thick_mm: float = _size(20.0, "thickness of the monitor, in pictures and for clearances")
    range_mm: tuple[float, float] = Field(default=(8.0, 40.0), description="thinnest and thickest monitor that fits")
    plate_mm: float = _size(8.0, "thickness of the plate")
    hook_mm: float = _size(8.0, "how far the hook reaches down over the screen: less than the width of its bezel")
    jaw_mm: float = _size(40.0, "how far the jaw reaches down behind the monitor")
    grip_mm: float = _size(3.6, "thickness of plastic between the heads of the foot's screws and the mount's foot")


class FileBack(BackTable):
    """A part of your own, made by a Python file or read from a STEP file: see docs/own_back.md.

    A hardware file cannot name the file, since a Python file is run: the command line names it.
    """

    title: ClassVar[str] = "a back of your own"
    parts: ClassVar[tuple[str, ...]] = ("adapter_own",)
    kind: Literal["file"] = "file"
    file: Annotated[Path | None, SkipJsonSchema()] = Field(default=None, exclude=True)
    tip_deg: float = Bounds(1.0, 45.0).field(10.0, "smallest tilt in any direction at which the device falls over")
    nut: TripodNut = TripodNut()

    @property
    def source(self) -> Path | None:
        return self.file

    @property
    def not_checked(self) -> str:
        return "the stress in your part, and whether the device clashes with what it is fastened to"

    @field_validator("file", mode="before")
    @classmethod
    def _from_command_line(cls, file: Any, info: ValidationInfo) -> Any:
        if file is not None and info.mode == "json":
            raise ValueError("a Python file is run, so only the command line may name one, expected --adapter FILE")
        return file


Kind = Literal["none", "tripod", "arca", "iso9409", "gen3", "gen2", "profile20", "vesa", "monitor"]
Table = DeskBack | TripodBack | ArcaBack | Iso9409Back | Gen3Back | Gen2Back | ProfileBack | VesaBack | MonitorBack
AnyBack = Annotated[Table | FileBack, Field(discriminator="kind")]
BACKS: dict[str, type[Table]] = {
    table.model_fields["kind"].default: table
    for table in (
        *(DeskBack, TripodBack, ArcaBack, Iso9409Back, Gen3Back, Gen2Back, ProfileBack, VesaBack, MonitorBack),
    )
}
"""The table of each kind, in the order of listings."""

ENDINGS = (".py", ".step", ".stp")
"""Endings of the names of files with a back of your own."""


def back_of(kind: str) -> AnyBack:
    """The table of a kind, or of a file, with its default dimensions; raises InputError for an unknown one."""
    if kind in BACKS:
        return BACKS[kind]()
    file = Path(kind)
    if file.suffix.lower() not in ENDINGS:
        raise InputError(f"adapter {kind}: expected one of {', '.join(BACKS)}, or a file {', '.join(ENDINGS)}")
    if not file.is_file():
        raise InputError(f"adapter {kind}: is no file, expected one {', '.join(ENDINGS)}")
    return FileBack(file=file)
