"""Options of commands that work through light fields."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro
from pydantic import Field

from mirrorcam.console.progress import say
from mirrorcam.optics.base.figure_texts import count_text
from mirrorcam.optics.base.values import Value

if TYPE_CHECKING:
    from mirrorcam.optics.light_field.io.light_field_format import Assumed
    from mirrorcam.workflow.light_field_inputs import LightFieldInputs

PRINTED_LINES = 20


class GeometryOptions(Value):
    """Geometry of light fields whose files do not state it."""

    rows: Annotated[int | None, tyro.conf.arg(metavar="COUNT", help_behavior_hint="")] = Field(
        default=None, ge=1, description="views down, of pictures without views.json or the like"
    )
    cols: Annotated[int | None, tyro.conf.arg(metavar="COUNT", help_behavior_hint="")] = Field(
        default=None, ge=1, description="views across, likewise"
    )
    step_mm: Annotated[float | None, tyro.conf.arg(metavar="MM", help_behavior_hint="")] = Field(
        default=None, gt=0, allow_inf_nan=False, description="distance of neighbouring views where a file has none"
    )
    focal_px: Annotated[float | None, tyro.conf.arg(metavar="PX", help_behavior_hint="")] = Field(
        default=None, gt=0, allow_inf_nan=False, description="focal length of the views where a file has none"
    )
    reference_depth_mm: Annotated[float | None, tyro.conf.arg(metavar="MM", help_behavior_hint="")] = Field(
        default=None,
        gt=0,
        allow_inf_nan=True,
        description="distance of zero disparity where a file has none; inf is one",
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


class LightFieldsOptions(GeometryOptions):
    """Light fields of any format, and frames of the camera."""

    light_fields: Annotated[
        tuple[Path, ...], tyro.conf.Positional, tyro.conf.arg(metavar="LIGHTFIELD...", help_behavior_hint="")
    ] = Field(
        min_length=1,
        description=(
            "what mirrorcam decode wrote (.npz or .zarr), a file or folder of a tool that mirrorcam export names, or, "
            "with --layout, PNG, JPEG or WebP frames of the camera"
        ),
    )
    layout: Annotated[Path | None, tyro.conf.arg(metavar="PATH", help_behavior_hint="")] = Field(
        default=None, description="layout.json of frames, calibrated where there is one"
    )

    def inputs(self) -> LightFieldInputs:
        """The light fields to work through; raises InputError for two that would write the same results."""
        from mirrorcam.workflow.light_field_inputs import LightFieldInputs

        return LightFieldInputs(self.light_fields, self.layout, self.assumed)

    @property
    def counted(self) -> str:
        """Number of light fields, in words."""
        return count_text(len(self.light_fields), "light field")


def say_some(title: str, lines: Sequence[str]) -> None:
    """Print lines, at most the first `PRINTED_LINES`."""
    for line in lines[:PRINTED_LINES]:
        say(title, line)
