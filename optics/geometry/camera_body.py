"""A camera from outside: its body, where its lens is in it, and what it can be held by."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from mirrorcam.core.bounds import PART_GAP_MM, PART_MM, PART_OFFSET_MM, Bounds
from mirrorcam.core.names import Name
from mirrorcam.core.values import Value

_Size = Annotated[float, PART_MM.each]
_Place = Annotated[float, PART_OFFSET_MM.each]
ViewAngle = Annotated[float, Field(gt=1, lt=179)]
Box = tuple[tuple[float, float, float], tuple[float, float, float]]


class Lips(Value):
    """A body that is held between pads at its front, sides and end, against which screws press it."""

    kind: Literal["lips"] = "lips"
    lip_mm: float = PART_MM.field(description="how far pads may reach over the front, from its upper and lower edge")
    display: bool = Field(
        default=False,
        exclude_if=lambda display: not display,
        description="the back is a display: felt goes between it and the screw, and no cable leaves there",
    )


class BoardHoles(Value):
    """A bare board, screwed to posts behind it."""

    kind: Literal["board"] = "board"
    holes_mm: tuple[tuple[_Place, _Place], ...] = Field(
        min_length=2, description="hole centres from the lens axis: x right, y down as in the image"
    )
    hole_mm: float = PART_MM.field(description="diameter of the holes")
    post_mm: float = PART_MM.field(description="height of the posts: space for what is soldered to the board's back")
    screw_mm: float = PART_MM.field(2.0, "thread of the screws, which cut it in the posts themselves")
    screw_length_mm: float = PART_MM.field(6.0, "length of these screws")

    @property
    def play_mm(self) -> float:
        """How far the board can move any way until a hole touches its screw, with both where they are drawn."""
        return max(self.hole_mm - self.screw_mm, 0.0) / 2.0


class CameraBody(Value):
    """A camera from outside, seen along its lens axis: x along its image's x, y along its image's y, z out of the lens.

    Measures that nobody publishes are listed in `guessed`: the assembly guide describes how to measure them.
    """

    name: Name = Field(description="maker and model")
    width_mm: float = PART_MM.field(description="length of the body along the image's x")
    height_mm: float = PART_MM.field(description="length of the body along the image's y")
    depth_mm: float = PART_MM.field(description="length of the body along the lens axis, without lens ring and hinge")
    end_radius_mm: float = Field(
        default=0.0,
        ge=PART_GAP_MM.least,
        le=PART_GAP_MM.most,
        exclude_if=lambda radius: radius == 0.0,
        description="radius of the body's four edges along the lens axis",
    )
    foot_mm: tuple[_Size, _Size, _Size] | None = Field(
        default=None,
        exclude_if=lambda foot: foot is None,
        description="the clip for a monitor, folded against the body's scene side: its length along x, y and z",
    )
    lens_x_mm: float = PART_OFFSET_MM.field(0.0, "lens axis from the middle of the body, along the image's x")
    lens_y_mm: float = PART_OFFSET_MM.field(0.0, "lens axis from the middle of the body, along the image's y")
    pupil_behind_front_mm: float = PART_OFFSET_MM.field(
        description="entrance pupil behind the front of the body; negative: before it"
    )
    lens_ring_mm: float = PART_MM.field(description="diameter of the lens ring or barrel")
    lens_protrusion_mm: float = PART_GAP_MM.field(description="lens ring or barrel before the front")
    hinge_mm: float = PART_GAP_MM.field(0.0, "width along x of what sticks out of the body's scene side")
    hinge_from_back_mm: float = PART_GAP_MM.field(0.0, "how far from the back the hinge reaches along the lens axis")
    cable_mm: float = PART_MM.field(description="diameter of the cable")
    cable_x_mm: float = PART_OFFSET_MM.field(0.0, "where the cable leaves the back, from the lens axis along x")
    cable_y_mm: float = Field(
        default=0.0,
        ge=PART_OFFSET_MM.least,
        le=PART_OFFSET_MM.most,
        exclude_if=lambda place: place == 0.0,
        description="where the cable leaves the back, from the middle of the body along the image's y",
    )
    cable_thick_mm: float = Field(
        default=0.0,
        ge=PART_GAP_MM.least,
        le=PART_GAP_MM.most,
        exclude_if=lambda thick: thick == 0.0,
        description="thickness of a ribbon whose width along x is cable_mm; 0: the cable is round",
    )
    rest_mm: tuple[_Size, _Size] | None = Field(
        default=None,
        exclude_if=lambda rest: rest is None,
        description="of a board with a heavy lens: from where to where before the front its barrel, lens_ring_mm wide, "
        "rests on the clip",
    )
    mass_g: float = Bounds(0.001, 1e6).field(description="mass of the camera without its cable")
    field_of_view_deg: tuple[ViewAngle, ViewAngle] | None = Field(
        default=None, description="along the image's x and y, without distortion; left out, it is compared with nothing"
    )
    guessed: tuple[Name, ...] = Field(
        default=(), exclude_if=lambda names: not names, description="which of these measures nobody publishes"
    )
    held_by: Lips | BoardHoles = Field(discriminator="kind", description="how the clip holds it")

    @model_validator(mode="after")
    def _check(self) -> Self:
        known = type(self).model_fields.keys() - {"name", "guessed"}
        if unknown := [name for name in self.guessed if name.partition(".")[0] not in known]:
            raise ValueError(f"guessed: {unknown[0]} is no measure of a body")
        if self.end_radius_mm > min(self.width_mm, self.height_mm) / 2.0:
            raise ValueError(
                f"end_radius_mm {self.end_radius_mm:g}, expected at most half of {self.width_mm:g} x {self.height_mm:g}"
            )
        if self.rest_mm is not None and self.held_by.kind != "board":
            raise ValueError("rest_mm is for a lens on a board, expected none of a body that is held by lips")
        if self.rest_mm is not None and not self.rest_mm[0] < self.rest_mm[1] <= self.lens_protrusion_mm:
            raise ValueError(
                f"rest_mm {self.rest_mm[0]:g} to {self.rest_mm[1]:g}, expected upwards to at most lens_protrusion_mm "
                f"{self.lens_protrusion_mm:g}"
            )
        return self

    @property
    def has_cable(self) -> bool:
        """Whether a cable leaves its back: not from the display of a phone, which runs on its battery."""
        return not (isinstance(self.held_by, Lips) and self.held_by.display)

    @property
    def box_mm(self) -> Box:
        """The box around the body without its lens ring, foot and hinge: least and greatest corner, mm.

        Its frame is that of `Camera.body_mm`: the entrance pupil is the origin, the front at z =
        `pupil_behind_front_mm`.
        """
        x, y, front = -self.lens_x_mm, -self.lens_y_mm, self.pupil_behind_front_mm
        half_x, half_y = self.width_mm / 2.0, self.height_mm / 2.0
        return (x - half_x, y - half_y, front - self.depth_mm), (x + half_x, y + half_y, front)
