"""Inputs of a calibration from files, and the model to fit."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Self

from cyclopts import Parameter
from pydantic import BeforeValidator, Field, model_validator

from mirrorcam.core.bounds import LENGTH_MM, Bounds
from mirrorcam.core.values import Value
from mirrorcam.optics.calibration.diagnostics.requested_model import AUTO, RequestedModel


def _parsed(model: Any) -> Any:
    return RequestedModel.parse(model) if isinstance(model, str) else model


@Parameter(name="*")
class CalibrationRequest(Value):
    """Inputs of a calibration from files, besides the pictures, and the model to fit.

    Without a layout and a direct view, the pictures are of a camera without mirrors.
    """

    board: Path | None = Field(
        default=None,
        description="board.toml, or the file of Anipose, caliscope or Kalibr that describes the board",
    )
    layout: Path | None = Field(
        default=None,
        description="layout.json of the design, to start from",
    )
    direct_view: int | None = Bounds(1, 144).field(
        None,
        "number of mirrors, if each picture also shows the board itself; needs no layout",
        unset="a layout, or no mirrors",
    )
    camera: Annotated[str | None, Parameter(metavar="NAME|FILE")] = Field(
        default=None,
        description="without mirrors: camera as in `mirrorcam design`, whose name, body and pupil the result keeps; "
        "with --labels: calibrated camera (file of OpenCV, ROS or Kalibr, or layout.json), or one of the library "
        "[default: unknown]",
    )
    base: tuple[Path, ...] = Field(
        default=(), description="pictures or videos of the board without mirrors, or folders of pictures"
    )
    corners: tuple[Path, ...] = Field(
        default=(),
        description="tables of corners like corners.csv, of pictures with and without mirrors, instead of pictures",
    )
    leave_out: tuple[str, ...] = Field(default=(), description="pictures not to use, named as in the report")
    labels: tuple[Path, ...] = Field(
        default=(),
        description="labels of an animal in the direct view and in mirrors instead of a board: tables of DeepLabCut, "
        "SLEAP or Anipose, or CSV with frame, view, label, x_px, y_px",
    )
    views: tuple[str, ...] = Field(
        default=(),
        description="with --labels: names of the views, the direct one first, as prefixes or suffixes of labels "
        "(paw_side), or one name for each table",
    )
    field_of_view: tuple[float, float] | None = Field(
        default=None,
        description="with --labels and a picture: horizontal field of view of the camera, 5 to 150 degrees, and its "
        "standard deviation",
    )
    known_length: tuple[str, str, float] | None = Field(
        default=None,
        description="with --labels: two labels and their distance, 0.001 to 100000 mm, or `camera` and a view and the "
        "distance of that mirror's plane",
    )
    model: Annotated[
        RequestedModel, BeforeValidator(_parsed), Parameter(metavar="MODEL", accepts_keys=False, show_default=False)
    ] = Field(
        default=AUTO,
        description="model to fit, words joined by +: auto (select by evidence), joint (with the layout's "
        "lens) or a lens (brown_conrady, rational, thin_prism, fisheye, spline), then further parameters: warp, bow, "
        "motion, prism, walk, colour; with mirrors sheet, bend; with --direct-view turn; without mirrors or with "
        "--direct-view board. Or paper, first_surface, second_surface: docs/calibration.md. [default: auto]",
    )

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.labels:
            return self._checked_for_labels()
        if self.views or self.field_of_view or self.known_length:
            raise ValueError("--views, --field-of-view and --known-length go with --labels only")
        if self.board is None:
            raise ValueError("expected --board FILE, or --labels FILE without a board")
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
        return self

    def _checked_for_labels(self) -> Self:
        if self.board or self.layout or self.direct_view or self.base or self.corners or self.model != AUTO:
            raise ValueError("--labels goes without --board, --layout, --direct-view, --base, --corners and --model")
        if self.field_of_view is not None:
            view_deg, sigma_deg = self.field_of_view
            if self.camera is not None or not (5.0 <= view_deg <= 150.0 and 0.0 < sigma_deg <= view_deg / 4.0):
                raise ValueError(
                    f"--field-of-view {view_deg:g} {sigma_deg:g}: expected 5 to 150 degrees, a standard deviation up "
                    "to a quarter of it, and no --camera"
                )
        if self.known_length is not None and not LENGTH_MM.min <= self.known_length[2] <= LENGTH_MM.max:
            raise ValueError(f"--known-length {self.known_length[2]:g}: expected {LENGTH_MM} mm")
        return self

    @property
    def is_plain(self) -> bool:
        """Whether the pictures are of a camera without mirrors."""
        return self.layout is None and self.direct_view is None
