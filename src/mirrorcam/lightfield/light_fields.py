"""Options shared by the light field commands."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from mirrorcam.core.console.progress import say
from mirrorcam.optics.light_field.io.light_field_format import Assumed

PRINTED_LINES = 20

LightFieldPaths = Annotated[
    tuple[Path, ...],
    Parameter(
        name="LIGHTFIELD...",
        help="light fields: .npz, .zarr or .mcap of mirrorcam decode, a file or folder in a format of mirrorcam "
        "export, or, with --layout, frames of the camera (PNG, JPEG, TIFF or BMP)",
    ),
]
FrameLayout = Annotated[
    Path | None, Parameter(metavar="FILE", help="layout.json to decode frames with, calibrated if possible")
]
AssumedViews = Annotated[Assumed, Parameter(name="*")]


def say_first(title: str, lines: Sequence[str]) -> None:
    """Print at most the first `PRINTED_LINES` lines, and how many more there are."""
    for line in lines[:PRINTED_LINES]:
        say(title, line)
    if len(lines) > PRINTED_LINES:
        say(title, f"and {len(lines) - PRINTED_LINES} more like these")
