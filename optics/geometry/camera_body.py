"""The outside of a camera: its body, the position of its lens, and how a clip can hold it."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from mirrorcam.core.bounds import PART_GAP_MM, PART_MM, PART_OFFSET_MM, Bounds
from mirrorcam.core.names import Name
from mirrorcam.core.values import Value

_Size = Annotated[float, PART_MM.limits]
_Offset = Annotated[float, PART_OFFSET_MM.limits]
ViewAngle = Annotated[float, Field(gt=1, lt=179)]
Box = tuple[tuple[float, float, float], tuple[float, float, float]]
# Height of a lens ring up to which it lies well within the clearance that a layout keeps around the body.
LOW_RING_MM = 3.0


class Lips(Value):
    """A body that screws press against pads on its front, sides and end."""

    kind: Literal["lips"] = "lips"
    lip_mm: float = PART_MM.field(description="how far pads may reach over the front from its upper and lower edges")
    display: bool = Field(
        default=False,
        exclude_if=lambda display: not display,
        description="the back is a display: felt goes between it and the screw, and no cable leaves it",
    )


class BoardHoles(Value):
    """A bare board, screwed to posts behind it."""

    kind: Literal["board"] = "board"
    holes_mm: tuple[tuple[_Offset, _Offset], ...] = Field(
        min_length=2, description="hole centres from the lens axis: x right, y down as in the image"
    )
    hole_mm: float = PART_MM.field(description="diameter of the holes")
    post_mm: float = PART_MM.field(description="height of the posts: space for components on the back of the board")
    screw_mm: float = PART_MM.field(2.0, "thread diameter of the self-tapping screws in the posts")
    screw_length_mm: float = PART_MM.field(6.0, "length of these screws")

    @property
    def play_mm(self) -> float:
        """How far the board can move from its drawn position in any direction until a hole touches its screw."""
        return max(self.hole_mm - self.screw_mm, 0.0) / 2.0


class Threads(Value):
    """A body with threads in its side at the image's top, by which countersunk screws draw it to the clip.

    A camera with its thread in the opposite side, such as a tripod's, is used upside down.
    """

    kind: Literal["threads"] = "threads"
    thread: Literal["M2", "M2.5", "M3", "M4", "1/4-20 UNC"] = Field(description="the thread's size")
    thread_depth_mm: float = PART_MM.field(description="usable depth of the threads")
    threads_mm: tuple[tuple[_Offset, _Offset], ...] = Field(
        min_length=1, description="thread centres: x from the lens axis, and distance behind the front of the body"
    )


class CameraBody(Value):
    """The outside of a camera: x along its image's x, y along its image's y, z out of the lens.

    `guessed` lists unpublished dimensions; the assembly guide describes how to measure them.
    """

    name: Name = Field(description="maker and model")
    width_mm: float = PART_MM.field(description="length of the body along the image's x")
    height_mm: float = PART_MM.field(description="length of the body along the image's y")
    depth_mm: float = PART_MM.field(description="length of the body along the lens axis, without lens ring and hinge")
    end_radius_mm: float = Field(
        default=0.0,
        ge=PART_GAP_MM.min,
        le=PART_GAP_MM.max,
        exclude_if=lambda radius: radius == 0.0,
        description="radius of the body's four edges along the lens axis",
    )
    foot_mm: tuple[_Size, _Size, _Size] | None = Field(
        default=None,
        exclude_if=lambda foot: foot is None,
        description="the monitor clip, folded against the scene side of the body: its size along x, y and z",
    )
    lens_x_mm: float = PART_OFFSET_MM.field(0.0, "lens axis from the centre of the body, along the image's x")
    lens_y_mm: float = PART_OFFSET_MM.field(0.0, "lens axis from the centre of the body, along the image's y")
    pupil_behind_front_mm: float = PART_OFFSET_MM.field(
        description="distance of the entrance pupil behind the front of the body; negative: in front of it"
    )
    lens_ring_mm: float = PART_MM.field(description="diameter of the lens ring or barrel")
    lens_protrusion_mm: float = PART_GAP_MM.field(description="how far the lens ring or barrel stands out of the front")
    hinge_mm: float = PART_GAP_MM.field(0.0, "width along x of the hinge on the scene side of the body")
    hinge_from_back_mm: float = PART_GAP_MM.field(0.0, "how far the hinge reaches from the back along the lens axis")
    cable_mm: float = PART_MM.field(description="diameter of the cable")
    cable_x_mm: float = PART_OFFSET_MM.field(0.0, "where the cable leaves the back, from the lens axis along x")
    cable_y_mm: float = Field(
        default=0.0,
        ge=PART_OFFSET_MM.min,
        le=PART_OFFSET_MM.max,
        exclude_if=lambda offset: offset == 0.0,
        description="where the cable leaves the back, from the centre of the body along the image's y",
    )
    cable_thick_mm: float = Field(
        default=0.0,
        ge=PART_GAP_MM.min,
        le=PART_GAP_MM.max,
        exclude_if=lambda thickness: thickness == 0.0,
        description="thickness of a ribbon whose width along x is cable_mm; 0: the cable is round",
    )
    rest_mm: tuple[_Size, _Size] | None = Field(
        default=None,
        exclude_if=lambda rest: rest is None,
        description="for a board with a heavy lens: start and end of the part of its barrel, lens_ring_mm wide, that "
        "rests on the clip, in front of the board's front",
    )
    mass_g: float = Bounds(0.001, 1e6).field(description="mass of the camera without its cable")
    field_of_view_deg: tuple[ViewAngle, ViewAngle] | None = Field(
        default=None, description="along the image's x and y, without distortion; omit it to skip the comparison"
    )
    guessed: tuple[Name, ...] = Field(
        default=(), exclude_if=lambda names: not names, description="names of unpublished dimensions"
    )
    held_by: Lips | BoardHoles | Threads = Field(discriminator="kind", description="how the clip holds it")

    @model_validator(mode="after")
    def _check(self) -> Self:
        fields = type(self).model_fields.keys() - {"name", "guessed"}
        if unknown := [name for name in self.guessed if name.partition(".")[0] not in fields]:
            raise ValueError(f"guessed: {unknown[0]} is not a dimension of a body")
        if self.end_radius_mm > min(self.width_mm, self.height_mm) / 2.0:
            raise ValueError(
                f"end_radius_mm {self.end_radius_mm:g}, expected at most half of {self.width_mm:g} x {self.height_mm:g}"
            )
        if self.rest_mm is not None and self.held_by.kind != "board":
            raise ValueError("rest_mm is given for a body held by lips, but applies only to a lens on a board")
        if self.rest_mm is not None and not self.rest_mm[0] < self.rest_mm[1] <= self.lens_protrusion_mm:
            raise ValueError(
                f"rest_mm {self.rest_mm[0]:g} to {self.rest_mm[1]:g}, expected increasing values of at most "
                f"lens_protrusion_mm {self.lens_protrusion_mm:g}"
            )
        return self

    @property
    def has_cable(self) -> bool:
        """Whether a cable leaves the back; none leaves the display of a phone, which runs on its battery."""
        return not (isinstance(self.held_by, Lips) and self.held_by.display)

    @property
    def box_mm(self) -> Box:
        """Bounding box of the body without lens ring, foot and hinge: minimum and maximum corner, mm.

        As in `Camera.body_mm`, the entrance pupil is the origin; the front lies at z = `pupil_behind_front_mm`.
        """
        x, y, front = -self.lens_x_mm, -self.lens_y_mm, self.pupil_behind_front_mm
        half_x, half_y = self.width_mm / 2.0, self.height_mm / 2.0
        return (x - half_x, y - half_y, front - self.depth_mm), (x + half_x, y + half_y, front)

    @property
    def lens_box_mm(self) -> Box | None:
        """Bounding box of the lens as in `box_mm`; None for a ring of at most `LOW_RING_MM`."""
        half, front = self.lens_ring_mm / 2.0, self.pupil_behind_front_mm
        if self.lens_protrusion_mm <= LOW_RING_MM:
            return None
        return (-half, -half, front), (half, half, front + self.lens_protrusion_mm)
