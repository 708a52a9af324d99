"""Exact corners of a small device: four mirrors, eight frames through them and six without."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from mirrorcam.optics.calibration.solver.observations import DIRECT, Observations
from mirrorcam.optics.calibration.solver.parameterisation import Model
from mirrorcam.optics.calibration.solver.residuals import Board, Estimate, residuals
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.transforms import rigid

SIGMA_PX = 0.05
MIRRORS = 4


@dataclass(frozen=True)
class FourMirrors:
    truth: Estimate
    board: Board
    clean: Observations

    @property
    def model(self) -> Model:
        return Model(self.truth.camera.intrinsic_names, thickness=False, curvature=False, board=self.board)

    def noisy(self, seed: int, sigma_px: float = SIGMA_PX) -> Observations:
        noise = np.random.default_rng(seed).normal(0.0, sigma_px, self.clean.pixels.shape)
        return replace(self.clean, pixels=self.clean.pixels + noise)


def four_mirrors(modes: int = 0) -> FourMirrors:
    """The scene, with the corners outside the sensor left out."""
    random = np.random.default_rng(3)
    camera = Camera.c920().replaced(distortion=[0.05, -0.12, 4e-4, -6e-4, 0.01])
    chief = np.array([[-0.3, 0.18], [0.3, 0.18], [-0.3, -0.18], [0.3, -0.18]])
    t = 80.0 / (np.sqrt(1.0 + (chief**2).sum(axis=1)) - chief[:, 1])
    centres = np.column_stack([t * chief[:, 0], np.full(MIRRORS, -80.0), t]) + random.normal(0, 1.0, (MIRRORS, 3))
    y, x = np.mgrid[0:6, 0:9].reshape(2, -1) * 20.0
    corners = np.column_stack([x, y, np.zeros_like(x)])
    board = replace(Board.free(corners), modes=Board.free(corners).modes[:modes])
    fold = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
    poses = []
    for number in range(14):
        mirrored = number < 8
        turn = Rotation.from_euler("xyz", random.uniform(-35, 35, 3), degrees=True).as_matrix()
        middle = [0.0, random.uniform(300, 500), 80.0] if mirrored else [0.0, 0.0, random.uniform(250, 400)]
        turn = fold @ turn if mirrored else turn
        poses.append(rigid(turn, np.array(middle) - turn @ corners.mean(axis=0)))
    truth = Estimate(camera, centres, np.array(poses), 0.3 * random.normal(size=modes))
    every = np.arange(len(corners))
    views = [(frame, view) for frame in range(8) for view in range(MIRRORS)] + [(f, DIRECT) for f in range(8, 14)]
    seen = Observations.join([Observations.of_view(f, v, every, np.zeros((len(corners), 2))) for f, v in views])
    pixels = residuals(truth, seen, board)
    inside = np.all((pixels > 0) & (pixels < [1919, 1079]), axis=1)
    return FourMirrors(truth, board, replace(seen.where(inside), pixels=pixels[inside]))
