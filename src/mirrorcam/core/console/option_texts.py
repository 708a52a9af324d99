"""Options that commands share."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

FORCE_TEXT = "also replace files that this command did not write, or that were changed since"
FORCE = Field(default=False, description=FORCE_TEXT)
AdapterKind = Literal["none", "tripod", "arca", "iso9409", "gen3", "gen2", "profile20", "vesa", "monitor"]
ADAPTER_TEXT = "what carries the device: a desk, a tripod, an arm and others (docs/cad.md)"
MIRRORS_TEXT = "how mirrors sit: glued to the holder, or each on a carrier that three sprung screws hold and tilt"
