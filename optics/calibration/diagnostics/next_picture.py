"""Next best view of a bare camera: the pose of the board that most reduces the projection uncertainty."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
import shapely
from scipy.spatial.transform import Rotation

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.detection.next_pose import TILTS, indices_inside, position_in_words, tilt_in_words
from mirrorcam.optics.calibration.diagnostics.projection_uncertainty import (
    grid_points,
    project_points,
    propagate,
    relative_derivatives,
    uncertainty_of,
    worst_sigmas,
)
from mirrorcam.optics.calibration.solver.levenberg_marquardt import Solution
from mirrorcam.optics.calibration.solver.normal_equations import Grouped, normal_equations
from mirrorcam.optics.calibration.solver.observations import DIRECT, Observations
from mirrorcam.optics.calibration.solver.parameterisation import FrameTerms, Model
from mirrorcam.optics.calibration.solver.residuals import Board, residuals
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.transforms import rigid

PARTS = (0.2, 0.5, 0.8)
"""Places of the board's centre across and down the picture."""
FILLED = (0.4, 0.75)
"""Fractions of the picture's width that the board fills."""
MIN_VISIBLE = 0.6
"""Minimum fraction of the board's corners within the picture."""


@dataclass(frozen=True)
class NextPicture:
    """The most useful further picture of the board.

    Attributes
    ----------
    pose
        The pose of the board, in words.
    sigma_px, predicted_px
        Projection uncertainty before and after it: rms over the picture, apart from a rotation of the camera.
    """

    pose: str
    sigma_px: float
    predicted_px: float

    @property
    def sentence(self) -> str:
        """The recommendation."""
        return (
            f"the most useful further picture has the board {self.pose}: it would lower the projection uncertainty "
            f"from {self.sigma_px:.2g} to {self.predicted_px:.2g} px"
        )


def next_picture(solution: Solution, model: Model, layout: Layout, *, range_mm: float) -> NextPicture | None:
    """Return the most useful further picture for a bare camera; None if no pose shows the board.

    Parameters
    ----------
    solution, model
        The fit of the camera.
    layout
        The calibrated camera, with the covariance of the fit.
    range_mm
        Distance of the points whose projections are compared, mm.
    """
    _, points = grid_points(layout, DIRECT, range_mm)
    derivatives = relative_derivatives(layout, DIRECT, points, project_points(layout, DIRECT, points))
    names = uncertainty_of(layout).parameters
    columns = [solution.parameters.index(name) for name in names]

    def sigma_px(covariance: FloatArray) -> float:
        sigmas = worst_sigmas(propagate(derivatives, covariance[np.ix_(columns, columns)]))
        return float(np.sqrt(np.mean(sigmas**2)))

    model = replace(model, frame_terms=FrameTerms())
    information = np.linalg.pinv(solution.covariance, hermitian=True)
    best: NextPicture | None = None
    before_px = sigma_px(solution.covariance)
    for pose, words in _poses(layout.camera, model.board):
        estimate = solution.estimate.with_poses(pose[None])
        ids = np.arange(len(model.board.corners_in_board_mm))
        pixels = residuals(estimate, Observations.of_view(0, DIRECT, ids, np.zeros((len(ids), 2))), model.board)
        visible = indices_inside(_sensor(layout.camera), pixels)
        if len(visible) < MIN_VISIBLE * len(ids):
            continue
        sigmas_px = np.full(len(visible), solution.sigma_px)
        rows = Observations.of_view(0, DIRECT, visible, pixels[visible], sigmas_px)
        added = normal_equations(estimate, Grouped.of(rows, model), model).reduced(0.0)[0]
        predicted_px = sigma_px(np.asarray(np.linalg.inv(information + added), dtype=np.float64))
        if best is None or predicted_px < best.predicted_px:
            best = NextPicture(words, before_px, predicted_px)
    return best


def _sensor(camera: Camera) -> shapely.Geometry:
    return shapely.box(0.0, 0.0, camera.width_px - 1.0, camera.height_px - 1.0)


def _poses(camera: Camera, board: Board) -> Iterator[tuple[FloatArray, str]]:
    """Yield poses (4, 4) of the board over the picture, near and far, facing the camera and tilted, in words."""
    corners = board.corners_in_board_mm
    middle, width_mm = (corners.min(axis=0) + corners.max(axis=0)) / 2.0, float(np.ptp(corners, axis=0).max())
    for x, y, filled, tilt in product(PARTS, PARTS, FILLED, TILTS):
        pixel = np.array([x * (camera.width_px - 1.0), y * (camera.height_px - 1.0)])
        ray = camera.unproject(pixel)
        if not np.isfinite(ray).all():
            continue
        ray = ray / np.linalg.norm(ray)
        distance_mm = camera.fx_px * width_mm / (filled * camera.width_px)
        facing, _ = Rotation.align_vectors(ray[None], np.array([[0.0, 0.0, 1.0]]))
        rotation = (facing * Rotation.from_euler("xy", tilt, degrees=True)).as_matrix()
        words = [f"at the {position_in_words(camera, pixel)}", f"filling {filled:.0%} of its width"]
        words += [tilt_in_words(tilt, "the camera")] if any(tilt) else ["facing the camera"]
        yield rigid(rotation, distance_mm * ray - rotation @ middle), ", ".join(words)
