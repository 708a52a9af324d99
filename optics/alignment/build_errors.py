"""Build errors that move the edges of sub-images: in the camera's pose and lens, and in mirrors' poses and outlines."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.layout import Layout

IntArray = NDArray[np.int64]

CAMERA_ERRORS = 11
"""Number of camera errors: shift (3), rotation (3), focal length (1), principal point (2), first lens terms (2)."""
RIGID_ERRORS = 6
"""Number of a mirror's rigid-body errors, in its own frame: rotations about x, y and normal (3), shifts (3)."""
STEP = 1e-3
"""Step of finite differences, in standard deviations."""
EDGE_STEP = 1e-3
"""Step along an edge, as a fraction of its length, that gives its tangent."""


@dataclass(frozen=True)
class BuildErrors:
    """Prior standard deviations of build errors.

    Attributes
    ----------
    tilt_deg, twist_deg
        Rotations of a mirror about each axis of its plane, and about its normal.
    lift_mm, slide_mm
        Shifts of a mirror along its normal, and along each axis of its plane.
    cut_mm
        Shift of each cut edge.
    camera_mm, camera_deg
        Shifts of the camera along each axis, and its rotations about each axis.
    focal_percent, centre_px
        Focal length and principal point.
    lens
        First two terms of the distortion.
    """

    tilt_deg: float = 0.5
    twist_deg: float = 0.3
    lift_mm: float = 0.3
    slide_mm: float = 0.2
    cut_mm: float = 0.1
    camera_mm: float = 0.5
    camera_deg: float = 0.5
    focal_percent: float = 1.0
    centre_px: float = 8.0
    lens: tuple[float, float] = (0.06, 0.12)

    @classmethod
    def of(cls, layout: Layout) -> Self:
        """Errors for a layout: after a calibration, the lens is known, but poses may have changed since."""
        if layout.kind == "calibrated":
            return cls(focal_percent=0.1, centre_px=1.0, lens=(0.005, 0.01))
        return cls()

    @property
    def camera(self) -> FloatArray:
        """Standard deviations (CAMERA_ERRORS,) in mm, rad, fractions and px."""
        pose = [self.camera_mm] * 3 + [np.deg2rad(self.camera_deg)] * 3
        return np.array([*pose, self.focal_percent / 100.0, self.centre_px, self.centre_px, *self.lens])

    @property
    def rigid(self) -> FloatArray:
        """Standard deviations (RIGID_ERRORS,) in rad and mm."""
        tilt, twist = np.deg2rad([self.tilt_deg, self.twist_deg])
        return np.array([tilt, tilt, twist, self.slide_mm, self.slide_mm, self.lift_mm])


@dataclass(frozen=True, eq=False)
class EdgePoints:
    """Points on edges: indices (n,) of mirror and edge, and the fraction (n,) of the edge's length."""

    mirror: IntArray
    edge: IntArray
    fraction: FloatArray


class BuiltDevice:
    """A layout with build errors (p,) in units of their standard deviations.

    The camera's errors come first, then each mirror's: its rigid-body errors and the errors of its edges.
    """

    def __init__(self, layout: Layout, errors: BuildErrors) -> None:
        self.layout = layout
        apparent = [mirror.apparent for mirror in layout.mirrors]
        self.edges = [len(mirror.usable_normalized) for mirror in layout.mirrors]
        self._frames = np.array([mirror.rig_from_plane for mirror in apparent])
        self._corners = np.zeros((len(apparent), max(self.edges), 2))
        for k, (mirror, count) in enumerate(zip(apparent, self.edges, strict=True)):
            on_plane = mirror.intersect(layout.mirrors[k].usable_normalized) - self._frames[k, :3, 3]
            self._corners[k, :count] = on_plane @ self._frames[k, :3, :2]
        mirrors = [np.concatenate([errors.rigid, np.full(count, errors.cut_mm)]) for count in self.edges]
        self.sigma = np.concatenate([errors.camera, *mirrors])
        self.starts = CAMERA_ERRORS + np.cumsum([0, *(RIGID_ERRORS + count for count in self.edges)])

    @property
    def count(self) -> int:
        """Number of errors."""
        return len(self.sigma)

    def tilts(self, mirror: int) -> slice:
        """Indices of a mirror's two tilts among the errors."""
        return slice(int(self.starts[mirror]), int(self.starts[mirror]) + 2)

    @cached_property
    def _error_groups(self) -> list[IntArray]:
        """Groups of errors with disjoint effects, one per mirror, for which one finite difference suffices."""
        starts, ends = self.starts[:-1], self.starts[1:]
        return [(starts + k)[starts + k < ends] for k in range(RIGID_ERRORS + max(self.edges))]

    def pixels(self, points: EdgePoints, errors: FloatArray) -> FloatArray:
        """Pixels (n, 2) of points on edges, with errors (p,)."""
        scaled = errors * self.sigma
        in_camera = (self._in_holder(points, scaled) - scaled[:3]) @ Rotation.from_rotvec(scaled[3:6]).as_matrix()
        return _with_lens(self.layout.camera, scaled[6:CAMERA_ERRORS]).project(in_camera)

    def depths_mm(self, points: EdgePoints) -> FloatArray:
        """Depths (n,) of points on edges along the camera's axis, without errors."""
        return self._in_holder(points, np.zeros(self.count))[:, 2]

    def pixels_with_jacobian(self, points: EdgePoints, errors: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Pixels (n, 2) of points, and d pixels / d errors (n, 2, p) by forward differences."""
        pixels = self.pixels(points, errors)
        jacobian = np.zeros((len(pixels), 2, self.count))
        for k in range(CAMERA_ERRORS):
            jacobian[:, :, k] = (self.pixels(points, _stepped(errors, np.array([k]))) - pixels) / STEP
        owner = np.searchsorted(self.starts, np.arange(self.count), side="right") - 1
        for group in self._error_groups:
            change = (self.pixels(points, _stepped(errors, group)) - pixels) / STEP
            for k in group:
                rows = points.mirror == owner[k]
                jacobian[rows, :, k] = change[rows]
        return pixels, jacobian

    def crossings_px(
        self, points: EdgePoints, errors: FloatArray, start_px: FloatArray, direction: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Distances (n,) along unit vectors (n, 2) from pixels (n, 2) to the edges, with derivatives (n, p) and slopes.

        Slopes (n,) are tangents of the angles between the edges and the normals of the unit vectors.
        An edge that moves along itself and also turns is crossed elsewhere than at the point's new position.
        """
        count = len(start_px)
        later = points.fraction + EDGE_STEP
        both = EdgePoints(np.tile(points.mirror, 2), np.tile(points.edge, 2), np.concatenate([points.fraction, later]))
        pixels, jacobian = self.pixels_with_jacobian(both, errors)
        tangent, d_tangent = pixels[count:] - pixels[:count], jacobian[count:] - jacobian[:count]
        across = _cross(direction, tangent)
        distance = _cross(pixels[:count] - start_px, tangent) / across
        from_crossing = pixels[:count] - start_px - distance[:, None] * direction
        derivative = _cross(jacobian[:count], tangent[..., None]) + _cross(from_crossing[..., None], d_tangent)
        return distance, derivative / across[:, None], (direction * tangent).sum(axis=1) / across

    def _in_holder(self, points: EdgePoints, scaled: FloatArray) -> FloatArray:
        """Points (n, 3) on edges in the nominal rig frame, mm, with errors (p,) in mm, rad, fractions and px."""
        mirror, edge = points.mirror, points.edge
        following = (edge + 1) % np.array(self.edges)[mirror]
        start, end = self._corners[mirror, edge], self._corners[mirror, following]
        direction = end - start
        length = np.linalg.norm(direction, axis=1, keepdims=True)
        outward = np.column_stack([direction[:, 1], -direction[:, 0]]) / length
        outward *= np.sign((outward * start).sum(axis=1))[:, None]
        rigid = np.array([scaled[first : first + RIGID_ERRORS] for first in self.starts[:-1]])
        in_plane = (
            start
            + points.fraction[:, None] * direction
            + scaled[self.starts[mirror] + RIGID_ERRORS + edge][:, None] * outward
        )
        in_mirror = np.column_stack([in_plane, np.zeros(len(in_plane))])
        rotations = Rotation.from_rotvec(rigid[:, :3]).as_matrix()
        displaced = np.einsum("nij,nj->ni", rotations[mirror], in_mirror) + rigid[mirror, 3:]
        frames = self._frames[mirror]
        return np.asarray(np.einsum("nij,nj->ni", frames[:, :3, :3], displaced) + frames[:, :3, 3])


def _cross(first: FloatArray, second: FloatArray) -> FloatArray:
    """Cross products of vectors (n, 2, ...)."""
    return np.asarray(first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0])


def _stepped(errors: FloatArray, indices: IntArray) -> FloatArray:
    stepped = errors.copy()
    stepped[indices] += STEP
    return stepped


def _with_lens(camera: Camera, change: FloatArray) -> Camera:
    """A camera with changed focal length (relative), principal point (px) and first terms of distortion."""
    intrinsics = camera.intrinsics.copy()
    intrinsics[:2] *= 1.0 + change[0]
    intrinsics[2:4] += change[1:3]
    intrinsics[4:6] += change[3 : 3 + len(intrinsics[4:6])]
    return camera.with_intrinsics(intrinsics)
