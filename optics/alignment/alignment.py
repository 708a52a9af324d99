"""How each mirror is turned from its design, by edges of sub-images and, better, by points that views share.

Only frames of any scene and the nominal layout are needed. There are two sources:

- edges: where each mirror's sub-image ends. Edges lie on the mirror and hardly move when it turns: a tilt of 0.4
  degrees lifts an edge 10 mm from the middle by 0.07 mm, about a pixel, and a mirror that is cut 0.1 mm too large, or
  is shifted by 0.2 mm, moves its edges as much. The Cramer-Rao bound of the default device is 0.15 to 0.3 degrees,
  however sharp the edges are seen, and outer mirrors with two edges on the sensor determine one axis of the two at
  most. Edges do show how the camera sits, and which mirror is far from its place.
- scene: the image in a mirror moves by twice its turn. Points that several views share determine turns to hundredths of
  a degree, where the scene has texture.
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
from mirrorcam.optics.alignment.build_errors import CAMERA, BuildErrors, BuiltDevice
from mirrorcam.optics.alignment.edge_profiles import Stations, edges_light, profiles, stations
from mirrorcam.optics.drift.drift import LEAST_POINTS, deflated, explained_matches
from mirrorcam.optics.drift.matched_points import MatchedPoints, PointMatcher
from mirrorcam.optics.drift.mirror_motions import (
    COMMON_DEG,
    COMMON_MM,
    all_rows,
    common_covariance,
    common_motions,
    mirror_rows,
    own_motion,
    placed,
    turn_of_centre,
)
from mirrorcam.optics.drift.scene_fit import SceneFit, parameter_names
from mirrorcam.optics.geometry.layout import Layout

Source = Literal["edges", "scene"]
DETERMINED = 0.7
"""A tilt is determined where its standard deviation is less than this part of the one before the measurement."""
SMOOTH_PX = (20.0, 10.0, 4.0, 0.0)
"""The picture is smoothed so, to find edges that are far from where they were designed to be."""
ROUNDS = 6
HEAVY = 2.0
"""Stations whose squared residuals are more than that many times as large as their noise count less."""
MOST_STEP_PX = 8.0
FARTHEST_PX, SEARCH_PX = 40.0, 4.0
"""How far all edges together may be from their places, and steps in which that is searched."""
KNOWN_PX = 3.0
"""A station that locates an edge less precisely by itself does not count."""
DECENTRED = 1e-3
"""Standard deviation of the decentring terms of a lens."""


@dataclass(frozen=True)
class MirrorTilt:
    """The tilt of one mirror as pictures show it.

    Attributes
    ----------
    index
        Of the mirror.
    right_deg, down_deg
        Angles by which the mirror is turned from its design, about the axes of its plane: positive where its view turns
        to the right and down, by about twice as much. NaN where the pictures do not determine it.
    sigma_deg
        Standard deviations of both.
    estimate_deg
        The most likely tilts, right and down, also where the pictures hardly determine them: near 0 then.
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
        """The tilt in words: "0.40° left, 0.20° up"; a tilt below its standard deviation is left out."""
        parts = []
        for value, sigma, names in zip(
            (self.right_deg, self.down_deg), self.sigma_deg, (("left", "right"), ("up", "down")), strict=True
        ):
            if np.isfinite(value) and abs(value) >= sigma:
                parts.append(f"{abs(value):.2f}° {names[value > 0]}")
        return ", ".join(parts) or ("straight" if self.determined else "cannot tell")


@dataclass(frozen=True, eq=False)
class Alignment:
    """The errors of a device as pictures show them, by one source.

    Attributes
    ----------
    source
        The source.
    mirrors
        The tilt of each mirror.
    camera_shift_mm, camera_shift_sigma_mm
        How the pupil is shifted (3,) from its place in the holder, in rig.
    camera_turn_deg, camera_turn_sigma_deg
        How the camera is turned (3,) in the holder, a rotation vector in rig.
    edges
        The fit to edges; None of the scene.
    points
        Number of points of the scene; 0 of edges.
    """

    source: Source
    mirrors: tuple[MirrorTilt, ...]
    camera_shift_mm: FloatArray
    camera_shift_sigma_mm: FloatArray
    camera_turn_deg: FloatArray
    camera_turn_sigma_deg: FloatArray
    edges: EdgeFit | None = None
    points: int = 0


def view_turns(layout: Layout, index: int) -> FloatArray:
    """Signs (2,): of a view's turn to the right by a tilt about the mirror's own y, and of one down by one about x."""
    mirror = layout.mirrors[index].apparent
    frame, normal = mirror.rig_from_plane, mirror.normal_in_rig
    ray = frame[:3, 3] / np.linalg.norm(frame[:3, 3])
    signs = np.ones(2)
    for place, (axis, which) in enumerate(((1, 0), (0, 1))):
        change = np.cross(frame[:3, axis], normal)
        turned = -2.0 * ((change @ ray) * normal + (normal @ ray) * change)
        signs[place] = 1.0 if (layout.view_from_rig @ turned)[which] >= 0.0 else -1.0
    return signs


def mirror_tilt(layout: Layout, index: int, tilts: FloatArray, covariance: FloatArray, before_deg: float) -> MirrorTilt:
    """The tilt of a mirror by its turns (2,) about its own x and y, rad, with their covariance (2, 2).

    `before_deg` is the standard deviation that was known before.
    """
    right, down = view_turns(layout, index)
    sigma = np.degrees(np.sqrt(np.maximum(np.diag(covariance), 0.0)))[::-1]
    value = np.degrees(np.array([right * tilts[1], down * tilts[0]]))
    known = np.where(sigma < DETERMINED * before_deg, value, np.nan)
    deviation, estimate = (float(sigma[0]), float(sigma[1])), (float(value[0]), float(value[1]))
    return MirrorTilt(index, float(known[0]), float(known[1]), deviation, estimate)


def grey_light(frames: Sequence[NDArray[np.uint8]], layout: Layout) -> NDArray[np.float32]:
    """The mean (h, w) of frames (h, w, 3) in RGB or (h, w), grey levels.

    Raises InputError where there is none, or one of another size than the layout's camera's.
    """
    if not frames:
        raise InputError("no frame is given, expected one or more")
    expected = (layout.camera.height_px, layout.camera.width_px)
    total = np.zeros(expected, np.float32)
    for frame in frames:
        if frame.shape[:2] != expected:
            given = f"{frame.shape[1]}x{frame.shape[0]}"
            raise InputError(f"frame is {given} px, expected {expected[1]}x{expected[0]} of the layout's camera")
        total += frame if frame.ndim == 2 else cv2.cvtColor(frame, cv2.COLOR_RGB2GRAY)
    return total / np.float32(len(frames))


class EdgeAligner:
    """Measures by the edges of sub-images how the mirrors of one layout are turned; keep one for all frames.

    Parameters
    ----------
    layout
        The nominal layout.
    errors
        What errors of building are expected; by default those of a device made by hand.
    """

    def __init__(self, layout: Layout, errors: BuildErrors | None = None) -> None:
        self.layout, self.errors = layout, BuildErrors.of(layout) if errors is None else errors
        self._fitter = EdgeFitter(BuiltDevice(layout, self.errors))

    def align(self, frames: Sequence[NDArray[np.uint8]], near: Alignment | None = None) -> Alignment:
        """The alignment by the mean of frames (h, w, 3) or (h, w); the more the scene changes between them, the better.

        A white sheet before the mirrors is best. With `near`, an earlier alignment of the same device, the search
        starts there, ten times as fast.

        Raises InputError for no frames, or of another size than the layout's camera's.
        """
        start = None if near is None or near.edges is None else near.edges.errors
        fit = self._fitter.fit(grey_light(frames, self.layout), start)
        device, sigma = fit.device, fit.device.sigma
        covariance = fit.covariance * sigma[:, None] * sigma
        sized, deviation = fit.errors * sigma, np.sqrt(np.diag(covariance))
        mirrors = []
        for k in range(len(self.layout.mirrors)):
            at = device.tilts(k)
            mirrors.append(mirror_tilt(self.layout, k, sized[at], covariance[at, at], self.errors.tilt_deg))
        return Alignment(
            "edges",
            tuple(mirrors),
            sized[:3],
            deviation[:3],
            np.degrees(sized[3:6]),
            np.degrees(deviation[3:6]),
            edges=fit,
        )


@dataclass(frozen=True, eq=False)
class EdgeFit:
    """The errors of a device as edges show them.

    Attributes
    ----------
    device, seen
        The device and the stations.
    errors, covariance
        The errors (p,) of `BuiltDevice`, and their covariance (p, p).
    offset_px
        Offsets (n, 2) of the edges at the stations from where they were designed, along `out`.
    own_px, own_sigma_px
        The offset (n, 2) by each station alone, and its standard deviation; NaN where it is not determined.
    cost
        Mean absolute light, grey levels, that is left.
    """

    device: BuiltDevice
    seen: Stations
    errors: FloatArray
    covariance: FloatArray
    offset_px: FloatArray
    own_px: FloatArray
    own_sigma_px: FloatArray
    cost: float

    @property
    def seen_points(self) -> tuple[FloatArray, FloatArray]:
        """Points (n, 2) of edges as designed, and where they are seen, of all stations that locate their edge, px."""
        designed, seen = [], []
        for edge, apart in enumerate((np.zeros_like(self.seen.apart_px), self.seen.apart_px)):
            known = np.isfinite(self.own_px[:, edge])
            at = self.seen.place + apart[:, None] * self.seen.out
            designed.append(at[known])
            seen.append((at + self.own_px[:, edge, None] * self.seen.out)[known])
        return np.concatenate(designed), np.concatenate(seen)


class EdgeFitter:
    """Fits the errors of building of one layout to pictures; keep one for all pictures."""

    def __init__(self, device: BuiltDevice) -> None:
        self.device = device
        self.seen = stations(device)

    def fit(self, picture: NDArray[np.float32], start: FloatArray | None = None) -> EdgeFit:
        """Fit to a picture (h, w) of light, from the smoothest picture to the sharpest.

        With `start`, errors (p,) that were found before, only the sharpest.
        """
        errors = self._started(picture) if start is None else start
        for smooth in SMOOTH_PX if start is None else SMOOTH_PX[-1:]:
            for _ in range(ROUNDS):
                step = self._step(picture, errors, smooth)
                errors = errors + step
                if np.abs(step).max() < 3e-3:
                    break
        return self._result(picture, errors)

    def _started(self, image: NDArray[np.float32]) -> FloatArray:
        """Errors (p,) of the camera's seat that move all edges together to where it is darkest."""
        seen = self.seen
        smoothed: Any = cv2.GaussianBlur(image, (0, 0), SEARCH_PX)
        middle = np.where(seen.paired, seen.apart_px / 2.0, seen.blur_px[:, 0])
        inner, outer = -2.0 * seen.blur_px[:, 0] - 12.0, seen.apart_px + 2.0 * seen.blur_px[:, 1] + 12.0
        best, chosen = np.inf, np.zeros(2)
        for right in np.arange(-FARTHEST_PX, FARTHEST_PX + 1.0, SEARCH_PX):
            for down in np.arange(-FARTHEST_PX, FARTHEST_PX + 1.0, SEARCH_PX):
                lit = [self._light_at(smoothed, each, np.array([right, down])) for each in (middle, inner, outer)]
                beside = np.where(seen.paired, np.minimum(lit[1], lit[2]), lit[1])
                part = float(np.nanmean(lit[0] / (beside + 4.0))) + 0.1 * (right**2 + down**2) / FARTHEST_PX**2
                if part < best:
                    best, chosen = part, np.array([right, down])
        _, jacobian = self._offsets(np.zeros(self.device.count))
        by, wanted = jacobian[:, 0, :CAMERA], seen.out @ chosen
        errors = np.zeros(self.device.count)
        errors[:CAMERA] = np.linalg.solve(by.T @ by + 0.1 * np.eye(CAMERA), by.T @ wanted)
        return errors

    def _light_at(self, image: Any, out_px: FloatArray, shift_px: FloatArray) -> FloatArray:
        """Light (n,) at distances out of the stations, all shifted; NaN off the picture."""
        at = np.rint(self.seen.place + out_px[:, None] * self.seen.out + shift_px).astype(np.int64)
        height, width = image.shape
        inside = ((at >= 0) & (at < [width, height])).all(axis=1)
        at = np.clip(at, 0, [width - 1, height - 1])
        return np.where(inside, image[at[:, 1], at[:, 0]], np.nan)

    def _offsets(self, errors: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Offsets (n, 2) of both edges along `out`, and their derivatives (n, 2, p)."""
        seen, offsets, jacobians = self.seen, [], []
        for points, designed in ((seen.own, 0.0), (seen.other, seen.apart_px)):
            at, jacobian = self.device.pixels_with_jacobian(points, errors)
            offsets.append(((at - seen.place) * seen.out).sum(axis=1) - designed)
            jacobians.append(np.einsum("ni,nip->np", seen.out, jacobian))
        offset, jacobian = np.stack(offsets, axis=1), np.stack(jacobians, axis=1)
        return np.where(np.isfinite(offset), offset, 0.0), np.nan_to_num(jacobian)

    def _linear(self, image: NDArray[np.float32], errors: FloatArray, smooth: float) -> tuple[FloatArray, ...]:
        """Offsets and their derivatives, and of each station the information (n, 2, 2) and pull (n, 2) on them."""
        offset, jacobian = self._offsets(errors)
        given = profiles(image, self.seen, offset, smooth)
        rest, change = edges_light(given, self.seen, offset, smooth)
        count = np.maximum(given.weight.sum(axis=1) - 3.0, 1.0)
        squares = (rest**2).sum(axis=1) / count
        # Stations that the model does not explain count less.
        weight = 1.0 / np.maximum(squares, 1.0) / (1.0 + np.maximum(squares - HEAVY, 0.0))
        by = change @ np.swapaxes(change, 1, 2) * weight[:, None, None]
        pull = (change @ rest[..., None])[..., 0] * weight[:, None]
        return offset, jacobian, by, pull, squares

    def _step(self, image: NDArray[np.float32], errors: FloatArray, smooth: float) -> FloatArray:
        _, jacobian, by, pull, _ = self._linear(image, errors, smooth)
        hessian = np.einsum("nap,nab,nbq->pq", jacobian, by, jacobian, optimize=True) + np.eye(len(errors))
        gradient = np.einsum("nap,na->p", jacobian, pull) - errors
        step = np.linalg.solve(hessian, gradient)
        shift = np.abs(jacobian @ step).max()
        return np.asarray(step * min(1.0, MOST_STEP_PX / max(float(shift), 1e-12)))

    def _result(self, image: NDArray[np.float32], errors: FloatArray) -> EdgeFit:
        offset, jacobian, by, pull, squares = self._linear(image, errors, 0.0)
        information = np.einsum("nap,nab,nbq->pq", jacobian, by, jacobian, optimize=True)
        # The offset by each station alone: the scatter of these shows how well the model explains them.
        inverse = np.linalg.inv(information + np.eye(len(errors)))
        with np.errstate(divide="ignore", invalid="ignore"):
            alone = np.diagonal(by, axis1=1, axis2=2)
            own, sigma = offset + pull / alone, 1.0 / np.sqrt(alone)
        known = sigma < KNOWN_PX
        known[:, 1] &= self.seen.paired
        return EdgeFit(
            self.device,
            self.seen,
            errors,
            inverse,
            offset,
            np.where(known, own, np.nan),
            np.where(known, sigma, np.nan),
            float(np.median(squares)),
        )


class SceneAligner:
    """Measures how the mirrors of one layout are turned by points that its views share; keep one for all frames.

    Parameters
    ----------
    layout
        The nominal layout, of three mirrors or more.
    errors
        What errors of building are expected; by default those of a device made by hand.

    Raises InputError where the views have no common field.
    """

    def __init__(self, layout: Layout, errors: BuildErrors | None = None) -> None:
        self.layout, self.errors = layout, BuildErrors.of(layout) if errors is None else errors
        self._matcher = PointMatcher(layout)
        self._names = parameter_names(layout)

    def align(self, frames: Sequence[NDArray[np.uint8]]) -> Alignment:
        """The alignment by frames (h, w, 3) in RGB; nothing is determined where the views share too few points."""
        layout, names, mirrors = self.layout, self._names, self.layout.mirrors
        own = {k: own_motion(mirror, self.errors.tilt_deg, self.errors.lift_mm) for k, mirror in enumerate(mirrors)}
        prior = placed(own, names) + common_covariance(layout, names) + self._lens()
        matches = MatchedPoints.joined([self._matcher.match(frame) for frame in frames])
        shown = np.bincount(matches.view, minlength=len(mirrors))
        if (shown >= LEAST_POINTS).sum() < 2:
            return self._nothing()
        matches = explained_matches(layout, matches, prior)
        shown = np.bincount(matches.view, minlength=len(mirrors))
        if (shown >= LEAST_POINTS).sum() < 2:
            return self._nothing()
        information, gradient = deflated(SceneFit(layout, matches, prior).solve())
        inside = np.eye(len(prior)) + information @ prior
        found = np.linalg.solve(inside, np.column_stack([gradient, information]))
        pull, stiffness = found[:, 0], found[:, 1:]
        tilts = []
        for k, block in own.items():
            rows, plane = mirror_rows(names, k), mirrors[k].rig_from_plane[:3, :2]
            by = plane.T @ turn_of_centre(layout, names, k)[:, rows]
            spread = by @ (block - block @ stiffness[np.ix_(rows, rows)] @ block) @ by.T
            tilts.append(mirror_tilt(layout, k, by @ block @ pull[rows], spread, self.errors.tilt_deg))
        motions, rows = common_motions(layout)[:, :6], all_rows(layout, names)
        size = np.array([COMMON_DEG] * 3 + [COMMON_MM] * 3)
        common = size * (motions.T @ pull[rows])
        left = np.eye(6) - motions.T @ stiffness[np.ix_(rows, rows)] @ motions
        sigma = size * np.sqrt(np.maximum(np.diag(left), 0.0))
        # Mirrors that all turn together before the camera are a camera that turns the other way.
        return Alignment(
            "scene", tuple(tilts), -common[3:], sigma[3:], -common[:3], sigma[:3], points=len(matches.frame)
        )

    def _lens(self) -> FloatArray:
        """Covariance (g, g) of the camera's intrinsics."""
        names, camera, errors = self._names, self.layout.camera, self.errors
        sigma = dict.fromkeys(camera.intrinsic_names, 0.0)
        sigma |= dict.fromkeys(("fx_px", "fy_px"), errors.focal_percent / 100.0 * camera.fx_px)
        sigma |= dict.fromkeys(("cx_px", "cy_px"), errors.centre_px)
        sigma |= dict(zip(camera.intrinsic_names[4:], (*errors.lens, DECENTRED, DECENTRED), strict=False))
        covariance = np.diag([sigma.get(name, 0.0) ** 2 for name in names])
        # Pixels are square: both focal lengths are off together.
        fx, fy = names.index("fx_px"), names.index("fy_px")
        covariance[fx, fy] = covariance[fy, fx] = 0.9999 * covariance[fx, fx]
        return covariance

    def _nothing(self) -> Alignment:
        nan, before = float("nan"), self.errors.tilt_deg
        mirrors = tuple(MirrorTilt(k, nan, nan, (before, before)) for k in range(len(self.layout.mirrors)))
        unknown = np.full(3, np.nan)
        return Alignment("scene", mirrors, unknown, np.full(3, COMMON_MM), unknown, np.full(3, COMMON_DEG))
