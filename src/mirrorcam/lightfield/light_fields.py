"""Options that commands of light fields share."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal, Self

from cyclopts import Parameter
from pydantic import Field, model_validator

from mirrorcam.core.bounds import DEPTH_MM
from mirrorcam.core.console.progress import say
from mirrorcam.core.values import Value

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

Detector = Annotated[
    Literal["SIFT", "ORB", "AKAZE", "SIFT4D"],
    Field(
        description="keypoint detector; SIFT4D searches in place, scale and slope at once, for little light; AKAZE "
        "needs the contributed modules of OpenCV"
    ),
]


class DepthRange(Value):
    """A nearest and a farthest depth, mm from the pupil."""

    near_mm: float | None = None
    far_mm: float | None = None

    @model_validator(mode="after")
    def _check_range(self) -> Self:
        near_mm, far_mm = self.near_mm, self.far_mm
        if near_mm is not None and far_mm is not None and not near_mm < far_mm:
            raise ValueError(f"--near-mm {near_mm:g} --far-mm {far_mm:g}: expected a nearest depth below the farthest")
        return self


class FeatureSearch(DepthRange):
    """Detector of features, and the depths between which they are searched."""

    detector: Detector = "SIFT"
    near_mm: float | None = DEPTH_MM.field(
        None,
        "nearest depth of the search, from the pupil",
        unset="as the file states, or halfway to the reference plane",
    )
    far_mm: float | None = DEPTH_MM.field(None, "farthest depth of the search", unset="as the file states, or infinity")


def say_some(title: str, lines: Sequence[str]) -> None:
    """Print lines, at most the first `PRINTED_LINES`, and how many more there are."""
    for line in lines[:PRINTED_LINES]:
        say(title, line)
    if len(lines) > PRINTED_LINES:
        say(title, f"and {len(lines) - PRINTED_LINES} more like these")
