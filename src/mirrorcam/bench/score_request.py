"""Requests for scores: how to read and judge calibrations, and the command to evaluate."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal, Self

from cyclopts import Parameter
from pydantic import Field, model_validator

from mirrorcam.core.bounds import DEPTH_MM, Bounds
from mirrorcam.core.values import Value

Format = Literal["kalibr", "opencv", "ros", "colmap", "mrcal", "anipose", "mirrorcam"]
Unit = Literal["mm", "cm", "m", "none"]
Flip = Literal["flipped", "left-right", "top-bottom", "as-is"]
TIMEOUT_S = Bounds(1.0, 86400.0)
WORSE_BY = Bounds(1.0, 1000.0)


@Parameter(name="*")
class Reading(Value):
    """How to read calibrations, where their files do not state it, and limits of their figures."""

    format: Format | None = Field(
        default=None, description="format of the calibrations. [default: as their content states]"
    )
    unit: Unit | None = Field(
        default=None, description="unit of their poses; none: they have no scale. [default: that of the format]"
    )
    flip: Flip | None = Field(
        default=None,
        description="flip from frames to their pictures. [default: as the file states, else so that views are upright]",
    )
    views: Annotated[Path | None, Parameter(metavar="FILE")] = Field(
        default=None, description="TOML file that states which camera is which mirror, where names do not"
    )
    limits: Annotated[Path | None, Parameter(metavar="FILE")] = Field(
        default=None, description="TOML file of limits: FIGURE = NUMBER"
    )


@Parameter(name="*")
class ScoreRequest(Value):
    """Calibrations of rendered sets to score."""

    calibration: Annotated[tuple[Path, ...], Parameter(metavar="FILE|FOLDER...")] = Field(
        min_length=1,
        description="the calibration of each set; or a folder with one for each set, by the set's name",
    )
    covariance: Annotated[tuple[Path, ...], Parameter(metavar="FILE...")] = Field(
        default=(),
        description="covariance of the parameters of each calibration, JSON, for NEES; a layout.json has its own",
    )
    distance_mm: float | None = DEPTH_MM.field(None, "working distance from each view", unset="the layout's")


@Parameter(name="*")
class EvaluationRequest(Value):
    """A calibrator to run on the sets of a suite, and the baseline of its results."""

    command: str = Field(
        min_length=1,
        description="a shell command that calibrates one set: it reads the folder $MIRRORCAM_SET, and writes its "
        "calibration, and its covariance.json if it has one, into the folder $MIRRORCAM_RESULT",
    )
    timeout_s: float = TIMEOUT_S.field(
        600.0, "maximum seconds for one set, including the time to read and score its result"
    )
    baseline: Annotated[Path | None, Parameter(metavar="FILE")] = Field(
        default=None, description="evaluation.json of an earlier run, to compare with"
    )
    worse_by: float | None = WORSE_BY.field(
        None, "factor by which the RMS error of a set may exceed the baseline's", unset="any"
    )

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.worse_by is not None and self.baseline is None:
            raise ValueError("--worse-by: expected --baseline with it")
        return self
