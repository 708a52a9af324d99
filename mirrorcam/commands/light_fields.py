"""Options of commands that work through light fields."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro
from pydantic import Field

from mirrorcam.console.progress import count_text, say
from mirrorcam.optics.base.values import Value

if TYPE_CHECKING:
    from mirrorcam.workflow.light_field_inputs import LightFieldInputs

PRINTED_LINES = 20


class LightFieldsOptions(Value):
    """Light fields of any kind that commands read."""

    light_fields: Annotated[
        tuple[Path, ...], tyro.conf.Positional, tyro.conf.arg(metavar="LIGHTFIELD...", help_behavior_hint="")
    ] = Field(
        min_length=1,
        description=(
            "what mirrorcam decode wrote (.npz or .zarr), a folder of the 4D Light Field Benchmark, or, with --layout, "
            "PNG or JPEG frames of the camera"
        ),
    )
    layout: Annotated[Path | None, tyro.conf.arg(metavar="PATH", help_behavior_hint="")] = Field(
        default=None, description="layout.json of frames, calibrated where there is one"
    )

    def inputs(self) -> LightFieldInputs:
        """The light fields to work through; raises InputError for two that would write the same results."""
        from mirrorcam.workflow.light_field_inputs import LightFieldInputs

        return LightFieldInputs(self.light_fields, self.layout)

    @property
    def counted(self) -> str:
        """How many light fields, in words."""
        return count_text(len(self.light_fields), "light field")


def say_some(title: str, lines: Sequence[str]) -> None:
    """Print lines, of very many the first."""
    for line in lines[:PRINTED_LINES]:
        say(title, line)
