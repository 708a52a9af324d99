"""The layout: a base camera and its mirrors, shared by all packages, with its file format and its working distance."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Annotated, Literal, Self

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray
from pydantic import AfterValidator, BeforeValidator, Field, ValidationInfo, model_validator
from shapely import Polygon, STRtree

from mirrorcam.core.arguments import AnyPath, check_type, path_of
from mirrorcam.core.bounds import GRID
from mirrorcam.core.disk.files import LARGEST_LAYOUT_BYTES, read_model, write_text
from mirrorcam.core.disk.fingerprint import value_digest
from mirrorcam.core.errors import InputError
from mirrorcam.core.values import Converted, FloatArray, Matrix3, Metric, SquareMatrix, Value, array_of, with_tuples
from mirrorcam.optics.geometry.arrangement import Arrangement, Pattern
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.camera_library import named_camera
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.mirror import Mirror
from mirrorcam.optics.geometry.rectangle_sizes import FREE

FOLD_90_VIEW_FROM_RIG = ((1.0, 0.0, 0.0), (0.0, 0.0, -1.0), (0.0, 1.0, 0.0))
MAX_HIDDEN = 0.02
"""Fraction of a sub-image that another may hide in a device as built; a larger overlap means wrong mirrors."""
WORKING_DISTANCE = "working_distance_mm"
"""Median distance of the calibration's corners from the views, in the metrics of a calibrated layout."""
VOLUME_FACTORS = (0.7, 1.0, 1.4)
"""Distances within the working volume, relative to the working distance."""


class Uncertainty(Value):
    """Covariance of calibrated parameters with names like "mirror 4 x_mm" or "fx_px", which state the units."""

    parameters: tuple[str, ...]
    covariance: SquareMatrix

    @model_validator(mode="after")
    def _check(self) -> Self:
        expected = (len(self.parameters),) * 2
        if self.covariance.shape != expected:
            raise ValueError(f"covariance has shape {self.covariance.shape}, expected {expected}")
        return self


def _free_if_unstated(spec: DesignSpec | None, info: ValidationInfo) -> DesignSpec | None:
    """The specification of a file; layouts of version 0.2.0 state no shape, as all outlines were free."""
    is_unstated = spec is not None and info.mode == "json" and "shape" not in spec.model_fields_set
    return spec.replaced(shape=FREE) if spec is not None and is_unstated else spec


def _camera_of(camera: object, info: ValidationInfo) -> object:
    """A camera, or in Python its name in the library; the camera of a file is a table."""
    return named_camera(camera) if isinstance(camera, str) and info.mode == "python" else with_tuples(camera)


class Layout(Value):
    """A base camera and its mirrors, row by row: t down (view y), s right (view x); a pattern is a single row.

    Nominal (designed), as-built (perturbed) and calibrated layouts share this type. All lengths are mm in the rig
    frame: origin at the entrance pupil, +x image right, +y image down, +z along the optical axis.

    Attributes
    ----------
    kind : str
        `nominal`, `as-built` or `calibrated`.
    rows, cols : int
        Number of mirrors along t and s; for a pattern, 1 and the number of mirrors; 0 and 0 for a bare camera.
    pattern : Pattern or None
        Positions of views that do not form a rectangular grid, in the order of the mirrors.
    camera : Camera
        The base camera, at the origin of the rig frame.
    mirrors : tuple of Mirror
        Row by row, in the rig frame, mm.
    view_from_rig : ndarray
        Rotation (3, 3) from the rig frame to view axes: x right, y down, z forward to the scene.
    spec : DesignSpec or None
        The specification that the layout was designed for.
    metrics : dict of str to Metric
        Figures of merit of these mirrors. They are dropped when mirrors move, until the layout is evaluated again.
    verdict : dict of str to Metric
        Figures that a specification limits, with their limits, as `verify` measured them.
    provenance : dict of str to str
        The function that made the layout, and the layout that it was made from.
    uncertainty : Uncertainty or None
        Covariance of the calibrated parameters.
    """

    schema_id: Literal["mirrorcam.layout/1"] = Field(default="mirrorcam.layout/1", alias="schema")
    kind: Literal["nominal", "as-built", "calibrated"] = "nominal"
    rows: int = GRID.narrowed(min=0).field()
    cols: int = GRID.narrowed(min=0).field()
    pattern: Pattern | None = Field(default=None, exclude_if=lambda pattern: pattern is None)
    camera: Annotated[Converted[Camera, Camera | str], BeforeValidator(_camera_of)]
    mirrors: Converted[tuple[Mirror, ...], Sequence[Mirror]]
    view_from_rig: Matrix3 = Field(default=FOLD_90_VIEW_FROM_RIG, validate_default=True)
    spec: Annotated[DesignSpec | None, AfterValidator(_free_if_unstated)] = None
    metrics: dict[str, Metric] = Field(default_factory=dict)
    verdict: dict[str, Metric] = Field(default_factory=dict)
    provenance: dict[str, str] = Field(default_factory=dict)
    uncertainty: Uncertainty | None = None

    @model_validator(mode="after")
    def _check(self) -> Self:
        if len(self.mirrors) != self.rows * self.cols:
            raise ValueError(f"{len(self.mirrors)} mirrors, expected rows x cols = {self.rows * self.cols}")
        if (self.rows == 0) != (self.cols == 0):
            raise ValueError(f"{self.rows} x {self.cols} mirrors, expected 1 x 1 or more, or a bare camera with 0 x 0")
        _ = self.arrangement
        rotation = self.view_from_rig
        if not np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-9) or np.linalg.det(rotation) < 0:
            raise ValueError("view_from_rig is not a rotation")
        polygons = np.array([Polygon(mirror.apparent.outline_normalized) for mirror in self.mirrors], dtype=object)
        touching = STRtree(polygons).query(polygons, predicate="intersects").T
        for i, j in sorted(pair for pair in touching.tolist() if pair[0] < pair[1]):
            shared = polygons[i].intersection(polygons[j]).area
            allowed = 1e-12 if self.kind == "nominal" else MAX_HIDDEN * min(polygons[i].area, polygons[j].area)
            if shared > allowed:
                pair = f"{self.mirror_names[i]} and {self.mirror_names[j]}"
                raise ValueError(f"outlines of mirrors {pair} overlap in the image, expected a gap")
        return self

    @classmethod
    def bare(cls, camera: Camera) -> Self:
        """A camera without mirrors, whose view axes are its own: the form in which it is calibrated."""
        return cls(kind="calibrated", rows=0, cols=0, camera=camera, mirrors=(), view_from_rig=np.eye(3))

    @cached_property
    def identity(self) -> str:
        """Hash (16 hexadecimal digits) of camera, mirrors and view axes. Nothing else affects it, not even names."""
        hashed = self.model_dump(
            mode="json",
            include={"rows", "cols", "camera", "mirrors", "view_from_rig"},
            exclude={"camera": {"name"}},
        )
        return value_digest(hashed)[:16]

    @cached_property
    def virtual_centres_in_rig_mm(self) -> FloatArray:
        """Virtual camera centres (rows*cols, 3) of the apparent mirrors (see `Mirror.apparent`)."""
        return np.array([mirror.apparent.virtual_centre_in_rig_mm for mirror in self.mirrors]).reshape(-1, 3)

    @cached_property
    def virtual_centres_in_view_mm(self) -> FloatArray:
        """Virtual camera centres (rows, cols, 3) in view axes (x right, y down, z forward), origin at the pupil."""
        return (self.virtual_centres_in_rig_mm @ self.view_from_rig.T).reshape(self.rows, self.cols, 3)

    @cached_property
    def arrangement(self) -> Arrangement:
        """The arrangement of the views: a grid or a pattern."""
        return Arrangement(self.rows, self.cols, self.pattern)

    @property
    def designed_spec(self) -> DesignSpec:
        """The specification. Raises ValueError for a layout without one."""
        if self.spec is None:
            raise ValueError("the layout has no spec, expected one that was designed")
        return self.spec

    @property
    def mirror_names(self) -> tuple[str, ...]:
        """Name of each mirror for display: "0-2" for row 0, column 2 of a grid, "2" in a pattern."""
        return self.arrangement.names

    @property
    def central_index(self) -> int:
        """Index of the central mirror, whose view is the reference (`Arrangement.central_index`)."""
        return self.arrangement.central_index

    def project(self, points_in_rig: ArrayLike, mirror: int | str) -> FloatArray:
        """Project points into the frame of the camera via one mirror, as if the mirror were unbounded.

        Exact, also for second-surface and bent mirrors (`Mirror.image_of`). `shows` tells which pixels are in the
        mirror's sub-image.

        Parameters
        ----------
        points_in_rig
            Points (..., 3) in the rig frame, mm.
        mirror
            Index of the mirror, or its name of `mirror_names`: "0-2" is row 0, column 2.

        Returns
        -------
        ndarray
            Pixels (..., 2) of the frame, x right and y down; NaN where the lens has no pixel.

        Raises
        ------
        InputError
            For a name or index of no mirror, and points of another shape.
        """
        points = array_of("points_in_rig", points_in_rig, ..., 3)
        return self.camera.project(self.mirrors[self._index_of(mirror)].image_of(points))

    def shows(self, pixels: ArrayLike, mirror: int | str) -> NDArray[np.bool_]:
        """Mask (...) of the pixels (..., 2) that are in the frame and show the scene via a mirror; NaN is in none.

        Raises InputError like `project`.
        """
        polygon = Polygon(self.outline_px(self._index_of(mirror), usable=True))
        x, y = np.moveaxis(array_of("pixels", pixels, ..., 2), -1, 0)
        right, bottom = self.camera.width_px - 0.5, self.camera.height_px - 0.5
        in_frame = (x >= -0.5) & (x < right) & (y >= -0.5) & (y < bottom)
        return np.asarray(in_frame & shapely.contains_xy(polygon, x, y))

    def _index_of(self, mirror: int | str) -> int:
        mirror = int(mirror) if isinstance(mirror, np.integer) else mirror
        check_type("mirror", mirror, int, str)
        known = self.mirror_names if isinstance(mirror, str) else range(len(self.mirrors))
        for index, each in enumerate(known):
            if mirror == each:
                return index
        raise InputError(f"mirror {mirror!r}, expected one of {', '.join(map(str, known))}")

    def outline_px(self, mirror_index: int, points_per_edge: int = 16, *, usable: bool = False) -> FloatArray:
        """The sub-image's outline (n, 2) on the distorted sensor; edges are sampled because distortion bends them.

        `usable` selects the part that shows the scene, see `Mirror.usable_normalized`.
        """
        mirror = self.mirrors[mirror_index].apparent
        corners = self.mirrors[mirror_index].usable_normalized if usable else mirror.outline_normalized
        fractions = np.linspace(0.0, 1.0, points_per_edge, endpoint=False)[None, :, None]
        edges = (corners[:, None] * (1.0 - fractions) + np.roll(corners, -1, axis=0)[:, None] * fractions).reshape(
            -1, 2
        )
        if not mirror.curvature_per_m.any():
            return self.camera.pixels_from_normalized(edges)
        on_plane = mirror.intersect(edges)
        return self.camera.project(on_plane + mirror.sag_mm(on_plane)[:, None] * mirror.normal_in_rig)

    def with_surface(self, surface: Literal["first", "second"], thickness_mm: float | None = None) -> Self:
        """The layout with all mirrors first- or second-surface, and the same images along their chief rays.

        `thickness_mm` is the thickness of the plates of second-surface mirrors; None keeps the mirrors' own.
        """
        if all(mirror.surface == surface for mirror in self.mirrors):
            return self
        return self.replaced(
            mirrors=tuple(mirror.with_surface(surface, thickness_mm) for mirror in self.mirrors), spec=None
        )

    def save(self, path: AnyPath) -> None:
        """Write `layout.json` atomically."""
        write_text(path_of("path", path), self.text())

    def text(self) -> str:
        """The content of `layout.json`."""
        return self.model_dump_json(indent=1, by_alias=True, exclude_none=True) + "\n"

    @classmethod
    def load(cls, path: AnyPath) -> Self:
        """Read `layout.json`. Raises InputError, with a one-line message, for invalid content or without mirrors."""
        layout = read_model(cls, path_of("path", path), LARGEST_LAYOUT_BYTES)
        if not layout.mirrors:
            raise InputError(f"{path}: no mirrors, expected a layout with 1 x 1 or more")
        return layout


def working_distance_mm(layout: Layout) -> float | None:
    """Distance of the calibration's boards; without a calibration, the mean depth of the design."""
    measured = layout.metrics.get(WORKING_DISTANCE)
    if measured is not None and measured.known:
        return measured.value
    return None if layout.spec is None else float(np.mean(layout.spec.depths_mm))


def working_range_mm(layout: Layout) -> tuple[float, float] | None:
    """Minimum and maximum distance of the working volume around the boards and the depths of the design."""
    depths = [] if layout.spec is None else list(layout.spec.depths_mm)
    measured = layout.metrics.get(WORKING_DISTANCE)
    if measured is not None and measured.known:
        depths += [factor * measured.value for factor in VOLUME_FACTORS]
    return (min(depths), max(depths)) if depths else None
