"""Options that commands share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Final, Literal

import tyro
from pydantic import Field

FORCE_TEXT = "also replace files that this command did not write, or that were changed since"
FORCE = Field(default=False, description=FORCE_TEXT)
AUTO: Final = "auto"
FILE = tyro.conf.arg(metavar="FILE", help_behavior_hint="")
FormatOption = Annotated[
    Literal["auto", "kalibr", "opencv", "ros", "colmap", "mrcal", "anipose", "mirrorcam"],
    Field(description="format of a calibration; auto: as its content says"),
]
UnitOption = Annotated[
    Literal["auto", "mm", "cm", "m", "none"],
    Field(description="unit of its poses; none: they have no scale; auto: as the format has it"),
]
PicturesOption = Annotated[
    Literal["auto", "flipped", "left-right", "top-bottom", "as-is"],
    Field(description="how its pictures came from frames; auto: flipped so that views are upright"),
]
ViewsOption = Annotated[
    Path | None, FILE, Field(description="TOML file that says which camera is which mirror, where names do not")
]
LimitsOption = Annotated[Path | None, FILE, Field(description="TOML file of limits: FIGURE = NUMBER")]
AdapterKind = Literal["none", "tripod", "arca", "iso9409", "gen3", "gen2", "profile20", "vesa", "monitor"]
ADAPTER_TEXT = "what carries the device: a desk, a tripod, an arm and others (docs/cad.md)"
MIRRORS_TEXT = "how mirrors sit: glued to the holder, or each on a carrier that three sprung screws hold and tilt"
