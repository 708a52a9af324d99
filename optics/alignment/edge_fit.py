"""The errors of building under which the edges of all sub-images are where a picture shows them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.alignment.build_errors import CAMERA, BuiltDevice
from mirrorcam.optics.alignment.edge_profiles import Stations, edges_light, profiles, stations

SMOOTH_PX = (20.0, 10.0, 4.0, 0.0)
"""The picture is smoothed so, to find edges that are far from where they were designed to be."""
ROUNDS = 6
HEAVY = 2.0
"""Stations whose squared residuals are more than that many times as large as their noise count less."""
MOST_STEP_PX = 8.0
FARTHEST_PX, SEARCH_PX = 40.0, 4.0
"""How far all edges together may be from their places, and steps in which that is searched."""
KNOWN_PX = 3.0
"""A station that tells an edge less precisely by itself does not tell it."""


@dataclass(frozen=True, eq=False)
class EdgeFit:
    """What edges tell of the errors of a device.

    Attributes
    ----------
    device, seen
        The device and the stations.
    errors, covariance
        The errors (p,) of `BuiltDevice`, and their covariance (p, p).
    offset_px
        Offsets (n, 2) of the edges at the stations from where they were designed, along `out`.
    own_px, own_sigma_px
        What each station by itself tells of the offset (n, 2), and its standard deviation; NaN where it tells nothing.
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
        """Points (n, 2) of edges as designed, and where they are seen, of all stations that tell their edge, px."""
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
        # What is not as the model says counts less.
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
        # Stations of one edge pull on their own: how much they scatter says how well they are understood.
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
