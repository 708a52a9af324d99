"""A small mirror camera and simulated corners, for tests of a calibration's diagnostics."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import pytest

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.diagnostics.calibration_result import tilted_to, uncertainty
from mirrorcam.optics.calibration.solver.levenberg_marquardt import Solution, fit
from mirrorcam.optics.calibration.solver.observations import Observations
from mirrorcam.optics.calibration.solver.parameterisation import Model
from mirrorcam.optics.calibration.solver.residuals import Board, Estimate
from mirrorcam.optics.geometry.boards import Charuco
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror import Mirror
from tests.optics.calibration.synthetic_corners import as_built, direct_poses, mirrored_poses, views_of
from tests.optics.layouts import faceted_parabola

NOISE_PX = 0.05
BOARD = Charuco(cols=10, rows=7, square_mm=24.0, marker_mm=16.0)
JOINT = Model(
    Camera.c920().intrinsic_names, thickness=False, curvature=False, board=Board.rigid(BOARD.corners_in_board_mm)
)


@dataclass(frozen=True)
class Scene:
    """A layout, the poses (f, 4, 4) of a board before it and before its bare camera, and the corners without noise."""

    truth: Layout
    poses: FloatArray
    clean: Observations

    def noisy(self, seed: int, noise_px: float = NOISE_PX) -> Observations:
        noise = np.random.default_rng(seed).normal(0.0, noise_px, self.clean.pixels.shape)
        return replace(self.clean, pixels=self.clean.pixels + noise)

    @property
    def start(self) -> Estimate:
        return Estimate.of(self.truth.camera, self.truth.mirrors, self.poses)

    def calibrated(self, solution: Solution) -> Layout:
        """The layout of a solution of a model with flat first-surface mirrors, with its covariance."""
        found = solution.estimate
        mirrors = zip(self.truth.mirrors, found.virtual_centres_in_rig_mm, strict=True)
        return self.truth.replaced(
            kind="calibrated",
            camera=found.camera,
            mirrors=tuple(tilted_to(mirror, centre) for mirror, centre in mirrors),
            uncertainty=uncertainty(solution),
        )


class Bowed(Charuco):
    """A board that is bowed along x, with a sag of `warp_mm` at its edges."""

    warp_mm: float = 0.0

    @cached_property
    def corners_in_board_mm(self) -> FloatArray:
        drawn = super().corners_in_board_mm
        return Board.warped(drawn).shaped(np.array([self.warp_mm, 0.0]))


def scene_of(truth: Layout, *, warp_mm: float = 0.0, mirrored: int = 10, direct: int = 5) -> Scene:
    """Return boards at several tilts, bowed along x with a sag of `warp_mm` at the edges."""
    poses = [
        *mirrored_poses(BOARD, mirrored, tilt_deg=30, seed=1),
        *direct_poses(BOARD, direct, tilt_deg=30, seed=2),
    ]
    board = Bowed(**BOARD.model_dump(), warp_mm=warp_mm)
    views = views_of(truth, board, poses[:mirrored], poses[mirrored:], noise_px=0.0)
    frames = [*views.mirrored, *views.base]
    clean = Observations.join([seen.with_frame_offset(frame) for frame, seen in enumerate(frames)])
    return Scene(truth, np.array(poses), clean)


@pytest.fixture(scope="session")
def device() -> Layout:
    """A 2 x 2 faceted parabola as built: tilted and shifted mirrors, a lens of its own."""
    camera = Camera.c920()
    return as_built(faceted_parabola(camera, DesignSpec(camera=camera, rows=2, cols=2), fill=0.9), seed=3)


@pytest.fixture(scope="session")
def scene(device: Layout) -> Scene:
    return scene_of(device)


@pytest.fixture(scope="session")
def solution(scene: Scene) -> Solution:
    return fit(scene.start, scene.noisy(0), JOINT)


@pytest.fixture(scope="session")
def calibrated(scene: Scene, solution: Solution) -> Layout:
    return scene.calibrated(solution)


def behind_glass(layout: Layout, thickness_mm: float) -> Layout:
    """The layout with second-surface acrylic mirrors that look the same along the chief ray of each."""
    mirrors = tuple(
        Mirror.second_surface(
            mirror.virtual_centre_in_rig_mm,
            mirror.outline_in_rig_mm,
            thickness_mm=thickness_mm,
            refractive_index=1.49,
        )
        for mirror in layout.mirrors
    )
    return layout.replaced(mirrors=mirrors)


def bent(layout: Layout, sag_mm: float, seed: int = 5) -> Layout:
    """Return the layout with every mirror bent, with a sag of about `sag_mm` between middle and corners."""
    random = np.random.default_rng(seed)
    mirrors = []
    for mirror in layout.mirrors:
        half_mm = float(np.linalg.norm(mirror.outline_in_plane_mm, axis=1).max())
        curvature = 1000.0 * 2.0 * sag_mm / half_mm**2 * random.choice([-1.0, 1.0], 3) * [1.0, 0.7, 0.3]
        mirrors.append(mirror.replaced(curvature_per_m=curvature))
    return layout.replaced(mirrors=tuple(mirrors))
