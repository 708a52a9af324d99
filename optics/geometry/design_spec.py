"""The specification of a design, and the error for one that no layout meets."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self

import numpy as np
from numpy.typing import ArrayLike
from pydantic import (
    AfterValidator,
    BeforeValidator,
    Field,
    SerializerFunctionWrapHandler,
    model_serializer,
    model_validator,
)

from mirrorcam.core.bounds import (
    AREA_MM2,
    DEPTH_MM,
    FOLD_DEG,
    GAP_MM,
    LENGTH_MM,
    MIRRORS,
    REFRACTIVE_INDEX,
    TOLERANCE_DEG,
    TOLERANCE_MM,
    Bounds,
)
from mirrorcam.core.errors import InputError
from mirrorcam.core.values import Converted, FloatArray, Value, with_tuples
from mirrorcam.optics.geometry.arrangement import Arrangement, Pattern
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.camera_library import named_camera
from mirrorcam.optics.geometry.rectangle_sizes import FREE, RECTANGLES, RectangleSizes, canonical_shape

if TYPE_CHECKING:
    from mirrorcam.optics.geometry.violation import LeastViolation

MAX_DEPTHS = 10
LENS_CLEARANCE_MM = 1.0
"""Clearance around the lens, to which no clip reaches, from mirrors and their light."""
FIRST_FOLD_DEG = 110.0
"""Start of the search for the best fold."""


def box_corners(low: ArrayLike, high: ArrayLike) -> FloatArray:
    """Corners (8, 3) of the box with the given minimum and maximum corners (3,)."""
    (a, b, c), (d, e, f) = np.asarray(low, dtype=np.float64), np.asarray(high, dtype=np.float64)
    return np.array([[x, y, z] for x in (a, d) for y in (b, e) for z in (c, f)])


def _camera_or_name(camera: object) -> object:
    # A request may come from a web page or another user's file: accept a name, but no path.
    return named_camera(camera) if isinstance(camera, str) else with_tuples(camera)


def _pattern_or_name(pattern: object) -> object:
    if not isinstance(pattern, str):
        return with_tuples(pattern)
    if (named := Pattern.named(pattern)) is None:
        raise ValueError(f"{pattern[:40]!r}, expected hexN, ringN or a table of positions")
    return named


def _shape_of(fields: dict[str, Any]) -> str:
    """The default shape: rectangles of four sides, else free outlines."""
    return RECTANGLES if fields.get("sides") == 4 else FREE


class DesignSpec(Value):
    """Specification of a mirror layout, for which `design` finds a `Layout` or names the constraint that cannot be met.

    Lengths are in mm, angles in degrees.
    """

    camera: Annotated[
        Converted[Camera, Camera | str], BeforeValidator(_camera_or_name, json_schema_input_type=Camera | str)
    ] = Field(
        default_factory=Camera.c920,
        validate_default=True,
        description="base camera: a name that `mirrorcam camera list` shows, or a JSON or TOML file",
    )
    rows: int = MIRRORS.field(3, "rows of mirrors, one row of views each")
    cols: int = MIRRORS.field(3, "columns of mirrors")
    pattern: Annotated[
        Converted[Pattern | None, Pattern | str | None],
        BeforeValidator(_pattern_or_name, json_schema_input_type=Pattern | str | None),
    ] = Field(
        default=None,
        validate_default=True,
        exclude_if=lambda pattern: pattern is None,
        description="positions of the views instead of rows and columns: hex7, hex19, ring8 or a JSON or TOML file",
    )
    scale_mm: float = LENGTH_MM.field(80.0, "distance from the pupil to the central mirror, along the optical axis")
    fold_deg: Annotated[float, FOLD_DEG.limits] | Literal["auto"] = Field(
        default=120.0,
        description="angle from the camera's axis to the views' axis: auto, which chooses the best whole degree, or "
        f"{FOLD_DEG}",
    )
    body_clearance_mm: float = GAP_MM.field(
        8.0, "clearance around the camera's body, for its clip, from mirrors and their light"
    )
    depths_mm: Converted[tuple[Annotated[float, DEPTH_MM.limits], ...], Sequence[float]] = Field(
        default=(300.0, 500.0),
        validate_default=True,
        min_length=1,
        max_length=MAX_DEPTHS,
        description=f"scene depths at which the views overlap, from the pupil: 1 to {MAX_DEPTHS} of {DEPTH_MM}",
    )
    spacing_mm: float = GAP_MM.field(1.0, "smallest gap between any two mirrors")
    seen_gap_mm: float = GAP_MM.field(0.5, "smallest gap between sub-images, in mm at the distance of scale_mm")
    sides: int = Bounds(4, 6).field(4, "corners of each mirror, and so of each sub-image")
    shape: Annotated[str, AfterValidator(canonical_shape)] = Field(
        default_factory=_shape_of,
        description="outlines of the mirrors: rectangles, the default for four sides, with sides in steps of "
        "size_step_mm, for a glass cutter or a guillotine; stock: and the sizes that are sold, in mm, such as "
        "stock:25x15,30x20, of which each mirror gets the best; or free, for any convex outline, which use the most "
        "pixels and need a laser or a practised hand",
    )
    size_step_mm: float = Field(
        default=1.0,
        ge=LENGTH_MM.min,
        le=LENGTH_MM.max,
        exclude_if=lambda step_mm: step_mm == 1.0,
        description=f"step of the sides of rectangles that are cut, {LENGTH_MM}",
    )
    same_size: bool = Field(
        default=False,
        exclude_if=lambda is_same: not is_same,
        description="whether all mirrors are rectangles of one size",
    )
    min_edge_mm: float = GAP_MM.field(3.0, "shortest edge of a mirror that can be cut")
    min_area_mm2: float = AREA_MM2.field(20.0, "smallest area of a mirror that can be cut and glued")
    tradeoff: float = Field(
        default=0.3, ge=0, le=1, description="from 0 (usable pixels alone) to 1 (a regular grid of views alone)"
    )
    objective: Literal["overlap", "depth"] = Field(
        default="overlap",
        description="overlap: most pixels on the region all views see; depth: smallest standard deviation of depth, "
        "with 99 % of the pixels and of the field of view of the design for overlap",
    )
    robust_tilt_deg: float = TOLERANCE_DEG.field(
        0.0,
        "standard deviation of mirror tilts about each of two axes: the design optimises the mean usable efficiency "
        "of devices with these errors; 0: of the exact device alone",
    )
    robust_offset_mm: float = TOLERANCE_MM.field(
        0.0,
        "standard deviation of mirror shifts along their normals: no mirror may hide part of another in devices with "
        "these errors",
    )
    surface: Literal["first", "second"] = Field(default="first", description="which face of the mirrors reflects")
    thickness_mm: float = LENGTH_MM.field(3.0, "thickness of the mirrors")
    refractive_index: float = REFRACTIVE_INDEX.field(1.52, "refractive index of the mirrors: glass 1.52, acrylic 1.49")

    @property
    def is_second_surface(self) -> bool:
        """True if the mirrors are second-surface mirrors, see `Mirror.is_second_surface`."""
        return self.surface == "second"

    @cached_property
    def rectangle_sizes(self) -> RectangleSizes | None:
        """The allowed sizes of rectangular mirrors; None for free outlines."""
        return RectangleSizes.of(self.shape, self.size_step_mm)

    @cached_property
    def view_from_rig(self) -> FloatArray:
        """Rotation (3, 3) from rig frame to view axes; the views look along (0, sin fold, cos fold), x is unchanged.

        For the fold "auto", the rotation is that of `FIRST_FOLD_DEG`.
        """
        fold = np.deg2rad(FIRST_FOLD_DEG if self.fold_deg == "auto" else self.fold_deg)
        cosine, sine = np.cos(fold).round(15) + 0.0, np.sin(fold)
        return np.array([[1.0, 0.0, 0.0], [0.0, cosine, -sine], [0.0, sine, cosine]])

    @cached_property
    def arrangement(self) -> Arrangement:
        """The arrangement of the views: the pattern if there is one, else rows and columns."""
        if self.pattern is None:
            return Arrangement(self.rows, self.cols)
        return Arrangement(1, len(self.pattern.positions), self.pattern)

    @model_serializer(mode="wrap")
    def _written(self, write: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """All fields, without rows and columns if there is a pattern."""
        written: dict[str, Any] = write(self)
        return written if self.pattern is None else {k: v for k, v in written.items() if k not in ("rows", "cols")}

    @cached_property
    def keep_outs_in_rig_mm(self) -> FloatArray:
        """Corners (n, 8, 3) of the boxes around camera and clip, and around a lens; none if they are unknown."""
        boxes = ((self.camera.body_mm, self.body_clearance_mm), (self.camera.lens_mm, LENS_CLEARANCE_MM))
        sides = np.array([[-1.0], [1.0]])
        corners = [box_corners(*(np.array(box) + sides * clearance)) for box, clearance in boxes if box is not None]
        return np.array(corners).reshape(-1, 8, 3)

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.pattern is not None and (self.rows, self.cols) != (3, 3):
            raise ValueError("rows or cols are given with a pattern, expected either a grid or a pattern")
        if self.rows * self.cols < 2:
            raise ValueError("rows x cols is 1, expected at least two mirrors")
        if len(set(self.depths_mm)) != len(self.depths_mm):
            raise ValueError(f"depths_mm {self.depths_mm} contains a depth twice")
        self._check_shape()
        if self.objective == "depth" and self.robust_tilt_deg > 0.0:
            raise ValueError("robust_tilt_deg is given with the objective depth, but applies only to overlap")
        return self

    def _check_shape(self) -> None:
        sizes = self.rectangle_sizes
        if sizes is None:
            if self.same_size:
                raise ValueError("same_size is given with free outlines, expected shape rectangles or stock:")
            return
        if self.sides != 4:
            raise ValueError(f"sides is {self.sides} with shape {self.shape}, expected 4, or shape free")
        if sizes.is_stock:
            too_small = sizes.stock_mm[
                (sizes.stock_mm[:, 1] <= self.min_edge_mm) | (sizes.stock_mm.prod(axis=1) <= self.min_area_mm2)
            ]
            for longer, shorter in too_small:
                raise ValueError(
                    f"shape has the size {longer:g}x{shorter:g}, expected sides above min_edge_mm = "
                    f"{self.min_edge_mm:g} and an area above min_area_mm2 = {self.min_area_mm2:g}"
                )


GAVE_UP = "every"
"""Constraint name for a search that failed for an unknown reason, which proves nothing about the spec."""


class InfeasibleDesign(InputError):
    """No layout meets the spec; the message names the constraint that cannot be met and by how much.

    `violation` holds the mirrors with the smallest violation, if the search found any, and where it occurs.
    """

    def __init__(self, constraint: str, finding: str, violation: LeastViolation | None = None) -> None:
        super().__init__(f"infeasible design, {constraint} constraint: {finding}")
        self.constraint = constraint
        self.finding = finding
        self.violation = violation

    def __reduce__(self) -> tuple[type[Self], tuple[str, str, LeastViolation | None]]:
        return type(self), (self.constraint, self.finding, self.violation)
