"""Problems for tests and benchmarks of the solver: corners of a board in nine mirrors and seen directly, with truth.

The Cramér-Rao bound is computed here by finite differences of the residuals and one dense inverse, which
shares nothing with the solver.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.solver import initial_estimates
from mirrorcam.optics.calibration.solver.observations import DIRECT, Corners, Observations
from mirrorcam.optics.calibration.solver.parameterisation import Model
from mirrorcam.optics.calibration.solver.residuals import Board, Estimate, global_names, residuals
from mirrorcam.optics.geometry.boards import Checkerboard
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror import Mirror
from tests.optics.calibration.synthetic_corners import direct_corners, direct_poses, mirrored_corners, mirrored_poses
from tests.optics.layouts import faceted_parabola

SIGMA_PX = 0.05
LENS = (0.05, -0.12, 4e-4, -6e-4, 0.01)


@dataclass(frozen=True)
class Scene:
    """The true layout, its exact corners, and the model to fit: cameras, nine mirrors, poses."""

    layout: Layout
    truth: Estimate
    clean: Observations
    model: Model

    def noisy(self, seed: int) -> tuple[Observations, FloatArray]:
        """The corners with Gaussian noise, and that noise (n, 2) px."""
        noise = np.random.default_rng(seed).normal(0.0, SIGMA_PX, self.clean.pixels.shape)
        return replace(self.clean, pixels=self.clean.pixels + noise), noise

    @property
    def free(self) -> NDArray[np.int64]:
        """Indices of the free globals."""
        return self.model.free(self.truth.camera, len(self.layout.mirrors))

    @cached_property
    def jacobian(self) -> FloatArray:
        """Derivatives (2 n, g + 6 f) by the free globals and the twists of all frames, by central differences."""
        free, frames = self.free, len(self.truth.rig_from_board)
        names = global_names(self.truth.camera.intrinsic_names, len(self.layout.mirrors), self.truth.shape.size)
        size = len(names)
        columns = []
        for place in free:
            h = 1e-6 if 4 <= place < self.truth.camera.intrinsics.size else 1e-4
            columns.append(self._difference(np.eye(size)[place], np.zeros((frames, 6)), h))
        for place in range(6 * frames):
            twists = np.eye(6 * frames)[place].reshape(frames, 6)
            columns.append(self._difference(np.zeros(size), twists, 1e-5 if place % 6 < 3 else 1e-4))
        return np.array(columns).T

    def _difference(self, step: FloatArray, twists: FloatArray, h: float) -> FloatArray:
        ahead, back = (
            residuals(self.truth.moved(sign * h * step, sign * h * twists), self.clean, self.model.board)
            for sign in (1, -1)
        )
        return ((ahead - back) / (2 * h)).ravel()

    @cached_property
    def linear(self) -> FloatArray:
        """Return the matrix (g, 2 n) from small noise to the error of the least-squares estimate of the globals."""
        scale = np.linalg.norm(self.jacobian, axis=0)
        inverse = np.linalg.pinv(self.jacobian / scale, rcond=1e-13) / scale[:, None]
        return inverse[: len(self.free)]

    @cached_property
    def bound(self) -> FloatArray:
        """Return the Cramér-Rao bound (g, g) of the covariance of the free globals: the inverse Fisher information."""
        return SIGMA_PX**2 * self.linear @ self.linear.T

    def errors(self, estimate: Estimate) -> FloatArray:
        """Return the errors of the free globals (g,) of an estimate."""
        ours, true = (
            np.concatenate(
                [
                    e.camera.intrinsics,
                    e.virtual_centres_in_rig_mm.ravel(),
                    e.curvature_per_m.ravel(),
                    [e.thickness_mm.max()],
                    e.shape,
                ]
            )
            for e in (estimate, self.truth)
        )
        return np.asarray((ours - true)[self.free])


def nominal_layout() -> Layout:
    """Nine facets of a parabola before a C920."""
    return faceted_parabola(Camera.c920(), DesignSpec(), fill=0.92)


def scene(layout: Layout, *, frames: int, base_frames: int, board: Checkerboard, seed: int) -> Scene:
    """Return boards that a layout shows in part or completely, at poses drawn from a seed."""
    mirrored = mirrored_poses(board, frames, tilt_deg=30.0, seed=seed)
    direct = direct_poses(board, base_frames, tilt_deg=30.0, seed=seed + 1)
    random = np.random.default_rng(0)
    parts = [mirrored_corners(layout, board, pose, 0.0, random).with_frame_offset(f) for f, pose in enumerate(mirrored)]
    parts += [
        direct_corners(layout, board, pose, 0.0, random).with_frame_offset(frames + f) for f, pose in enumerate(direct)
    ]
    truth = Estimate.of(layout.camera, layout.mirrors, np.array(mirrored + direct))
    model = Model(
        layout.camera.intrinsic_names, thickness=False, curvature=False, board=Board.rigid(board.corners_in_board_mm)
    )
    return Scene(layout, truth, Observations.join(parts), model)


def small_scene(seed: int = 1) -> Scene:
    """Eight frames through nine mirrors and four without, about 30 corners in each view."""
    nominal = nominal_layout()
    layout = nominal.replaced(camera=nominal.camera.replaced(distortion=LENS))
    return scene(layout, frames=8, base_frames=4, board=Checkerboard(cols=9, rows=7, square_mm=16.0), seed=seed)


def large_scene() -> Scene:
    """216 parameters and 29,160 residuals: 54 corners in each of nine mirrors in each of 30 frames, none cut off."""
    random = np.random.default_rng(3)
    nominal = nominal_layout()
    layout = nominal.replaced(camera=nominal.camera.replaced(distortion=LENS))
    board = Checkerboard(cols=10, rows=7, square_mm=9.0)
    poses = np.array(mirrored_poses(board, 30, tilt_deg=30.0, seed=int(random.integers(100))))
    every = np.arange(54)
    views = [(frame, view) for frame in range(30) for view in range(9)]
    seen = Observations.join([Observations.of_view(f, v, every, np.zeros((54, 2))) for f, v in views])
    truth = Estimate.of(layout.camera, layout.mirrors, poses)
    model = Model(
        layout.camera.intrinsic_names, thickness=False, curvature=False, board=Board.rigid(board.corners_in_board_mm)
    )
    return Scene(layout, truth, replace(seen, pixels=residuals(truth, seen, model.board)), model)


def disturbed(layout: Layout, seed: int, *, tilt_deg: float, offset_mm: float) -> tuple[Mirror, ...]:
    """Return the mirrors, each tilted about an axis of its plane and shifted along its normal by these amounts."""
    random = np.random.default_rng(seed)
    moved = []
    for mirror in layout.mirrors:
        angle = random.uniform(0.0, 2.0 * np.pi)
        axis = mirror.rig_from_plane[:3, :2] @ [np.cos(angle), np.sin(angle)]
        turn = Rotation.from_rotvec(np.radians(tilt_deg) * axis).as_matrix()
        moved.append(mirror.moved(turn, random.choice([-1.0, 1.0]) * offset_mm * mirror.normal_in_rig))
    return tuple(moved)


def start_from(camera: Camera, mirrors: tuple[Mirror, ...], observations: Observations, board: Board) -> Estimate:
    """Return the start of a calibration: these mirrors, each board's pose from the view that fits its frame best."""
    poses = []
    for frame in range(int(observations.frame.max()) + 1):
        rows = observations.where(observations.frame == frame)
        views = [
            (None if view == DIRECT else mirrors[view], Corners(rows.corner[shown], rows.pixels[shown]))
            for view in np.unique(rows.view)
            if (shown := rows.view == view).any()
        ]
        poses.append(initial_estimates.best_pose(camera, views, board.corners_in_board_mm))
    return Estimate.of(camera, mirrors, np.array(poses))
