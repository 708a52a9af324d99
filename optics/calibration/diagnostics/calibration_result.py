"""The result of a calibration: the calibrated layout, its fit, and its uncertainty."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import PurePath
from typing import Self

import numpy as np
from scipy.spatial import ConvexHull

from mirrorcam.core.bounds import LENGTH_MM
from mirrorcam.core.images.jpeg import DamagedPicture
from mirrorcam.core.values import FloatArray, Metric
from mirrorcam.optics.calibration.detection.checkerboard import Grey
from mirrorcam.optics.calibration.diagnostics.diagnostics import Diagnostics
from mirrorcam.optics.calibration.diagnostics.mirror_uncertainty import mirror_covariance, normal_and_distance_sigmas
from mirrorcam.optics.calibration.diagnostics.model_comparison import predict_held_out
from mirrorcam.optics.calibration.solver.levenberg_marquardt import BoolArray, Solution
from mirrorcam.optics.calibration.solver.observations import DIRECT, IntArray, Observations
from mirrorcam.optics.calibration.solver.parameterisation import Model
from mirrorcam.optics.calibration.solver.residuals import Board, Estimate, points_at_camera
from mirrorcam.optics.geometry.lateral_colour import LateralColour
from mirrorcam.optics.geometry.layout import Layout, Uncertainty
from mirrorcam.optics.geometry.mirror import Mirror, intersect_plane

HOLD_OUT_EVERY = 5


@dataclass(frozen=True, eq=False)
class ViewPicture:
    """The part of a picture (h, w) that shows a view's board, and the pixel (2,) of its top left corner."""

    frame: int
    view: int
    grey: Grey
    left_top_px: IntArray


@dataclass(frozen=True)
class Calibration:
    """A calibrated layout with its fit and diagnostics.

    Attributes
    ----------
    layout
        The calibrated layout, with covariance; lengths in mm.
    rig_from_board
        Board poses (f, 4, 4), rigid, mm: frames with mirrors first, then frames of the bare camera.
    observations
        The corners (n rows) used for the fit.
    residuals_px
        Predicted minus observed pixels (n, 2).
    inliers
        Mask (n,) of the corners in the final least-squares fit.
    metrics
        Scalar results, as in `metrics.json`.
    notes
        Anything not found or not used, one sentence each.
    diagnostics
        Uncertainty of the result, and tests of its model.
    pictures
        Name of each frame's picture (f).
    worst_views
        Pictures of the views with the largest residuals, the worst first; empty if there are no pictures.
    residual_scale
        Standard deviation of residuals relative to the stated ones; None if it must be estimated from the residuals.
    """

    layout: Layout
    rig_from_board: FloatArray
    observations: Observations
    residuals_px: FloatArray
    inliers: BoolArray
    metrics: dict[str, Metric]
    notes: tuple[str, ...]
    diagnostics: Diagnostics | None = None
    pictures: tuple[str, ...] = ()
    worst_views: tuple[ViewPicture, ...] = ()
    residual_scale: float | None = None

    @property
    def picture_names(self) -> tuple[str, ...]:
        """The name (f) of each frame's picture, as short as it is unique: its path's last parts."""
        parts = [PurePath(name).parts for name in self.pictures]
        endings = Counter(name[-count:] for name in parts for count in range(1, len(name) + 1))
        shortest = (next((n[-c:] for c in range(1, len(n) + 1) if endings[n[-c:]] == 1), n) for n in parts)
        return tuple(PurePath(*name).as_posix() for name in shortest)

    @property
    def corner_sigma_px(self) -> FloatArray:
        """Standard deviation (n,) of each corner, per axis, scaled to the residuals of all corners."""
        if self.residual_scale is not None:
            return self.residual_scale * self.observations.sigma_px
        relative = self.observations.standardised(self.residuals_px)[self.inliers]
        return float(np.sqrt(np.mean(relative**2))) * self.observations.sigma_px

    @property
    def standardised(self) -> FloatArray:
        """Residuals (n, 2) in standard deviations of each corner."""
        return self.residuals_px / self.corner_sigma_px[:, None]

    @classmethod
    def of(
        cls,
        solution: Solution,
        observations: Observations,
        layout: Layout,
        *,
        metrics: dict[str, Metric],
        notes: tuple[str, ...],
        diagnostics: Diagnostics,
        pictures: tuple[str, ...],
    ) -> Self:
        """Build the calibration of a solution; `layout` gets its covariance and metrics."""
        return cls(
            layout=layout.replaced(metrics=metrics, uncertainty=uncertainty(solution)),
            rig_from_board=solution.estimate.rig_from_board,
            observations=observations,
            residuals_px=solution.residuals,
            inliers=solution.inliers,
            metrics=metrics,
            notes=notes,
            diagnostics=diagnostics,
            pictures=pictures,
            residual_scale=solution.scale,
        )

    def with_lateral_colour(self, colour: LateralColour | None) -> Self:
        """Set the lateral colour of the camera, and add its largest displacements to the metrics."""
        camera = self.layout.camera.replaced(lateral_colour=colour)
        metrics = dict(self.metrics)
        if colour is not None:
            right, bottom = camera.width_px - 1.0, camera.height_px - 1.0
            corners = np.array([[0.0, 0.0], [right, 0.0], [0.0, bottom], [right, bottom]])
            red, green, blue = camera.colour_pixels(corners)
            for name, pixels in (("red", red), ("blue", blue)):
                largest = float(np.linalg.norm(pixels - green, axis=1).max())
                metrics[f"lateral_{name}_px"] = Metric(value=largest, unit="px")
        return replace(self, layout=self.layout.replaced(camera=camera, metrics=metrics), metrics=metrics)

    def with_damaged_pictures(self, damaged: Sequence[DamagedPicture]) -> Self:
        """Add a note on each damaged picture that was skipped, and their number to the metrics."""
        if not damaged:
            return self
        count = {"damaged_pictures": Metric(value=len(damaged), unit="1")}
        return self.with_figures(count, [f"{error}; not used" for error in damaged])

    def with_figures(self, metrics: dict[str, Metric], notes: Sequence[str]) -> Self:
        """Add metrics, and notes before the others."""
        metrics = self.metrics | metrics
        return replace(self, layout=self.layout.replaced(metrics=metrics), metrics=metrics, notes=(*notes, *self.notes))


def uncertainty(solution: Solution) -> Uncertainty:
    """Return the covariance of camera and mirrors with parameter names, marginalised over the board's modes."""
    columns = [column for column, name in enumerate(solution.parameters) if not name.startswith("board ")]
    covariance = solution.covariance[np.ix_(columns, columns)]
    names = tuple(solution.parameters[column] for column in columns)
    return Uncertainty(parameters=names, covariance=(covariance + covariance.T) / 2.0)


def mirror_sigmas(layout: Layout) -> list[tuple[float, float]]:
    """Standard deviations of each mirror's normal along its worst direction (rad), and of its distance (mm)."""
    if layout.uncertainty is None:
        raise ValueError("the layout has no uncertainty, expected a calibrated layout")
    centres = np.array([mirror.virtual_centre_in_rig_mm for mirror in layout.mirrors])
    tilts, distances = normal_and_distance_sigmas(centres, mirror_covariance(layout.uncertainty))
    return list(zip(tilts.tolist(), distances.tolist(), strict=True))


def angle_between_mirrors(centre_a: FloatArray, centre_b: FloatArray, covariance: FloatArray) -> tuple[float, float]:
    """Angle between the mirrors of two virtual centres (3,), and its standard deviation.

    Parameters
    ----------
    centre_a, centre_b
        Virtual centres in the rig frame, mm.
    covariance
        Their joint covariance (6, 6), mm^2.

    Returns
    -------
    angle, sigma
        Radians.
    """
    a, b = centre_a / np.linalg.norm(centre_a), centre_b / np.linalg.norm(centre_b)
    cosine = float(np.clip(a @ b, -1.0, 1.0))
    sine = max(float(np.sqrt(1.0 - cosine**2)), 1e-12)
    gradient = np.concatenate(
        [-(b - cosine * a) / (sine * np.linalg.norm(centre_a)), -(a - cosine * b) / (sine * np.linalg.norm(centre_b))]
    )
    return float(np.arccos(cosine)), float(np.sqrt(gradient @ covariance @ gradient))


def fit_metrics(observations: Observations, solution: Solution) -> dict[str, Metric]:
    """Rms residuals per axis and per view, counts, and standard deviations of the mirrors' planes."""
    used = solution.residuals[solution.inliers]
    rms = solution.rms_px
    metrics = {
        "rms_x_px": Metric(value=rms[0], unit="px"),
        "rms_y_px": Metric(value=rms[1], unit="px"),
        "corners": Metric(value=len(used), unit="1"),
        "outliers": Metric(value=int((~solution.inliers).sum()), unit="1"),
        "sigma_px": Metric(value=solution.sigma_px, unit="px"),
        **({"residual_scale": Metric(value=solution.scale, unit="1")} if observations.has_sigmas else {}),
        "iterations": Metric(value=solution.iterations, unit="1"),
    }
    for view in np.unique(observations.view):
        rows = solution.inliers & (observations.view == view)
        if not rows.any():
            continue
        name = "direct" if view == DIRECT else f"mirror_{view}"
        per_axis = np.sqrt(np.mean(solution.residuals[rows] ** 2, axis=0))
        metrics[f"{name}_rms_x_px"] = Metric(value=per_axis[0], unit="px")
        metrics[f"{name}_rms_y_px"] = Metric(value=per_axis[1], unit="px")
    tilt, distance = normal_and_distance_sigmas(
        solution.estimate.virtual_centres_in_rig_mm, mirror_covariance(uncertainty(solution))
    )
    for m, (tilt_rad, distance_mm) in enumerate(zip(tilt, distance, strict=True)):
        metrics[f"mirror_{m}_normal_sigma_deg"] = Metric(value=np.degrees(tilt_rad), unit="deg")
        metrics[f"mirror_{m}_distance_sigma_mm"] = Metric(value=distance_mm, unit="mm")
    return metrics


def board_metrics(solution: Solution, board: Board) -> dict[str, Metric]:
    """Rms deviations of a deformed board's corners from the drawing, and the plates' thickness, if they are free."""
    metrics = {}
    if len(board.modes):
        shift_mm = board.shaped(solution.estimate.shape) - board.corners_in_board_mm
        in_plane = np.sqrt(np.mean(np.sum(shift_mm[:, :2] ** 2, axis=1)))
        metrics["board_shift_in_plane_rms_mm"] = Metric(value=in_plane, unit="mm")
        metrics["board_warp_rms_mm"] = Metric(value=np.sqrt(np.mean(shift_mm[:, 2] ** 2)), unit="mm")
    if "sheet_mm" in solution.parameters:
        index = solution.parameters.index("sheet_mm")
        metrics["sheet_mm"] = Metric(value=solution.estimate.thickness_mm.max(), unit="mm")
        metrics["sheet_sigma_mm"] = Metric(value=np.sqrt(solution.covariance[index, index]), unit="mm")
    return metrics


def spatial_rms_mm(estimate: Estimate, observations: Observations, inliers: BoolArray, board: Board) -> float:
    """Rms distance of each corner from the ray traced from its pixel, mm.

    This is the spatial reprojection error of the original paper. Mirrors preserve distances, so it is computed at the
    corner's image in front of the base camera.
    """
    rows = observations.where(inliers)
    _, _, images = points_at_camera(estimate, rows, board)
    rays = estimate.camera.unproject(rows.pixels)
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    return float(np.sqrt(np.mean(np.sum(np.cross(images, rays) ** 2, axis=1))))


def held_out_metrics(
    solution: Solution, observations: Observations, model: Model, *, mirrored_frames: int
) -> dict[str, Metric]:
    """Errors of every fifth mirrored frame, predicted by a fit without these frames; only their poses are fitted.

    Empty if there are too few frames to hold one out.
    """
    if mirrored_frames <= HOLD_OUT_EVERY:
        return {}
    held_out_frames = np.zeros(len(solution.estimate.rig_from_board), dtype=bool)
    held_out_frames[HOLD_OUT_EVERY - 1 : mirrored_frames : HOLD_OUT_EVERY] = True
    predicted = predict_held_out(solution.estimate, observations, model, held_out_frames)
    rms_sigmas = float(np.sqrt(np.mean(solution.standardised[solution.inliers] ** 2)))
    spatial = spatial_rms_mm(predicted.estimate, predicted.observations, predicted.inliers, predicted.board)
    return {
        "held_out_rms_x_px": Metric(value=predicted.rms_px[0], unit="px"),
        "held_out_rms_y_px": Metric(value=predicted.rms_px[1], unit="px"),
        "held_out_scale": Metric(value=predicted.rms_sigmas / rms_sigmas, unit="1"),
        "held_out_outliers": Metric(value=int((~predicted.inliers).sum()), unit="1"),
        "held_out_spatial_rms_mm": Metric(value=spatial, unit="mm"),
    }


def with_estimate(layout: Layout, estimate: Estimate) -> Layout:
    """Return a nominal layout with an estimate's camera, planes, plates and curvatures, and without metrics.

    A plate thickness at or below zero, which raises an alarm, is replaced by the smallest valid one.
    """
    thickness_mm = np.maximum(estimate.thickness_mm, LENGTH_MM.min)
    mirrors = tuple(
        tilted_to(mirror, centre).replaced(
            thickness_mm=thickness if mirror.is_second_surface else mirror.thickness_mm, curvature_per_m=curvature
        )
        for mirror, centre, thickness, curvature in zip(
            layout.mirrors,
            estimate.virtual_centres_in_rig_mm,
            thickness_mm.tolist(),
            estimate.curvature_per_m,
            strict=True,
        )
    )
    return layout.replaced(kind="calibrated", camera=estimate.camera, mirrors=mirrors, metrics={}, verdict={})


def layout_from_corners(estimate: Estimate, observations: Observations) -> Layout:
    """Return the layout of an estimate, with each mirror clipped to the convex hull of the corners observed in it.

    Nothing is known beyond them. The mirrors form one row, and the view axes are those of the rig.
    """
    mirrors = [
        _visible_mirror(estimate, mirror, observations.pixels[observations.view == mirror])
        for mirror in range(len(estimate.virtual_centres_in_rig_mm))
    ]
    return Layout(
        kind="calibrated",
        rows=1,
        cols=len(mirrors),
        camera=estimate.camera,
        mirrors=tuple(mirrors),
        view_from_rig=np.eye(3),
        provenance={"source": "pictures of a board seen directly and in the mirrors"},
    )


def _visible_mirror(estimate: Estimate, mirror: int, pixels: FloatArray) -> Mirror:
    """Return a mirror whose outline is the convex hull of pixels (n, 2)."""
    normalized = estimate.camera.normalized_from_pixels(pixels)
    hull = normalized[ConvexHull(normalized).vertices]
    centre, thickness_mm = estimate.virtual_centres_in_rig_mm[mirror], float(estimate.thickness_mm[mirror])
    flat = Mirror(
        virtual_centre_in_rig_mm=centre,
        outline_in_rig_mm=intersect_plane(hull, centre),
        curvature_per_m=estimate.curvature_per_m[mirror],
    )
    if thickness_mm <= 0.0:
        return flat
    index = float(estimate.refractive_index[mirror])
    return flat.replaced(surface="second", thickness_mm=thickness_mm, refractive_index=index)


def tilted_to(mirror: Mirror, virtual_centre: FloatArray) -> Mirror:
    """Move a mirror rigidly to a measured plane by the smallest motion: a tilt, then a shift along the normal."""
    normal = -virtual_centre / np.linalg.norm(virtual_centre)
    axis = np.cross(mirror.normal_in_rig, normal)
    cosine = float(mirror.normal_in_rig @ normal)
    # Rodrigues' formula with the sine included in the axis; the planes are never opposite.
    skew = np.array([[0.0, -axis[2], axis[1]], [axis[2], 0.0, -axis[0]], [-axis[1], axis[0], 0.0]])
    rotation = np.eye(3) + skew + skew @ skew / (1.0 + cosine)
    centroid = mirror.outline_in_rig_mm.mean(axis=0)
    distance = float(np.linalg.norm(virtual_centre)) / 2.0
    return mirror.moved(rotation, (-distance - normal @ centroid) * normal)
