"""Normalised estimation error squared (NEES): whether the errors of a calibration match its covariance.

After Bar-Shalom. The error is measured in pixels over the working volume. The motion of the rig is removed from the
error and from the predicted error, so the gauge of a calibration does not matter. So is a magnification where the true
lens has lateral colour: where a grey picture shows an edge then depends on how edges are located. If the covariance is
right, the NEES is chi-squared distributed, with the rank of the covariance as degrees of freedom.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from mirrorcam.bench.scores.gauge import Gauge
from mirrorcam.bench.scores.matched_views import MatchedView
from mirrorcam.core.disk.files import LARGEST_LAYOUT_BYTES, read_model
from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.diagnostics.calibration_difference import remove_motion
from mirrorcam.optics.calibration.diagnostics.projection_uncertainty import NEGLIGIBLE_PX, project_points
from mirrorcam.optics.camera_files.camera_rig import CameraRig, ParametricProjection
from mirrorcam.optics.geometry.layout import Layout, Uncertainty
from mirrorcam.optics.geometry.transforms import rigid, transform

SCHEMA = "mirrorcam.covariance/1"
SHARED = "all"
POSE_NAMES = ("rx_rad", "ry_rad", "rz_rad", "tx_mm", "ty_mm", "tz_mm")
RELATIVE_STEP, MIN_STEP, POSE_STEP_MM = 1e-6, 1e-7, 1e-4
ASYMMETRY = 1e-6


class CovarianceFile(Uncertainty):
    """Content of a covariance file."""

    schema_id: Literal["mirrorcam.covariance/1"] = Field(alias="schema")


def with_covariance(rig: CameraRig, path: Path) -> CameraRig:
    """Return a calibration with the covariance in a file; raises InputError for unknown names."""
    if rig.layout is not None:
        raise InputError(f"{path}: a layout.json contains its covariance, expected no separate file for it")
    covariance_file = read_model(CovarianceFile, path, LARGEST_LAYOUT_BYTES)
    known = {name for camera in rig.cameras for name in (*lens_names(camera.lens), *POSE_NAMES)}
    cameras = {camera.name for camera in rig.cameras} | {SHARED}
    for name in covariance_file.parameters:
        camera, _, parameter = name.rpartition(" ")
        if camera not in cameras or parameter not in known:
            raise InputError(f"{path}: parameter {name[:60]!r}, expected CAMERA NAME, such as '{SHARED} fx_px'")
    if len(set(covariance_file.parameters)) < len(covariance_file.parameters):
        raise InputError(f"{path}: a parameter appears twice")
    return replace(
        rig, uncertainty=Uncertainty(parameters=covariance_file.parameters, covariance=covariance_file.covariance)
    )


def covariance_root(uncertainty: Uncertainty) -> FloatArray:
    """Return a square root R (g, g) of the covariance R R^T; raises InputError if it is not positive semidefinite."""
    covariance = uncertainty.covariance
    sigma = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    if (np.diag(covariance) < 0.0).any() or np.abs(covariance - covariance.T).max(initial=0.0) > ASYMMETRY * max(
        float(sigma.max(initial=0.0)) ** 2, 1e-300
    ):
        raise InputError("the covariance is not symmetric, or has negative variances")
    scales = np.where(sigma > 0.0, sigma, 1.0)
    values, vectors = np.linalg.eigh(covariance / np.outer(scales, scales))
    if values.min(initial=0.0) < -1e-6 * max(values.max(initial=0.0), 1e-300):
        raise InputError("the covariance has negative eigenvalues, expected none")
    return np.asarray(scales[:, None] * vectors * np.sqrt(np.maximum(values, 0.0)))


def lens_names(lens: object) -> tuple[str, ...]:
    """Return the names of a lens's parameters."""
    return lens.intrinsic_names if isinstance(lens, ParametricProjection) else ()


def d_parameters(
    rig: CameraRig, views: tuple[MatchedView, ...], view: NDArray[np.int64], points_in_rig: FloatArray
) -> FloatArray:
    """Return derivatives (n, 2, g), with respect to parameters, of the pixels of points (n, 3), each in its view."""
    assert rig.uncertainty is not None
    if rig.layout is not None:
        return _d_layout_parameters(rig.layout, view, points_in_rig)
    names = rig.uncertainty.parameters
    derivatives = np.zeros((len(view), 2, len(names)))
    for matched in views:
        mask = view == matched.view
        for column, name in enumerate(names):
            camera, _, parameter = name.rpartition(" ")
            if camera in (SHARED, matched.camera.name):
                derivatives[mask, :, column] = _d_parameter(matched, parameter, points_in_rig[mask])
    return derivatives


def _d_layout_parameters(layout: Layout, view: NDArray[np.int64], points_in_rig: FloatArray) -> FloatArray:
    try:
        return project_points(layout, view, points_in_rig).d_parameter
    except KeyError as error:
        raise InputError(
            f"the layout's covariance has the parameter {str(error)[:60]}, which is not of its camera or mirrors"
        ) from None


def _d_parameter(view: MatchedView, parameter: str, points_in_rig: FloatArray) -> FloatArray:
    """Return central differences (n, 2) of pixels with respect to one parameter of one camera."""
    lens = view.camera.lens
    if parameter in POSE_NAMES:
        step = MIN_STEP if parameter.endswith("rad") else POSE_STEP_MM
        above, below = (_with_pose_change(view, parameter, sign * step) for sign in (1.0, -1.0))
    elif isinstance(lens, ParametricProjection) and parameter in lens.intrinsic_names:
        index = lens.intrinsic_names.index(parameter)
        step = max(RELATIVE_STEP * abs(float(lens.intrinsics[index])), MIN_STEP)
        above, below = (_with_lens(view, lens, sign * step * np.eye(len(lens.intrinsics))[index]) for sign in (1, -1))
    else:
        return np.zeros((len(points_in_rig), 2))
    return (above.project_in_rig(points_in_rig) - below.project_in_rig(points_in_rig)) / (2.0 * step)


def _with_pose_change(view: MatchedView, parameter: str, change: float) -> MatchedView:
    pose = np.eye(4) if view.camera_from_rig is None else view.camera_from_rig
    rotation, shift = np.split(change * np.eye(6)[POSE_NAMES.index(parameter)], 2)
    return replace(view, camera_from_rig=rigid(Rotation.from_rotvec(rotation).as_matrix(), shift) @ pose)


def _with_lens(view: MatchedView, lens: ParametricProjection, change: FloatArray) -> MatchedView:
    return replace(view, camera=replace(view.camera, lens=lens.with_intrinsics(lens.intrinsics + change)))


LEVEL = 0.95
MIN_SIGMA_PX = 0.1 * NEGLIGIBLE_PX
"""Directions with a smaller RMS sigma are left out: there rounding and a lens model's resolution matter, not noise."""


@dataclass(frozen=True)
class Nees:
    """The error in units of the covariance: a sum of squares and its degrees of freedom."""

    total: float
    freedom: int

    @property
    def mean(self) -> float:
        """NEES per degree of freedom: 1 if the covariance is right, larger if it is too small."""
        return self.total / self.freedom

    @property
    def interval(self) -> tuple[float, float]:
        """95 % interval of `mean` if the covariance is right."""
        low, high = chi2.ppf([(1.0 - LEVEL) / 2.0, (1.0 + LEVEL) / 2.0], self.freedom) / self.freedom
        return float(low), float(high)


def nees(gauges: Sequence[Gauge], rig: CameraRig, free_magnification_about: FloatArray | None = None) -> Nees | None:
    """Return the NEES of a calibration; None without a covariance, or if it predicts no error.

    `free_magnification_about` is the pixel (2,) about which the true camera has an unknown magnification, if any.
    """
    if rig.uncertainty is None:
        return None
    root = covariance_root(rig.uncertainty)
    predicted, errors = [], []
    for gauge in gauges:
        points = transform(gauge.rig_from_true, gauge.points.points_in_rig)
        derivatives = d_parameters(rig, gauge.views, gauge.points.view, points)
        error = gauge.pixels - gauge.points.pixels
        valid = np.isfinite(error).all(axis=1) & np.isfinite(derivatives).all(axis=(1, 2))
        columns = gauge.motion_columns[valid]
        if free_magnification_about is not None:
            columns = np.dstack([columns, gauge.points.pixels[valid] - free_magnification_about])
        both = remove_motion(np.dstack([derivatives[valid] @ root, error[valid]]), columns, gauge.weights[valid])
        predicted.append(both[:, :, :-1].reshape(-1, root.shape[1]))
        errors.append(both[:, :, -1].ravel())
    return _nees_of(np.concatenate(predicted), np.concatenate(errors))


def _nees_of(predicted: FloatArray, error: FloatArray) -> Nees | None:
    """Return the NEES of errors (2n,) with the covariance P P^T, P (2n, g), in the range of P."""
    directions, sigmas, _ = np.linalg.svd(predicted, full_matrices=False)
    used = sigmas > MIN_SIGMA_PX * np.sqrt(len(error) / 2.0)
    if not used.any():
        return None
    normalised = (directions[:, used].T @ error) / sigmas[used]
    return Nees(float(normalised @ normalised), int(used.sum()))


def pooled(results: Sequence[Nees]) -> Nees | None:
    """Return the pooled NEES of several calibrations."""
    if not results:
        return None
    return Nees(sum(result.total for result in results), sum(result.freedom for result in results))
