"""Simulated corners of boards that move along smooth paths while a rolling shutter reads each frame."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.diagnostics.nested_models import Fitted, fit_as
from mirrorcam.optics.calibration.diagnostics.split_half import global_values
from mirrorcam.optics.calibration.solver.observations import DIRECT, Observations
from mirrorcam.optics.calibration.solver.residuals import Estimate, global_names, row_times
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.transforms import transform
from mirrorcam.render_scenes.boards import smooth_motion
from tests.optics.calibration.diagnostics.conftest import BOARD, JOINT
from tests.optics.calibration.diagnostics.faults import Setup
from tests.optics.calibration.synthetic_corners import mirrored_poses, views_of

NOISE_PX = 0.01
FRAMES_PER_KEY = 30
TIMES = np.linspace(-0.5, 0.5, 9)
"""Times during a readout at which corners are projected; polynomials connect them."""


@dataclass(frozen=True)
class MovingBoards:
    """Corners of consecutive frames with mirrors and of base frames at rest, and the truth.

    `readout` is the time from the first row to the last, in frame periods.
    """

    layout: Layout
    truth: Estimate
    clean: Observations
    readout: float
    mirrored: int

    @classmethod
    def of(cls, seed: int, *, frames: int = 40, readout: float = 0.9, global_shutter: bool = False) -> MovingBoards:
        """Move a board through random poses before a random device; a global shutter exposes all rows at once."""
        setup = Setup.of(seed)
        keys = np.array(mirrored_poses(BOARD, frames // FRAMES_PER_KEY + 2, tilt_deg=30, seed=seed + 300))
        middle = np.arange(frames) + 1.0
        path = smooth_motion(keys, (middle[:, None] + readout * TIMES).ravel() / FRAMES_PER_KEY)
        poses = path.reshape(frames, len(TIMES), 4, 4)
        if global_shutter:
            poses = np.repeat(poses[:, len(TIMES) // 2, None], len(TIMES), axis=1)
        at_middle = poses[:, len(TIMES) // 2]
        views = views_of(setup.truth, BOARD, list(at_middle), setup.direct, noise_px=0.0)
        seen = [_at_their_rows(setup.truth, rows, path) for rows, path in zip(views.mirrored, poses, strict=True)]
        rows = Observations.join([frame.with_frame_offset(n) for n, frame in enumerate([*seen, *views.base])])
        truth = Estimate.of(setup.truth.camera, setup.truth.mirrors, np.array([*at_middle, *setup.direct]))
        return cls(setup.truth, truth, rows, readout, frames)

    def noisy(self, seed: int) -> Observations:
        """The corners with noise."""
        noise = NOISE_PX * np.random.default_rng(seed).standard_normal(self.clean.pixels.shape)
        return replace(self.clean, pixels=self.clean.pixels + noise, sigma_px=np.full(len(self.clean), NOISE_PX))

    def joint(self, observations: Observations) -> Fitted:
        """Fit boards at rest."""
        return fit_as("joint", self.truth, observations, JOINT)

    def nees(self, fitted: Fitted) -> float:
        """Squared error of camera and mirrors in a fit's covariance, per parameter: 1 on average."""
        solution = fitted.solution
        names = global_names(self.truth.camera.intrinsic_names, len(self.truth.virtual_centres_in_rig_mm), 0)
        columns = [names.index(name) for name in solution.parameters]
        error = (global_values(solution.estimate) - global_values(self.truth))[columns]
        return float(error @ np.linalg.solve(solution.covariance, error)) / len(error)


def _at_their_rows(layout: Layout, rows: Observations, poses: FloatArray) -> Observations:
    """Move a frame's corners to where they are as their rows are read, with `poses` at `TIMES`."""
    pixels = np.empty((len(TIMES), len(rows), 2))
    for view in np.unique(rows.view):
        of_view = rows.view == view
        image = (lambda points: points) if view == DIRECT else layout.mirrors[view].image_of
        for time, pose in enumerate(poses):
            points = transform(pose, BOARD.corners_in_board_mm)[rows.corner[of_view]]
            pixels[time, of_view] = layout.camera.project(image(points))
    powers = np.polynomial.polynomial.polyfit(TIMES, pixels.reshape(len(TIMES), -1), len(TIMES) - 1)
    path = partial(np.einsum, "kn,knc->nc")
    found = rows.pixels
    for _ in range(20):
        times = row_times(layout.camera, found[:, 1])
        found = path(times ** np.arange(len(TIMES))[:, None], powers.reshape(pixels.shape))
    return replace(rows, pixels=found)
