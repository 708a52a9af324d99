"""How stock lies when it is cut: the one statement of which face is up, for the drawing, its notes and the guide.

Mirrors are drawn, cut and marked from their backs, which their seats hold. What the back is differs:

- First-surface: the bare side. The coating lies on the table under its film, and the laser comes to it last.
- Second-surface: the paint on the coating. A laser that engraves there burns both away, and the mark would be seen in
  the views; so the mark goes into paper tape on the paint.

Glass is not cut or marked by a laser: it is cut by a water jet, or scored and broken, and its names are written.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from mirrorcam.core.values import FloatArray

Surface = Literal["first", "second"]
SURFACES: tuple[Surface, ...] = ("first", "second")
Material = Literal["acrylic", "glass"]


@dataclass(frozen=True)
class Facing:
    """How stock of one kind lies, in words that the notes of a sheet and the guide share.

    `up` is the face that the laser meets, `up_is` and `down_is` how one tells it and the face on the table; `marked`
    is what the laser engraves, `before` and `after` what is done for that.
    """

    up: Literal["back", "front"]
    up_is: str
    down_is: str
    marked: str
    before: str
    after: str

    def seen(self, outline_in_plane_mm: FloatArray) -> FloatArray:
        """An outline (n, 2) in a mirror's frame, as the laser sees it: x along the rig's x, y up from the back."""
        return outline_in_plane_mm * ((1.0, -1.0) if self.up == "back" else (1.0, 1.0))

    @property
    def note(self) -> str:
        """How to lay the sheet down, for the notes of its drawing."""
        return f"{self.up.upper()} up ({self.up_is}), on the table {self.down_is}"


def facing_of(surface: Surface, material: Material) -> Facing:
    """How stock of a kind lies."""
    return FACINGS[material, surface]


FACINGS: dict[tuple[Material, Surface], Facing] = {
    ("acrylic", "first"): Facing(
        up="back",
        up_is="the side without the coating",
        down_is="the coated side under its film",
        marked="the bare back, lightly",
        before="leave the film on the coated side, and lay a clean sheet of card under it",
        after="",
    ),
    ("acrylic", "second"): Facing(
        up="back",
        up_is="the painted side",
        down_is="the clear side under its film",
        marked="paper tape on the paint, not the paint",
        before="cover the paint with paper tape, and try on an offcut at what power the laser marks the tape alone: "
        "through the paint it would burn the coating, and the mark would show in the picture",
        after="Leave the tape on until the mirror is glued in: it bears its name.",
    ),
    ("glass", "first"): Facing(
        up="back",
        up_is="the side without the coating",
        down_is="the coated side, on clean lint-free paper",
        marked="the bare back, written with a paint marker",
        before="score the bare back, never the coating",
        after="",
    ),
    ("glass", "second"): Facing(
        up="back",
        up_is="the painted side",
        down_is="the clear side",
        marked="the paint, written with a paint marker",
        before="to score it by hand turn sheet and drawing over together, and score the clear side, since paint and "
        "coating would chip",
        after="",
    ),
}
