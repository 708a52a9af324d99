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
    """Inputs of a calibration from files, besides the pictures, and the model to fit.

    Without a layout and a direct view, the pictures are of a camera without mirrors.
    """

    board: Path = Field(description="board.toml of the target")
    layout: Path | None = Field(
        default=None,
        description="layout.json of the design, to start from; without it and --direct-view, no mirrors are expected",
    )
    direct_view: int | None = Bounds(1, 144).field(
        None,
        "number of mirrors, where each picture shows the board directly too: no layout is needed",
        unset="a layout, or no mirrors",
    )
    camera: Annotated[str | None, Parameter(metavar="NAME|FILE")] = Field(
        default=None,
        description="the camera in pictures without mirrors, as in `mirrorcam design`: its name, body and pupil are "
        "kept [default: unknown]",
    )
    base: tuple[Path, ...] = Field(
        default=(), description="pictures or videos of the board without mirrors, or folders of pictures"
    )
    corners: tuple[Path, ...] = Field(
        default=(),
        description="tables of corners like corners.csv, of pictures with and without mirrors, instead of pictures",
    )
    leave_out: tuple[str, ...] = Field(default=(), description="pictures not to use, named as in the report")
    model: Annotated[
        RequestedModel, BeforeValidator(_parsed), Parameter(metavar="MODEL", accepts_keys=False, show_default=False)
    ] = Field(
        default=AUTO,
        description="model to fit, words joined by +: auto (what the pictures support), joint (with the layout's "
        "lens) or a lens (brown_conrady, rational, thin_prism, fisheye, spline) with any of sheet, bend, warp, bow, "
        "motion, prism and walk (with --direct-view sheet, bow, turn and board; without mirrors warp, bow, board, "
        "motion, prism and walk), paper, first_surface, second_surface: "
        "docs/calibration.md. [default: auto]",
    )

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.layout is not None and self.direct_view is not None:
            raise ValueError("expected --layout FILE, or --direct-view N with the number of mirrors, not both")
        if self.is_plain:
            if self.base or self.corners:
                raise ValueError(
                    f"{'--base' if self.base else '--corners'} needs --layout FILE or --direct-view N; of a camera "
                    "without mirrors, give the pictures alone"
                )
            self.model.check_plain()
            return self
        if self.camera is not None:
            raise ValueError("--camera is of pictures without mirrors, expected it without --layout and --direct-view")
        if self.corners and (self.base or self.direct_view is not None):
            raise ValueError("--corners goes without --base and --direct-view")
        if self.direct_view is None:
            replace(self.model, surface=None).check_mirrored()
        else:
            self.model.check_direct()
        return self

    @property
    def is_plain(self) -> bool:
        """Whether the pictures are of a camera without mirrors."""
        return self.layout is None and self.direct_view is None
