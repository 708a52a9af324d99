"""The decoded light field: parallel views [t, s, v, u, c] at their true positions, and the weight of each sample."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any, Literal, Self, get_args

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from mirrorcam.core.arguments import check_choice, check_number, check_type
from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray, InvalidValue, Shaped, array_of
from mirrorcam.optics.light_field.camera_array import MAX_UNEVENNESS, central_view, even_grid
from mirrorcam.optics.light_field.image_arrays import (
    numbers_in,
    pictures_of,
    positions_of,
    rectified_pictures,
    weights_of,
)

Axis = Literal["s", "t"]
Samples = NDArray[np.uint8] | NDArray[np.float32]

_SHAPES = {
    "positions_mm": (None, None, 3),
    "centre_px": (2,),
    "reference_view_in_rig_mm": (3,),
    "view_from_rig": (3, 3),
}


@dataclass(frozen=True, eq=False, kw_only=True)
class Views:
    """Geometry of parallel views: which ray each pixel of each view samples. Views form a grid, or are listed in
    one row if they form another pattern.

    The view frame has its origin at the reference (central) view, x right, y down, z forward. Pixel (u, v) of *every*
    view looks at the same point (X, Y) of the reference plane, which lies Z0 in front of the reference view:
    u = f X / Z0 + cx. So view i at (x_i, y_i, z_i) is exactly the off-axis pinhole

        u = f_i (X - x_i) / (Z - z_i) + cx + f x_i / Z0,    f_i = f (1 - z_i / Z0)

    (v with y), and u = f X / Z + cx + f x_i (1 / Z0 - 1 / Z) if z_i is zero. The disparity is zero on the entire
    reference plane even if the grid is uneven. Z0 may be infinite: the views are then pinholes with equal principal
    points.

    As everywhere, "depth" is measured from the pupil along view z: with a 90 degree fold, it is y in the rig frame. The
    Z of the formulas is "distance", measured from the reference view.

    Attributes
    ----------
    positions_mm : ndarray
        True positions (t, s, 3) in the view frame; exactly zero for the reference view.
    focal_px : float
        Focal length f of the reference view.
    centre_px : ndarray
        Principal point (cx, cy) of the reference view.
    width_px, height_px : int
        Size of every view.
    reference_depth_mm : float
        Depth of the plane of zero disparity; may be infinite.
    reference_view_in_rig_mm : ndarray
        Position (3,) of the reference view in the rig frame.
    view_from_rig : ndarray
        Rotation matrix (3, 3) from rig axes to view axes.
    layout_identity : str
        `Layout.identity` of the layout used for decoding.
    """

    positions_mm: FloatArray
    focal_px: float
    centre_px: FloatArray
    width_px: int
    height_px: int
    reference_depth_mm: float
    reference_view_in_rig_mm: FloatArray
    view_from_rig: FloatArray
    layout_identity: str

    def __post_init__(self) -> None:
        for name, shape in _SHAPES.items():
            try:
                object.__setattr__(self, name, Shaped(shape).check(getattr(self, name)))
            except ValueError as error:
                raise InvalidValue(f"{name}: {error}") from None
        for name in ("focal_px", "reference_depth_mm"):
            check_number(name, getattr(self, name))
        if not (np.isfinite(self.focal_px) and self.focal_px > 0):
            raise InvalidValue(f"focal_px: {self.focal_px:g}, expected a positive number")
        if np.isnan(self.reference_depth_mm):
            raise InvalidValue("reference_depth_mm: nan, expected a number or infinity")
        if self.reference_distance_mm <= self.positions_mm[..., 2].max():
            raise InvalidValue(f"reference plane at depth {self.reference_depth_mm} mm lies behind a view")

    @classmethod
    def parallel(
        cls,
        positions_mm: FloatArray,
        size: tuple[int, int],
        focal_px: float,
        distance_mm: float,
        centre_px: FloatArray | None = None,
    ) -> Views:
        """Return views at positions (t, s, 2) or (t, s, 3), x, y and z, that coincide on the plane at `distance_mm`.

        The central view (see `central_view`) is the reference, with the pupil in it; `size` is width and height in px.
        The default principal point is the centre of the view.
        """
        rows, cols, axes = positions_mm.shape
        positions = np.zeros((rows, cols, 3))
        positions[..., :axes] = positions_mm - positions_mm[central_view(rows, cols)]
        picture_centre = np.array([(size[0] - 1) / 2.0, (size[1] - 1) / 2.0])
        return Views(
            positions_mm=positions,
            focal_px=focal_px,
            centre_px=picture_centre if centre_px is None else centre_px,
            width_px=size[0],
            height_px=size[1],
            reference_depth_mm=distance_mm,
            reference_view_in_rig_mm=np.zeros(3),
            view_from_rig=np.eye(3),
            layout_identity="",
        )

    @property
    def rows(self) -> int:
        return self.positions_mm.shape[0]

    @property
    def cols(self) -> int:
        return self.positions_mm.shape[1]

    @cached_property
    def reference_view_depth_mm(self) -> float:
        """Depth of the reference view: a point's depth minus its distance from the reference view, mm."""
        return float(self.view_from_rig[2] @ self.reference_view_in_rig_mm)

    @property
    def reference_distance_mm(self) -> float:
        """Z0: distance of the reference plane from the reference view along view z."""
        return self.reference_depth_mm - self.reference_view_depth_mm

    @cached_property
    def matrices(self) -> FloatArray:
        """The exact intrinsic matrices (t, s, 3, 3) of the views."""
        distance_mm = self.reference_distance_mm
        scale = self.focal_px / distance_mm
        focal = self.focal_px if np.isinf(distance_mm) else scale * (distance_mm - self.positions_mm[..., 2])
        matrices = np.zeros((self.rows, self.cols, 3, 3))
        matrices[..., 0, 0] = matrices[..., 1, 1] = focal
        matrices[..., :2, 2] = self.centre_px + scale * self.positions_mm[..., :2]
        matrices[..., 2, 2] = 1.0
        return matrices

    def project_in_view(self, points_in_view: ArrayLike) -> FloatArray:
        """Return the pixels (t, s, ..., 2) in all views of points (..., 3) in the view frame, mm; NaN behind a view.

        The view frame has its origin at the reference view, view axes have theirs at the pupil. Rotate points in view
        axes to the rig frame, and call `project`. Raises InputError for points of another shape.
        """
        points = array_of("points_in_view", points_in_view, ..., 3)
        grid = (self.rows, self.cols) + (1,) * (points.ndim - 1)
        offset = points - self.positions_mm.reshape(*grid, 3)
        ahead = np.where(offset[..., 2:] > 0, offset[..., 2:], np.nan)
        focal = self.matrices[..., 0, 0].reshape(*grid, 1)
        return focal * offset[..., :2] / ahead + self.matrices[..., :2, 2].reshape(*grid, 2)

    def project(self, points_in_rig: ArrayLike) -> FloatArray:
        """Return the pixels (t, s, ..., 2) in every view of points (..., 3) in the rig frame, mm; NaN behind a view.

        Raises InputError for points of another shape.
        """
        points = array_of("points_in_rig", points_in_rig, ..., 3)
        return self.project_in_view((points - self.reference_view_in_rig_mm) @ self.view_from_rig.T)

    def plane_points_in_rig(
        self, depth_mm: float, pixels: ArrayLike, view: tuple[int, int] | None = None
    ) -> FloatArray:
        """Return the points (..., 3) of the plane at `depth_mm` that a view (t, s) sees at pixels (..., 2).

        Points are in the rig frame, mm; the default view is the reference view. At the reference depth, a pixel shows
        the same point in all views. Raises InputError for pixels of another shape.
        """
        places = array_of("pixels", pixels, ..., 2)
        distance = depth_mm - self.reference_view_depth_mm
        position, matrix = np.zeros(3), np.diag([self.focal_px, self.focal_px, 1.0])
        matrix[:2, 2] = self.centre_px
        if view is not None:
            position, matrix = self.positions_mm[view], self.matrices[view]
        offset = (places - matrix[:2, 2]) * ((distance - position[2]) / matrix[0, 0])
        in_view = np.concatenate([offset + position[:2], np.full((*offset.shape[:-1], 1), distance)], axis=-1)
        return in_view @ self.view_from_rig + self.reference_view_in_rig_mm

    def pixel_grid(self) -> FloatArray:
        """Return the pixel centres (v, u, 2) of a view, as (u, v)."""
        return np.stack(np.meshgrid(np.arange(self.width_px), np.arange(self.height_px)), axis=-1).astype(np.float64)

    @cached_property
    def is_grid(self) -> bool:
        """Whether the views form rows and columns, however uneven, rather than another pattern.

        Their RMS deviation from the best-fitting even grid, with any two axes, is at most half its smaller step.
        """
        return even_grid(self.positions_mm[..., :2])[1] <= MAX_UNEVENNESS

    def require_grid(self, purpose: str) -> None:
        """Raise InputError, naming the purpose, unless the views form a grid."""
        if not self.is_grid:
            raise InputError(
                f"{purpose} needs rows and columns of views, but these {self.rows * self.cols} form another pattern"
            )

    def step_mm(self, axis: Axis = "s") -> float:
        """Mean distance of adjacent views along s (view x) or t (view y), mm; positive in the order of the grid.

        If the views do not form a grid: the mean distance of a view to its nearest neighbour, for either axis. Raises
        InputError for a grid with one view along the axis.
        """
        check_choice("axis", axis, *get_args(Axis))
        if not self.is_grid:
            positions = self.positions_mm[..., :2].reshape(-1, 2)
            distances = np.linalg.norm(positions[:, None] - positions, axis=-1)
            np.fill_diagonal(distances, np.inf)
            return float(distances.min(axis=1).mean())
        ends = self.positions_mm[:, [0, -1], 0] if axis == "s" else self.positions_mm[[0, -1], :, 1].T
        count = self.cols if axis == "s" else self.rows
        if count < 2:
            raise InputError(f"only one view along {axis}, expected at least two")
        return float((ends[:, 1] - ends[:, 0]).mean() / (count - 1))

    def slope_from_depth(self, depth_mm: FloatArray | float) -> FloatArray:
        """Return the metric slope (...): shift of a point in px per mm of view position, du/dx_i = f (1 / Z0 - 1 / Z).

        It is the slope of the point-plane correspondence, zero on the reference plane; exact if z_i is zero.
        """
        distance = np.asarray(depth_mm, dtype=np.float64) - self.reference_view_depth_mm
        return np.asarray(self.focal_px * (1.0 / self.reference_distance_mm - 1.0 / distance))

    def depth_mm_from_slope(self, slope_px_per_mm: FloatArray | float) -> FloatArray:
        """Return the depth (...), mm, of a metric slope; infinite at the slope of infinity, NaN beyond it."""
        slope = np.asarray(slope_px_per_mm, dtype=np.float64)
        inverse = 1.0 / self.reference_distance_mm - slope / self.focal_px
        distance = np.divide(1.0, inverse, out=np.full_like(inverse, np.nan), where=inverse > 0)
        return np.where(inverse == 0, np.inf, distance + self.reference_view_depth_mm)

    def disparity_px_from_depth(self, depth_mm: FloatArray | float, axis: Axis = "s") -> FloatArray:
        """Return -du/ds (...) in px per mean view step along `axis`; positive in front of the reference plane."""
        return -self.step_mm(axis) * self.slope_from_depth(depth_mm)

    def depth_mm_from_disparity(self, disparity_px: FloatArray | float, axis: Axis = "s") -> FloatArray:
        """Return the depth (...), mm, of a disparity per mean view step along `axis`; NaN beyond infinity."""
        return self.depth_mm_from_slope(-np.asarray(disparity_px, dtype=np.float64) / self.step_mm(axis))

    def on_regular_grid(self) -> Views:
        """Return the views moved to the nearest even grid through the reference view, with all z_i zero.

        The steps along s and t are fitted by least squares. Pixels still show the same points of the reference plane.
        Raises InputError if the views do not form a grid.
        """
        self.require_grid("an even grid")
        row, col = np.argwhere((self.positions_mm == 0).all(axis=2))[0]
        positions = np.zeros_like(self.positions_mm)
        for axis, indices in ((0, np.arange(self.cols) - col), (1, (np.arange(self.rows) - row)[:, None])):
            index = np.broadcast_to(indices, (self.rows, self.cols))
            step_mm = (index * self.positions_mm[..., axis]).sum() / max(1, np.square(index).sum())
            positions[..., axis] = index * step_mm
        geometry = {field.name: getattr(self, field.name) for field in fields(Views)}
        return Views(**(geometry | {"positions_mm": positions}))


@dataclass(frozen=True, eq=False, kw_only=True)
class LightField(Views):
    """Samples of parallel views: axes t down, s right, image rows, image columns, colour.

    The attributes and methods of `Views` give the geometry.

    Attributes
    ----------
    samples : ndarray
        (t, s, v, u, c), uint8 or float32 (0 to 1), RGB or grey; zero where `weights` is zero.
    weights : ndarray of float32
        (t, s, v, u), 0 for no sample, 1 for full weight.
    """

    samples: Samples
    weights: NDArray[np.float32]

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("samples", "weights"):
            check_type(name, getattr(self, name), np.ndarray)
        expected = (self.rows, self.cols, self.height_px, self.width_px)
        if self.samples.shape not in {(*expected, 1), (*expected, 3)}:
            raise InputError(f"samples have shape {self.samples.shape}, expected {(*expected, 3)} or {(*expected, 1)}")
        if self.samples.dtype not in (np.uint8, np.float32):
            raise InputError(f"samples are {self.samples.dtype}, expected uint8 or float32")
        if self.weights.shape != expected or self.weights.dtype != np.float32:
            raise InputError(
                f"weights are {self.weights.dtype} of shape {self.weights.shape}, expected float32 {expected}"
            )
        # The sum of finite samples is finite, unless they are huge: it is the faster test.
        if (
            self.samples.dtype == np.float32
            and not np.isfinite(self.samples.sum())
            and not np.isfinite(self.samples).all()
        ):
            raise InputError("samples hold a value that is NaN or infinite, expected finite numbers")
        for name in ("samples", "weights"):
            # Read-only arrays are kept: light fields of a video that share their weights compare as equal at once.
            if getattr(self, name).flags.writeable:
                read_only = getattr(self, name).view()
                read_only.flags.writeable = False
                object.__setattr__(self, name, read_only)

    @classmethod
    def of(cls, views: Views, samples: Samples, weights: NDArray[np.float32]) -> Self:
        """Return the light field of samples (t, s, v, u, c) and weights (t, s, v, u) at these views."""
        geometry: dict[str, Any] = {field.name: getattr(views, field.name) for field in fields(Views)}
        return cls(**geometry, samples=samples, weights=weights)

    @classmethod
    def from_views(
        cls,
        images: NDArray[Any] | Sequence[ArrayLike],
        *,
        focal_px: ArrayLike,
        step_mm: float | None = None,
        positions_mm: ArrayLike | None = None,
        poses: ArrayLike | None = None,
        centre_px: ArrayLike | None = None,
        distortion: ArrayLike = (0.0,) * 5,
        reference_depth_mm: float | None = None,
        weights: NDArray[Any] | Sequence[ArrayLike] | None = None,
    ) -> Self:
        """Return the light field of pictures, with one of `step_mm`, `positions_mm` and `poses`.

        Parameters
        ----------
        images
            Pictures (t, s, h, w[, c]) row by row from the top left, or (n, h, w[, c]) or a sequence of n pictures: a
            row, or views at any positions. Grey or RGB, uint8, uint16 or floats from 0 to 1. With poses, sizes may
            differ.
        focal_px
            Focal length; with poses, also one per picture (n,).
        step_mm
            Distance between adjacent views. The reference view, which has the depth, is the central one, of a pair the
            left one.
        positions_mm
            Positions (t, s, 2 or 3) or (n, 2 or 3) of the views: x right, y down, z forward.
        poses
            world_from_camera (n, 4, 4) or (t, s, 4, 4), mm, in OpenCV's axes (x right, y down, z forward). Pictures of
            cameras that are not parallel or not alike are rectified, and a warning says what is lost.
        centre_px
            Principal point (2,), or with poses (n, 2); the middle of the pictures by default.
        distortion
            With poses, OpenCV's coefficients (k1, k2, p1, p2, k3), also one row per picture.
        reference_depth_mm
            Distance of the plane of zero disparity from the central view. By default infinity; with poses, where the
            optical axes come closest.
        weights
            Weights of the pixels, in the shape of the pictures without colour; 1 by default.

        Raises
        ------
        InputError
            In one line, for arrays that do not fit each other, and for cameras that share no field of view.
        """
        geometry = {"step_mm": step_mm, "positions_mm": positions_mm, "poses": poses}
        given = [name for name, value in geometry.items() if value is not None]
        if len(given) != 1:
            raise InputError(f"{', '.join(given) or 'no geometry'} given, expected one of step_mm, positions_mm, poses")
        pictures, grid = pictures_of(images)
        if poses is not None:
            result = rectified_pictures(pictures, weights, poses, focal_px, centre_px, distortion, reference_depth_mm)
            if result.note is not None:
                warnings.warn(result.note, stacklevel=2)
            return cls(**result.geometry, samples=result.samples, weights=result.weights)
        if len({picture.shape for picture in pictures}) > 1:
            raise InputError("images differ in size, expected equal ones, or poses of their cameras")
        height, width = pictures[0].shape[:2]
        positions, order = positions_of(grid, step_mm, positions_mm, len(pictures))
        views = Views.parallel(
            positions,
            (width, height),
            float(numbers_in("focal_px", focal_px, ())),
            np.inf if reference_depth_mm is None else reference_depth_mm,
            None if centre_px is None else numbers_in("centre_px", centre_px, (2,)),
        )
        full = np.ones((height, width), np.float32)
        opacity = np.stack([full if weight is None else weight for weight in weights_of(weights, pictures)])[order]
        samples: Any = np.stack(pictures)[order]
        return cls.of(views, np.where(opacity[..., None] > 0, samples, 0).astype(samples.dtype), opacity)

    def __array__(self, dtype: DTypeLike | None = None, copy: bool | None = None) -> NDArray[Any]:
        """The samples (t, s, v, u, c), for NumPy's functions."""
        return np.array(self.samples, dtype=dtype, copy=copy)

    @property
    def valid(self) -> NDArray[np.bool_]:
        """Mask (t, s, v, u) of the samples with positive weight."""
        return self.weights > 0
