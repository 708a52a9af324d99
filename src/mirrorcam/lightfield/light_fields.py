"""Options of commands that work through light fields."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro
from pydantic import Field

from mirrorcam.core.bounds import DEPTH_OR_INF_MM, FOCAL_PX, GRID, LENGTH_MM, DepthOrInf
from mirrorcam.core.console.progress import say
from mirrorcam.core.figures.figure_texts import count_text
from mirrorcam.core.values import Value

if TYPE_CHECKING:
    from mirrorcam.lightfield.light_field_inputs import LightFieldInputs
    from mirrorcam.optics.light_field.io.light_field_format import Assumed

PRINTED_LINES = 20


class GeometryOptions(Value):
    """Geometry of light fields whose files do not state it."""

    rows: Annotated[int | None, tyro.conf.arg(metavar="COUNT", help_behavior_hint="")] = GRID.field(
        None, "rows of views, where the file does not state them"
    )
    cols: Annotated[int | None, tyro.conf.arg(metavar="COUNT", help_behavior_hint="")] = GRID.field(
        None, "columns of views, where the file does not state them"
    )
    step_mm: Annotated[float | None, tyro.conf.arg(metavar="MM", help_behavior_hint="")] = LENGTH_MM.field(
        None,
        "distance between neighbouring views, where the file does not state it",
    )
    focal_px: Annotated[float | None, tyro.conf.arg(metavar="PX", help_behavior_hint="")] = FOCAL_PX.field(
        None,
        "focal length of the views, where the file does not state it",
    )
    reference_depth_mm: Annotated[DepthOrInf | None, tyro.conf.arg(metavar="MM", help_behavior_hint="")] = Field(
        default=None,
        description=f"distance of zero disparity, where the file does not state it, {DEPTH_OR_INF_MM}",
    )

    @property
    def assumed(self) -> Assumed:
        """Geometry that a reader assumes where a file does not state it."""
        from mirrorcam.optics.light_field.io.light_field_format import Assumed

        return Assumed(
            rows=self.rows,
            cols=self.cols,
            step_mm=self.step_mm,
            focal_px=self.focal_px,
            reference_depth_mm=self.reference_depth_mm,
        )


def check_range(near_mm: float | None, far_mm: float | None) -> None:
    """Raise ValueError where the nearest depth of a search is not nearer than the farthest."""
    if near_mm is not None and far_mm is not None and not near_mm < far_mm:
        raise ValueError(f"--near-mm {near_mm:g} --far-mm {far_mm:g}: expected a nearest depth below the farthest")


class LightFieldsOptions(GeometryOptions):
    """Light fields of any format, and frames of the camera."""

    light_fields: Annotated[
        tuple[Path, ...], tyro.conf.Positional, tyro.conf.arg(metavar="LIGHTFIELD...", help_behavior_hint="")
    ] = Field(
        min_length=1,
        description=(
            "light fields: .npz, .zarr or .mcap of mirrorcam decode, a file or folder in a format of mirrorcam export, "
            "or, with --layout, frames of the camera (PNG, JPEG, TIFF or BMP)"
        ),
    )
    layout: Annotated[Path | None, tyro.conf.arg(metavar="PATH", help_behavior_hint="")] = Field(
        default=None, description="layout.json to decode frames with, calibrated if possible"
    )

    def inputs(self) -> LightFieldInputs:
        """The light fields to work through; raises InputError for two that would write the same results."""
        from mirrorcam.core.console.reporter import TERMINAL
        from mirrorcam.lightfield.light_field_inputs import LightFieldInputs

        return LightFieldInputs(self.light_fields, self.layout, self.assumed, TERMINAL)

    @property
    def counted(self) -> str:
        """Number of light fields, in words."""
        return count_text(len(self.light_fields), "light field")


def say_some(title: str, lines: Sequence[str]) -> None:
    """Print lines, at most the first `PRINTED_LINES`, and how many more there are."""
    for line in lines[:PRINTED_LINES]:
        say(title, line)
    if len(lines) > PRINTED_LINES:
        say(title, f"and {len(lines) - PRINTED_LINES} more like these")
