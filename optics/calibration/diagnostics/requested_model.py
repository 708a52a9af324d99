"""The requested model of a calibration: words joined by "+".

`joint` (the default) solves the camera jointly with the mirrors; `paper` fixes it as estimated from the pictures
without mirrors. A lens name fixes the lens model; without one, it is the layout's. `sheet`, `bend`, `warp`, `bow`,
`motion`, `prism`, `walk` and `colour` free further parameters (`nested_models`); with a direct view of the board, so do
`turn` and `board`. `auto` adds any others that the pictures support. `first_surface` and `second_surface` state the
mirrors' surface, which corrects a layout's. Model names in results, such as joint+bend, have the same form.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

from mirrorcam.core.arguments import check_type
from mirrorcam.core.errors import InputError
from mirrorcam.optics.geometry.lenses.families import LensName

DIRECT_ADDITIONS = ("turn", "board")
"""Additions that need frames which show their board both directly and in mirrors."""
ADDITIONS = ("sheet", "bend", "warp", "bow", "motion", "prism", "walk", "colour", *DIRECT_ADDITIONS)
"""Additions to `joint`, besides lenses."""
PLAIN_ADDITIONS = ("warp", "bow", "board", "motion", "prism", "walk", "colour")
"""The same without mirrors."""
SURFACES: dict[str, Literal["first", "second"]] = {"first_surface": "first", "second_surface": "second"}


@dataclass(frozen=True)
class RequestedModel:
    """A model of camera, mirrors and board to fit.

    Attributes
    ----------
    lens
        Lens model of the camera, the only one tried; None for the layout's.
    additions
        Parameters to free besides the camera, the virtual centres and the board's poses.
    paper
        Whether the camera is fixed, without additions.
    auto
        Whether further additions are made if the pictures support them; otherwise they raise an alarm.
    surface
        Reflecting surface of the mirrors; None if it is as the layout states, or without one, as the pictures show.
    """

    lens: LensName | None = None
    additions: tuple[str, ...] = ()
    paper: bool = False
    auto: bool = False
    surface: Literal["first", "second"] | None = None

    @classmethod
    def parse(cls, text: str | RequestedModel) -> RequestedModel:
        """Parse words joined by "+", or return a model; raises InputError for unknown or contradictory words."""
        check_type("model", text, str, RequestedModel)
        if isinstance(text, RequestedModel):
            return text
        words = text.split("+")
        lenses = [word for word in get_args(LensName) if word in words]
        surfaces = [surface for word, surface in SURFACES.items() if word in words]
        additions = tuple(word for word in words if word in ADDITIONS)
        accepted = {"joint", "paper", "auto", *lenses, *additions, *SURFACES}
        if unknown := [word for word in words if word not in accepted]:
            choices = ("auto", "joint", "paper", *get_args(LensName), *ADDITIONS, *SURFACES)
            raise InputError(f"unknown word {unknown[0]!r} of a model, expected {', '.join(choices)}")
        paper, auto = "paper" in words, "auto" in words
        fixed = paper and (auto or additions or "joint" in words)
        if len(set(words)) < len(words) or len(lenses) > 1 or len(surfaces) > 1 or fixed:
            raise InputError(
                "a model has each word once, one lens, one surface, and paper without joint, auto or additions"
            )
        return cls(
            lens=lenses[0] if lenses else None,
            additions=additions,
            paper=paper,
            auto=auto,
            surface=surfaces[0] if surfaces else None,
        )

    def check_mirrored(self) -> None:
        """Raise InputError if a word needs a direct view of the board, or a different layout."""
        if self.surface is not None:
            raise InputError(f"model: {self.surface}_surface, expected a layout with this surface")
        if direct := [name for name in self.additions if name in DIRECT_ADDITIONS]:
            others = [name for name in ADDITIONS if name not in DIRECT_ADDITIONS]
            raise InputError(f"model: {direct[0]} needs a direct view of the board, expected {', '.join(others)}")

    def check_plain(self) -> None:
        """Raise InputError if a word needs mirrors."""
        unknown = [name for name in self.additions if name not in PLAIN_ADDITIONS]
        if unknown or self.paper or self.surface is not None:
            word = unknown[0] if unknown else "paper" if self.paper else f"{self.surface}_surface"
            raise InputError(
                f"model: {word} needs mirrors, expected auto, joint or a lens with any of {', '.join(PLAIN_ADDITIONS)}"
            )


AUTO = RequestedModel(auto=True)
"""The largest model that the pictures support."""
