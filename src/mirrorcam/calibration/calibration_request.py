"""Inputs of a calibration from files, and the model to fit."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Self

from cyclopts import Parameter
from pydantic import BeforeValidator, Field, model_validator

from mirrorcam.core.bounds import Bounds
from mirrorcam.core.values import Value
from mirrorcam.optics.calibration.diagnostics.requested_model import AUTO, RequestedModel


def _parsed(model: Any) -> Any:
    return RequestedModel.parse(model) if isinstance(model, str) else model


@Parameter(name="*")
class CalibrationRequest(Value):
    """Inputs of a calibration from files, besides the pictures via the mirrors, and the model to fit."""

    board: Path = Field(description="board.toml, or the file of Anipose, caliscope or Kalibr that describes the board")
    layout: Path | None = Field(default=None, description="layout.json of the design, to start from")
    direct_view: int | None = Bounds(1, 144).field(
        None,
        "number of mirrors, where each picture shows the board directly too: no layout is needed",
        unset="a layout",
    )
    base: tuple[Path, ...] = Field(
        default=(), description="pictures or videos of the board without mirrors, or folders of pictures"
    )
    corners: tuple[Path, ...] = Field(
        default=(),
        description="tables of corners like corners.csv, of pictures with and without mirrors, instead of pictures",
    )
    model: Annotated[
        RequestedModel, BeforeValidator(_parsed), Parameter(metavar="MODEL", accepts_keys=False, show_default=False)
    ] = Field(
        default=AUTO,
        description="model to fit, words joined by +: auto (what the pictures support), joint (with the layout's "
        "lens) or a lens (brown_conrady, rational, thin_prism, fisheye, spline) with any of sheet, bend, warp, bow "
        "and prism (with --direct-view sheet, bow, turn and board), paper, first_surface, second_surface: "
        "docs/calibration.md. [default: auto]",
    )

    @model_validator(mode="after")
    def _check(self) -> Self:
        if (self.layout is None) == (self.direct_view is None):
            raise ValueError("expected --layout FILE, or --direct-view N with the number of mirrors")
        if self.corners and (self.base or self.direct_view is not None):
            raise ValueError("--corners goes without --base and --direct-view")
        if self.direct_view is None:
            replace(self.model, surface=None).check_mirrored()
        else:
            self.model.check_direct()
        return self
