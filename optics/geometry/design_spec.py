"""The request for a design."""

from __future__ import annotations

from functools import cached_property
from typing import Literal, Self

import numpy as np
from pydantic import Field, model_validator

from mirrorcam.optics.base.values import FloatArray, InputError, Value
from mirrorcam.optics.geometry.camera import Camera


class DesignSpec(Value):
    """Specification of a mirror layout, for which `design` finds a `Layout` or names the constraint that cannot be met.

    Lengths are in mm, angles in degrees.
    """

    camera: Camera = Field(default_factory=Camera.c920, description="the base camera: c920, or a JSON or TOML file")
    rows: int = Field(default=3, ge=1, le=12, description="rows of mirrors, one row of views each")
    cols: int = Field(default=3, ge=1, le=12, description="columns of mirrors")
    scale_mm: float = Field(default=80.0, gt=0, description="height of the central mirror above the pupil")
    fold_deg: float = Field(default=90.0, ge=60, le=150, description="angle from the camera's axis to the views' axis")
    depths_mm: tuple[float, ...] = Field(
        default=(300.0, 500.0),
        min_length=1,
        description="scene depths at which the views overlap, from the pupil",
    )
    spacing_mm: float = Field(default=1.0, ge=0, description="smallest gap between any two mirrors")
    seen_gap_mm: float = Field(
        default=0.5, ge=0, description="smallest gap between sub-images, in mm at the distance of scale_mm"
    )
    sides: int = Field(default=4, ge=4, le=6, description="corners of each mirror, and so of each sub-image")
    min_edge_mm: float = Field(default=3.0, ge=0, description="shortest edge of a mirror that can be cut")
    min_area_mm2: float = Field(default=20.0, ge=0, description="smallest area of a mirror that can be cut and glued")
    tradeoff: float = Field(
        default=0.3, ge=0, le=1, description="0 optimises pixel efficiency alone, 1 a regular grid of views alone"
    )
    surface: Literal["first", "second"] = Field(default="first", description="which face of the mirrors reflects")
    thickness_mm: float = Field(default=1.0, gt=0, description="thickness of the mirrors")
    refractive_index: float = Field(default=1.49, ge=1, description="refractive index of the mirrors (acrylic 1.49)")

    @property
    def is_second_surface(self) -> bool:
        """True if second-surface mirrors are asked for, see `Mirror.is_second_surface`."""
        return self.surface == "second"

    @cached_property
    def view_from_rig(self) -> FloatArray:
        """The rotation (3, 3) to view axes: the views look along (0, sin fold, cos fold) of the rig, x stays x."""
        fold = np.deg2rad(self.fold_deg)
        cosine, sine = np.cos(fold).round(15) + 0.0, np.sin(fold)
        return np.array([[1.0, 0.0, 0.0], [0.0, cosine, -sine], [0.0, sine, cosine]])

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.rows * self.cols < 2:
            raise ValueError("rows x cols is 1, expected at least two mirrors")
        if any(depth <= 0 for depth in self.depths_mm):
            raise ValueError(f"depths_mm {self.depths_mm}, expected positive depths")
        if len(set(self.depths_mm)) != len(self.depths_mm):
            raise ValueError(f"depths_mm {self.depths_mm} names a depth twice")
        return self


GAVE_UP = "every"
"""The constraint named where the search found no layout for unknown reasons, which proves nothing about the spec."""


class InfeasibleDesign(InputError):
    """No layout meets the spec; the message names the constraint that cannot hold and by how much it is missed."""

    def __init__(self, constraint: str, finding: str) -> None:
        super().__init__(f"infeasible design, {constraint} constraint: {finding}")
        self.constraint = constraint
        self.finding = finding
