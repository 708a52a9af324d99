"""Tilts of mirrors from points of any textured scene that several views share, without a board."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.alignment.alignment import Alignment, MirrorTilt, mirror_tilt
from mirrorcam.optics.alignment.build_errors import BuildErrors
from mirrorcam.optics.drift.drift import LEAST_POINTS, deflated, understood
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

DECENTRED = 1e-3
"""Standard deviation of the decentring terms of a lens."""


class SceneAligner:
    """Tells how the mirrors of one layout are turned by points that its views share; keep one for all frames.

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
        """What frames (h, w, 3) in RGB tell; nothing where the views share too few points."""
        layout, names, mirrors = self.layout, self._names, self.layout.mirrors
        own = {k: own_motion(mirror, self.errors.tilt_deg, self.errors.lift_mm) for k, mirror in enumerate(mirrors)}
        prior = placed(own, names) + common_covariance(layout, names) + self._lens()
        matches = MatchedPoints.joined([self._matcher.match(frame) for frame in frames])
        shown = np.bincount(matches.view, minlength=len(mirrors))
        if (shown >= LEAST_POINTS).sum() < 2:
            return self._nothing()
        matches = understood(layout, matches, prior)
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
