"""Corners in decoded views, compared with the truth and with the error that the calibration's covariance predicts.

The rig frame turns with the axis of the lens, which a lens with a field of displacements hardly has. A rotation of the
whole rig does no harm to a light field, so that which fits the errors best is removed, from the errors and from the
predicted ones.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from mirrorcam.core.images.picture_data import as_grey
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.detection.detect_boards import detect_direct_view
from mirrorcam.optics.calibration.diagnostics.projection_uncertainty import (
    centre_derivatives,
    project_points,
    uncertainty_of,
)
from mirrorcam.optics.geometry.boards import CalibrationBoard
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.transforms import transform
from mirrorcam.optics.light_field.light_field import LightField

INTERPOLATION_PX = 0.005
"""Standard deviation per axis of the error of corners by linear interpolation in decoding, in sharp pictures."""


@dataclass(frozen=True)
class DecodedCorners:
    """Corners in decoded views against those predicted by a pinhole at the true position of the view.

    Attributes
    ----------
    errors_px
        Detected minus predicted pixels (n, 2).
    d_rotation
        Derivatives (n, 2, 3) of the errors with respect to a rotation vector of the rig, px/rad.
    d_frame
        Derivatives (n, 2, 2) of pixels of the views with respect to those of the frame.
    products
        Products (3 + g, 3 + g), summed over all errors, of `d_rotation` and of the derivatives with respect to the
        calibration's g parameters.
    """

    errors_px: FloatArray
    d_rotation: FloatArray
    d_frame: FloatArray
    products: FloatArray

    @classmethod
    def join(cls, parts: Sequence[DecodedCorners]) -> DecodedCorners:
        """Join the corners of several frames."""
        return cls(
            np.concatenate([part.errors_px for part in parts]),
            np.concatenate([part.d_rotation for part in parts]),
            np.concatenate([part.d_frame for part in parts]),
            np.sum([part.products for part in parts], axis=0),
        )

    def distances_px(self) -> FloatArray:
        """Distances (n,) between detected and predicted corners, without the best rotation of the rig."""
        columns, errors = self.d_rotation.reshape(-1, 3), self.errors_px.reshape(-1)
        rest = errors - columns @ np.linalg.lstsq(columns, errors, rcond=None)[0]
        return np.asarray(np.linalg.norm(rest.reshape(-1, 2), axis=1))

    def bound_px(self, covariance: FloatArray, corner_sigma_px: float, chance: float) -> tuple[float, float]:
        """Predict the RMS distance; return its root mean square, and what it exceeds with a probability of `chance`.

        The errors of a calibration are shared by all corners: their mean square is a weighted sum of squares of
        standard normal numbers, whose distribution is taken as a scaled chi-squared one of the same mean and variance
        (Satterthwaite). The noise of corners averages out.

        Parameters
        ----------
        covariance
            Of the calibration's parameters, (g, g).
        corner_sigma_px
            Standard deviation per axis of the noise of corners in the frames, which decoding scales.
        chance
            The probability.
        """
        of_rotation, mixed, of_parameters = self.products[:3, :3], self.products[:3, 3:], self.products[3:, 3:]
        rest = of_parameters - mixed.T @ np.linalg.pinv(of_rotation, hermitian=True) @ mixed
        mean_square = rest @ covariance / len(self.errors_px)
        total, squares = float(np.trace(mean_square)), float(np.sum(mean_square * mean_square.T))
        scale = float(np.mean(np.square(self.d_frame).sum(axis=(1, 2))))
        noise = corner_sigma_px**2 * scale + 2.0 * INTERPOLATION_PX**2
        worst = squares / total * chi2.isf(chance, total**2 / squares) if total > 0.0 else 0.0
        return float(np.sqrt(total + noise)), float(np.sqrt(worst + noise))


def decoded_corners(
    light_field: LightField, layout: Layout, truth: Layout, board: CalibrationBoard, rig_from_board: FloatArray
) -> DecodedCorners:
    """Find a board in all views of a decoded frame.

    Parameters
    ----------
    light_field
        The decoded frame.
    layout, truth
        The calibrated layout that it was decoded by, and the true one.
    board
        The board.
    rig_from_board
        Its true pose (4, 4), mm.
    """
    points = transform(rig_from_board, board.corners_in_board_mm)
    parameters = len(uncertainty_of(layout).parameters)
    none = np.zeros((3 + parameters, 3 + parameters))
    parts = [DecodedCorners(np.empty((0, 2)), np.empty((0, 2, 3)), np.empty((0, 2, 2)), none)]
    for view in range(light_field.rows * light_field.cols):
        t, s = divmod(view, light_field.cols)
        corners = detect_direct_view(as_grey(light_field.samples[t, s]), board)
        if not len(corners.corner):
            continue
        points_in_rig = points[corners.corner]
        centre = truth.mirrors[view].virtual_centre_in_rig_mm
        matrix = light_field.matrices[t, s]
        offset = (points_in_rig - centre) @ light_field.view_from_rig.T
        predicted = matrix[0, 0] * offset[:, :2] / offset[:, 2:] + matrix[:2, 2]
        d_rotation, d_parameter, d_frame = error_derivatives(
            layout, view, points_in_rig, centre, matrix[0, 0], light_field.view_from_rig
        )
        columns = np.concatenate([d_rotation, d_parameter], axis=2).reshape(-1, 3 + parameters)
        parts.append(DecodedCorners(corners.pixels - predicted, d_rotation, d_frame, columns.T @ columns))
    return DecodedCorners.join(parts)


def error_derivatives(
    layout: Layout, view: int, points_in_rig: FloatArray, centre: FloatArray, focal_px: float, view_from_rig: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Derivatives of the errors of points in a decoded view, px.

    Parameters
    ----------
    layout
        The calibrated layout that decodes.
    view
        The view's mirror.
    points_in_rig
        True points (n, 3), rig frame, mm.
    centre
        True virtual centre (3,) of the view, rig frame, mm.
    focal_px, view_from_rig
        Focal length and rotation (3, 3) of the decoded view.

    Returns
    -------
    d_rotation, d_parameter, d_frame
        (n, 2, 3), (n, 2, g) and (n, 2, 2), with respect to a rotation vector of the true rig, to the calibration's
        parameters and to pixels of the frame.
    """
    offset = points_in_rig - centre
    x, y, z = view_from_rig @ offset.T
    zero, one = np.zeros_like(z), np.ones_like(z)
    d_view = focal_px / z * np.array([[one, zero, -x / z], [zero, one, -y / z]])
    d_point = np.moveaxis(d_view, 2, 0) @ view_from_rig
    d_rotation = d_point @ np.cross(np.eye(3), offset[:, None, :])
    # A point is shown where the calibration, not the truth, images it on the sensor.
    projected = project_points(layout, view, points_in_rig)
    d_frame = d_point @ np.linalg.pinv(projected.d_point)
    d_parameter = -d_frame @ projected.d_parameter - d_point @ centre_derivatives(layout, view)
    return d_rotation, d_parameter, d_frame
