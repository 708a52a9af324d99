"""Measurement of each mirror's tilt from its design, by edges of sub-images or by points matched between views.

It needs only frames of any scene and the nominal layout. There are two sources:

- edges: the borders of each mirror's sub-image. Edges lie on the mirror and hardly move when it rotates: a tilt of 0.4
  degrees lifts an edge 10 mm from the centre by 0.07 mm, about a pixel. A mirror that is cut 0.1 mm too large or
  shifted by 0.2 mm moves its edges as much. The Cramer-Rao bound for the default device is 0.15 to 0.3 degrees, however
  sharp the edges are, and outer mirrors with two edges on the sensor determine at most one of two axes. Edges do show
  the pose of the camera and misplaced mirrors.
- scene: the image in a mirror rotates by twice the mirror's rotation. Points matched between views of a textured scene
  determine turns to hundredths of a degree.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.alignment.build_errors import CAMERA_ERRORS, BuildErrors, BuiltDevice
from mirrorcam.optics.alignment.edge_profiles import Stations, edge_residuals, edge_stations, profiles
from mirrorcam.optics.drift.drift import MIN_POINTS, deflated, explained_matches
from mirrorcam.optics.drift.matched_points import MatchedPoints, PointMatcher
from mirrorcam.optics.drift.mirror_motions import (
    COMMON_DEG,
    COMMON_MM,
    all_centre_rows,
    centre_rows,
    common_covariance,
    common_motions,
    covariance_of_centres,
    motion_covariance,
    rotation_jacobian,
)
from mirrorcam.optics.drift.scene_fit import SceneFit, parameter_names
from mirrorcam.optics.geometry.layout import Layout

Source = Literal["edges", "scene"]
DETERMINED = 0.7
"""A tilt is determined if the measurement reduces its standard deviation to less than this fraction of the prior's."""
SMOOTH_PX = (20.0, 10.0, 4.0, 0.0)
"""Smoothing of the picture in successive fits, to find edges far from their design positions."""
ROUNDS = 6
MAX_CHI_SQUARED = 2.0
"""Reduced chi squared of a station above which its weight is reduced."""
MAX_STEP_PX = 8.0
SEARCH_RANGE_PX, SEARCH_STEP_PX = 40.0, 4.0
"""Range and step of the search for a common shift of all edges."""
MAX_SIGMA_PX = 3.0
"""Maximum standard deviation, to be reported, of an edge's position from a single station."""
DECENTRING_SIGMA = 1e-3
"""Standard deviation of the decentring terms of a lens."""


@dataclass(frozen=True)
class MirrorTilt:
    """The measured tilt of one mirror.

    Attributes
    ----------
    index
        Index of the mirror.
    right_deg, down_deg
        Angles between the mirror and its design about the axes of its plane, positive if its view rotates right and
        down, by about twice these angles. NaN if the pictures do not determine them.
    sigma_deg
        Standard deviations of both.
    estimate_deg
        Most likely tilts, right and down; near 0 if the pictures hardly determine them.
    """

    index: int
    right_deg: float
    down_deg: float
    sigma_deg: tuple[float, float]
    estimate_deg: tuple[float, float] = (0.0, 0.0)

    @property
    def determined(self) -> bool:
        """Whether any tilt is determined."""
        return bool(np.isfinite(self.right_deg) or np.isfinite(self.down_deg))

    @property
    def words(self) -> str:
        """The tilt in words: "0.40° left, 0.20° up", without tilts below their standard deviation."""
        parts = []
        for value, sigma, names in zip(
            (self.right_deg, self.down_deg), self.sigma_deg, (("left", "right"), ("up", "down")), strict=True
        ):
            if np.isfinite(value) and abs(value) >= sigma:
                parts.append(f"{abs(value):.2f}° {names[value > 0]}")
        return ", ".join(parts) or ("straight" if self.determined else "cannot tell")


@dataclass(frozen=True, eq=False)
class Alignment:
    """The errors of a device measured with one source.

    Attributes
    ----------
    source
        Source of the measurement.
    mirrors
        Tilt of each mirror.
    camera_shift_mm, camera_shift_sigma_mm
        Shift (3,) of the pupil in the holder, in the rig frame, and its standard deviations.
    camera_rotation_deg, camera_rotation_sigma_deg
        Rotation vector (3,) of the camera in the holder, in the rig frame, and its standard deviations.
    edges
        The fit to edges; None for the source "scene".
    points
        Number of points of the scene; 0 for the source "edges".
    """

    source: Source
    mirrors: tuple[MirrorTilt, ...]
    camera_shift_mm: FloatArray
    camera_shift_sigma_mm: FloatArray
    camera_rotation_deg: FloatArray
    camera_rotation_sigma_deg: FloatArray
    edges: EdgeFit | None = None
    points: int = 0


def view_rotation_signs(layout: Layout, index: int) -> FloatArray:
    """Signs (2,): whether a view rotates right for a positive tilt about the mirror's y, and down for one about x."""
    mirror = layout.mirrors[index].apparent
    frame, normal = mirror.rig_from_plane, mirror.normal_in_rig
    ray = frame[:3, 3] / np.linalg.norm(frame[:3, 3])
    signs = np.ones(2)
    for k, (axis, direction) in enumerate(((1, 0), (0, 1))):
        change = np.cross(frame[:3, axis], normal)
        rotated = -2.0 * ((change @ ray) * normal + (normal @ ray) * change)
        signs[k] = 1.0 if (layout.view_from_rig @ rotated)[direction] >= 0.0 else -1.0
    return signs


def mirror_tilt(layout: Layout, index: int, tilts: FloatArray, covariance: FloatArray, prior_deg: float) -> MirrorTilt:
    """The tilt of a mirror from its rotations (2,) about its own x and y, rad, and their covariance (2, 2).

    `prior_deg` is the standard deviation before the measurement.
    """
    right, down = view_rotation_signs(layout, index)
    sigma = np.degrees(np.sqrt(np.maximum(np.diag(covariance), 0.0)))[::-1]
    value = np.degrees(np.array([right * tilts[1], down * tilts[0]]))
    determined = np.where(sigma < DETERMINED * prior_deg, value, np.nan)
    deviation, estimate = (float(sigma[0]), float(sigma[1])), (float(value[0]), float(value[1]))
    return MirrorTilt(index, float(determined[0]), float(determined[1]), deviation, estimate)


def mean_grey(frames: Sequence[NDArray[np.uint8]], layout: Layout) -> NDArray[np.float32]:
    """The mean (h, w) of frames (h, w, 3) in RGB or (h, w), grey levels.

    Raises InputError without frames, and for frames whose size differs from the layout's camera.
    """
    if not frames:
        raise InputError("no frame is given, expected one or more")
    expected = (layout.camera.height_px, layout.camera.width_px)
    total = np.zeros(expected, np.float32)
    for frame in frames:
        if frame.shape[:2] != expected:
            size = f"{frame.shape[1]}x{frame.shape[0]}"
            raise InputError(f"frame is {size} px, expected {expected[1]}x{expected[0]} of the layout's camera")
        total += frame if frame.ndim == 2 else cv2.cvtColor(frame, cv2.COLOR_RGB2GRAY)
    return total / np.float32(len(frames))


class EdgeAligner:
    """Measures the tilts of a layout's mirrors by the edges of sub-images; reuse it for all frames.

    Parameters
    ----------
    layout
        The nominal layout.
    errors
        Expected build errors; by default of a device made by hand.
    """

    def __init__(self, layout: Layout, errors: BuildErrors | None = None) -> None:
        self.layout, self.errors = layout, BuildErrors.of(layout) if errors is None else errors
        self._fitter = EdgeFitter(BuiltDevice(layout, self.errors))

    def align(self, frames: Sequence[NDArray[np.uint8]], previous: Alignment | None = None) -> Alignment:
        """The alignment measured in the mean of frames (h, w, 3) or (h, w).

        A white sheet in front of the mirrors is best; otherwise, the scene should change between frames. `previous` is
        an alignment of the same device; starting there is ten times faster.

        Raises InputError without frames, and for frames whose size differs from the layout's camera.
        """
        start = None if previous is None or previous.edges is None else previous.edges.errors
        fit = self._fitter.fit(mean_grey(frames, self.layout), start)
        device, sigma = fit.device, fit.device.sigma
        covariance = fit.covariance * sigma[:, None] * sigma
        scaled, deviation = fit.errors * sigma, np.sqrt(np.diag(covariance))
        mirrors = []
        for k in range(len(self.layout.mirrors)):
            rows = device.tilts(k)
            mirrors.append(mirror_tilt(self.layout, k, scaled[rows], covariance[rows, rows], self.errors.tilt_deg))
        return Alignment(
            "edges",
            tuple(mirrors),
            scaled[:3],
            deviation[:3],
            np.degrees(scaled[3:6]),
            np.degrees(deviation[3:6]),
            edges=fit,
        )


@dataclass(frozen=True, eq=False)
class EdgeFit:
    """The build errors of a device fitted to edges.

    Attributes
    ----------
    device, stations
        The device, and the stations on its edges.
    errors, covariance
        Errors (p,) in units of their prior standard deviations, as in `BuiltDevice`, and their covariance (p, p).
    offset_px
        Offsets (n, 2) of the edges at the stations from their design, along `outward`.
    station_offset_px, station_sigma_px
        Offset (n, 2) measured at each station alone, and its standard deviation; NaN if it is not determined.
    cost
        Median reduced chi squared of the stations.
    """

    device: BuiltDevice
    stations: Stations
    errors: FloatArray
    covariance: FloatArray
    offset_px: FloatArray
    station_offset_px: FloatArray
    station_sigma_px: FloatArray
    cost: float

    @property
    def edge_positions(self) -> tuple[FloatArray, FloatArray]:
        """Pixels (n, 2) of edges as designed and as measured, for all stations that locate their edge."""
        designed, measured = [], []
        for edge, out_px in enumerate((np.zeros_like(self.stations.gap_px), self.stations.gap_px)):
            valid = np.isfinite(self.station_offset_px[:, edge])
            position = self.stations.position_px + out_px[:, None] * self.stations.outward
            designed.append(position[valid])
            measured.append((position + self.station_offset_px[:, edge, None] * self.stations.outward)[valid])
        return np.concatenate(designed), np.concatenate(measured)


class EdgeFitter:
    """Fits the build errors of a layout to pictures; reuse it for all pictures."""

    def __init__(self, device: BuiltDevice) -> None:
        self.device = device
        self.stations = edge_stations(device)

    def fit(self, picture: NDArray[np.float32], start: FloatArray | None = None) -> EdgeFit:
        """Fit to a picture (h, w) in grey levels, smoothed less and less.

        `start` are errors (p,) from an earlier fit; then only the sharp picture is used.
        """
        errors = self._best_shift(picture) if start is None else start
        for smooth in SMOOTH_PX if start is None else SMOOTH_PX[-1:]:
            for _ in range(ROUNDS):
                step = self._step(picture, errors, smooth)
                errors = errors + step
                if np.abs(step).max() < 3e-3:
                    break
        return self._result(picture, errors)

    def _best_shift(self, image: NDArray[np.float32]) -> FloatArray:
        """Errors (p,) of the camera's pose that shift all edges together to the darkest positions."""
        stations = self.stations
        smoothed: Any = cv2.GaussianBlur(image, (0, 0), SEARCH_STEP_PX)
        gap = np.where(stations.has_neighbour, stations.gap_px / 2.0, stations.blur_px[:, 0])
        inner, outer = -2.0 * stations.blur_px[:, 0] - 12.0, stations.gap_px + 2.0 * stations.blur_px[:, 1] + 12.0
        lowest, best = np.inf, np.zeros(2)
        for right in np.arange(-SEARCH_RANGE_PX, SEARCH_RANGE_PX + 1.0, SEARCH_STEP_PX):
            for down in np.arange(-SEARCH_RANGE_PX, SEARCH_RANGE_PX + 1.0, SEARCH_STEP_PX):
                shift = np.array([right, down])
                dark, inside, outside = (self._light_at(smoothed, out_px, shift) for out_px in (gap, inner, outer))
                bright = np.where(stations.has_neighbour, np.minimum(inside, outside), inside)
                cost = float(np.nanmean(dark / (bright + 4.0))) + 0.1 * (right**2 + down**2) / SEARCH_RANGE_PX**2
                if cost < lowest:
                    lowest, best = cost, shift
        _, jacobian, _ = self._offsets(np.zeros(self.device.count))
        d_pose, offset = jacobian[:, 0, :CAMERA_ERRORS], stations.outward @ best
        errors = np.zeros(self.device.count)
        errors[:CAMERA_ERRORS] = np.linalg.solve(d_pose.T @ d_pose + 0.1 * np.eye(CAMERA_ERRORS), d_pose.T @ offset)
        return errors

    def _light_at(self, image: Any, out_px: FloatArray, shift_px: FloatArray) -> FloatArray:
        """Light (n,) at distances along `outward` from the shifted stations; NaN outside the picture."""
        pixels = np.rint(self.stations.position_px + out_px[:, None] * self.stations.outward + shift_px).astype(
            np.int64
        )
        height, width = image.shape
        inside = ((pixels >= 0) & (pixels < [width, height])).all(axis=1)
        pixels = np.clip(pixels, 0, [width - 1, height - 1])
        return np.where(inside, image[pixels[:, 1], pixels[:, 0]], np.nan)

    def _offsets(self, errors: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Offsets (n, 2) of both edges along `outward`, their derivatives (n, 2, p) by errors, and slopes (n, 2)."""
        stations, offsets, jacobians, slopes = self.stations, [], [], []
        for points, designed in ((stations.edge, 0.0), (stations.neighbour_edge, stations.gap_px)):
            offset, jacobian, slope = self.device.crossings_px(points, errors, stations.position_px, stations.outward)
            offsets.append(offset - designed)
            jacobians.append(jacobian)
            slopes.append(slope)
        offset, slope = np.stack(offsets, axis=1), np.stack(slopes, axis=1)
        return np.nan_to_num(offset), np.nan_to_num(np.stack(jacobians, axis=1)), np.nan_to_num(slope)

    def _linearized(self, image: NDArray[np.float32], errors: FloatArray, smooth: float) -> tuple[FloatArray, ...]:
        """Offsets with derivatives, and each station's information (n, 2, 2), score (n, 2) and reduced chi squared."""
        offset, jacobian, slope = self._offsets(errors)
        gap_px = self.stations.gap_px + offset[:, 1] - offset[:, 0]
        measured = profiles(image, self.stations, offset, smooth)
        residual, d_offset = edge_residuals(measured, self.stations, offset, slope, smooth)
        count = np.maximum(measured.weight.sum(axis=1) - 3.0, 1.0)
        chi_squared = (residual**2).sum(axis=1) / count
        # Reduce the weight of stations that the model does not explain.
        weight = 1.0 / np.maximum(chi_squared, 1.0) / (1.0 + np.maximum(chi_squared - MAX_CHI_SQUARED, 0.0))
        # Where sub-images overlap, a mirror hides its neighbour's edge; fits to smoothed pictures must part them first.
        if smooth == 0.0:
            weight = np.where(self.stations.has_neighbour & (gap_px < 0.0), 0.0, weight)
        information = d_offset @ np.swapaxes(d_offset, 1, 2) * weight[:, None, None]
        score = (d_offset @ residual[..., None])[..., 0] * weight[:, None]
        return offset, jacobian, information, score, chi_squared

    def _step(self, image: NDArray[np.float32], errors: FloatArray, smooth: float) -> FloatArray:
        _, jacobian, information, score, _ = self._linearized(image, errors, smooth)
        hessian = np.einsum("nap,nab,nbq->pq", jacobian, information, jacobian, optimize=True) + np.eye(len(errors))
        gradient = np.einsum("nap,na->p", jacobian, score) - errors
        step = np.linalg.solve(hessian, gradient)
        shift = np.abs(jacobian @ step).max()
        return np.asarray(step * min(1.0, MAX_STEP_PX / max(float(shift), 1e-12)))

    def _result(self, image: NDArray[np.float32], errors: FloatArray) -> EdgeFit:
        offset, jacobian, information, score, chi_squared = self._linearized(image, errors, 0.0)
        total = np.einsum("nap,nab,nbq->pq", jacobian, information, jacobian, optimize=True)
        covariance = np.linalg.inv(total + np.eye(len(errors)))
        # The scatter of the offsets from single stations shows how well the model explains them.
        with np.errstate(divide="ignore", invalid="ignore"):
            diagonal = np.diagonal(information, axis1=1, axis2=2)
            station_offset, sigma = offset + score / diagonal, 1.0 / np.sqrt(diagonal)
        valid = sigma < MAX_SIGMA_PX
        valid[:, 1] &= self.stations.has_neighbour
        return EdgeFit(
            self.device,
            self.stations,
            errors,
            covariance,
            offset,
            np.where(valid, station_offset, np.nan),
            np.where(valid, sigma, np.nan),
            float(np.median(chi_squared)),
        )


class SceneAligner:
    """Measures the tilts of a layout's mirrors by points matched between views; reuse it for all frames.

    Parameters
    ----------
    layout
        The nominal layout, with at least three mirrors.
    errors
        Expected build errors; by default of a device made by hand.

    Raises
    ------
    InputError
        If the views have no common field.
    """

    def __init__(self, layout: Layout, errors: BuildErrors | None = None) -> None:
        self.layout, self.errors = layout, BuildErrors.of(layout) if errors is None else errors
        self._matcher = PointMatcher(layout)
        self._names = parameter_names(layout)

    def align(self, frames: Sequence[NDArray[np.uint8]]) -> Alignment:
        """The alignment measured in frames (h, w, 3) in RGB; nothing is determined if too few points are matched."""
        layout, names, mirrors = self.layout, self._names, self.layout.mirrors
        blocks = {
            k: motion_covariance(mirror, self.errors.tilt_deg, self.errors.lift_mm) for k, mirror in enumerate(mirrors)
        }
        prior = covariance_of_centres(blocks, names) + common_covariance(layout, names) + self._lens_covariance()
        matches = MatchedPoints.joined([self._matcher.match(frame) for frame in frames])
        points = np.bincount(matches.view, minlength=len(mirrors))
        if (points >= MIN_POINTS).sum() < 2:
            return self._undetermined()
        matches = explained_matches(layout, matches, prior)
        points = np.bincount(matches.view, minlength=len(mirrors))
        if (points >= MIN_POINTS).sum() < 2:
            return self._undetermined()
        information, gradient = deflated(SceneFit(layout, matches, prior).solve())
        solution = np.linalg.solve(np.eye(len(prior)) + information @ prior, np.column_stack([gradient, information]))
        score, marginal = solution[:, 0], solution[:, 1:]
        tilts = []
        for k, block in blocks.items():
            rows, plane = centre_rows(names, k), mirrors[k].rig_from_plane[:3, :2]
            d_centre = plane.T @ rotation_jacobian(layout, names, k)[:, rows]
            covariance = d_centre @ (block - block @ marginal[np.ix_(rows, rows)] @ block) @ d_centre.T
            tilts.append(mirror_tilt(layout, k, d_centre @ block @ score[rows], covariance, self.errors.tilt_deg))
        motions, rows = common_motions(layout)[:, :6], all_centre_rows(layout, names)
        sigmas = np.array([COMMON_DEG] * 3 + [COMMON_MM] * 3)
        common = sigmas * (motions.T @ score[rows])
        covariance = np.eye(6) - motions.T @ marginal[np.ix_(rows, rows)] @ motions
        sigma = sigmas * np.sqrt(np.maximum(np.diag(covariance), 0.0))
        # A common rotation of all mirrors is equivalent to the opposite rotation of the camera.
        return Alignment(
            "scene", tuple(tilts), -common[3:], sigma[3:], -common[:3], sigma[:3], points=len(matches.frame)
        )

    def _lens_covariance(self) -> FloatArray:
        """Covariance (g, g) of the camera's intrinsics."""
        names, camera, errors = self._names, self.layout.camera, self.errors
        sigma = dict.fromkeys(camera.intrinsic_names, 0.0)
        sigma |= dict.fromkeys(("fx_px", "fy_px"), errors.focal_percent / 100.0 * camera.fx_px)
        sigma |= dict.fromkeys(("cx_px", "cy_px"), errors.centre_px)
        sigma |= dict(zip(camera.intrinsic_names[4:], (*errors.lens, DECENTRING_SIGMA, DECENTRING_SIGMA), strict=False))
        covariance = np.diag([sigma.get(name, 0.0) ** 2 for name in names])
        # Pixels are square: both focal lengths have the same error.
        fx, fy = names.index("fx_px"), names.index("fy_px")
        covariance[fx, fy] = covariance[fy, fx] = 0.9999 * covariance[fx, fx]
        return covariance

    def _undetermined(self) -> Alignment:
        nan, prior = float("nan"), self.errors.tilt_deg
        mirrors = tuple(MirrorTilt(k, nan, nan, (prior, prior)) for k in range(len(self.layout.mirrors)))
        unknown = np.full(3, np.nan)
        return Alignment("scene", mirrors, unknown, np.full(3, COMMON_MM), unknown, np.full(3, COMMON_DEG))
