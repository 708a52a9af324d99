"""The score of one calibration of one set: its errors against the true device."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.spatial.transform import Rotation

from mirrorcam.bench.scores.consistency import Nees, nees
from mirrorcam.bench.scores.gauge import Gauge, centre, gauges, project_with_gradient, score_points, visible_in_all
from mirrorcam.bench.scores.matched_views import MatchedView, ViewsFile, matched_views
from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray, Metric
from mirrorcam.optics.camera_files.camera_rig import CameraRig, PictureFlip
from mirrorcam.optics.camera_files.write.virtual_cameras import view_name
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.transforms import transform

MAX_STEPS, CONVERGED_MM = 50, 1e-10
MAX_POINTS = 400


@dataclass(frozen=True, eq=False)
class Triangulation:
    """Points visible in all views: true and triangulated (n, 3), in the true rig frame, mm."""

    true: FloatArray
    triangulated: FloatArray

    @property
    def error_mm(self) -> FloatArray:
        """Triangulated minus true points (n, 3)."""
        return self.triangulated - self.true

    @property
    def scale_error(self) -> float:
        """Relative scale error of the triangulated points, from the best similarity."""
        true, triangulated = (points - points.mean(axis=0) for points in (self.true, self.triangulated))
        singular_values = np.linalg.svd(triangulated.T @ true)[1]
        return float(singular_values.sum() / np.sum(true**2) - 1.0)


def triangulate(gauge: Gauge, truth: Layout) -> Triangulation | None:
    """Triangulate, by the calibration, points of the working volume that are visible in all views.

    A triangulated point minimises the sum of squared pixel errors, as in bundle adjustment. Returns None for a single
    view, or fewer than four common points.
    """
    indices = [view.view for view in gauge.views]
    if len(indices) < 2:
        return None
    candidates = gauge.points.points_in_rig
    true = candidates[visible_in_all(truth, indices, candidates)]
    true = true[:: max(1, -(-len(true) // MAX_POINTS))]
    if len(true) < 4:
        return None
    observed_px = [truth.project(true, index) for index in indices]
    points = transform(gauge.rig_from_true, true)
    for _ in range(MAX_STEPS):
        normal, right = np.zeros((len(points), 3, 3)), np.zeros((len(points), 3))
        for view, pixels in zip(gauge.views, observed_px, strict=True):
            projected_px, d_point = project_with_gradient(view.project_in_rig, points)
            residual = pixels - projected_px
            invalid = ~(np.isfinite(residual).all(axis=1) & np.isfinite(d_point).all(axis=(1, 2)))
            residual[invalid], d_point[invalid] = 0.0, 0.0
            normal += np.einsum("nij,nik->njk", d_point, d_point)
            right += np.einsum("nij,ni->nj", d_point, residual)
        step = np.einsum("nij,nj->ni", np.linalg.pinv(normal), right)
        points = points + step
        if np.abs(step).max() < CONVERGED_MM:
            break
    return Triangulation(true, transform(gauge.true_from_rig, points))


NO_POSES = "the calibration has no poses"
ONE_VIEW = "the calibration has one view"
NO_COVARIANCE = "the calibration has no covariance"
NO_SCALE = "its poses have no scale"
NOT_VISIBLE = "no point is visible in all views"
NOT_AT_DISTANCE = "the calibration shows nothing at the working distance"
P95 = 95.0


@dataclass(frozen=True)
class CalibrationScore:
    """The score of one calibration of one set.

    Attributes
    ----------
    figures
        Figures over all views, and of each view as `view_ROW_COLUMN_…`.
    not_given
        Reasons for figures that cannot be measured, by name.
    views
        Name of the camera of each scored view, by the view's name.
    missing
        Names of the views without a camera in the calibration.
    alignment
        `rigid`, `similarity`, or `each view alone`.
    mirrored
        Whether the calibration describes a mirrored world, which was reflected before the alignment.
    nees
        Normalised estimation error squared; None without a covariance.
    distance_mm
        The working distance.
    notes
        Assumptions about the calibration.
    aligned
        The aligned views, with the points that were compared.
    """

    figures: dict[str, Metric]
    not_given: dict[str, str]
    views: dict[str, str]
    missing: tuple[str, ...]
    alignment: str
    mirrored: bool
    nees: Nees | None
    distance_mm: float
    notes: tuple[str, ...]
    aligned: tuple[Gauge, ...]


def score_calibration(
    rig: CameraRig,
    truth: Layout,
    nominal: Layout,
    distance_mm: float,
    *,
    views: ViewsFile | None = None,
    pictures: PictureFlip | None = None,
    lateral_colour: bool = False,
) -> CalibrationScore:
    """Compare a calibration with the true device.

    Parameters
    ----------
    rig
        The calibration.
    truth
        The layout as built.
    nominal
        The layout given to the calibrator; it determines how pictures are flipped and cropped.
    distance_mm
        Working distance from the virtual centre of each view.
    views, pictures
        Mirror of each camera, and flip of the pictures, if names and sizes do not determine them.
    lateral_colour
        Whether the true lens has lateral colour, so that grey pictures have no definite magnification.

    Raises
    ------
    InputError
        If cameras and mirrors do not match.
    """
    sizes = [f"{layout.camera.width_px}x{layout.camera.height_px} px" for layout in (truth, nominal)]
    if sizes[0] != sizes[1] or len(truth.mirrors) != len(nominal.mirrors):
        raise InputError("the true layout and the nominal one are of different devices")
    if rig.layout is not None and (rig.layout.rows, rig.layout.cols) != (truth.rows, truth.cols):
        raise InputError(
            f"the calibration has {rig.layout.arrangement.text} mirrors, expected {truth.arrangement.text} like the set"
        )
    matched = matched_views(rig, truth, nominal, views, pictures)
    indices = [view.view for view in matched]
    points = score_points(truth, indices, distance_mm)
    aligned = gauges(matched, points, scaled=rig.unit_mm is None)
    joint = aligned[0] if rig.posed and len(matched) > 1 else None
    figures, not_given = _pixel_figures(aligned)
    for more, reasons in (_geometry(joint), _triangulation(joint, truth, scaled=rig.unit_mm is None)):
        figures |= more
        not_given |= reasons
    if joint is None:
        not_given |= dict.fromkeys((*GEOMETRY, *TRIANGULATION), ONE_VIEW if rig.posed else NO_POSES)
    consistency = nees(aligned, rig, np.array([truth.camera.cx_px, truth.camera.cy_px]) if lateral_colour else None)
    if consistency is None:
        not_given["nees"] = NO_COVARIANCE if rig.uncertainty is None else "its covariance predicts no error"
    else:
        low, high = consistency.interval
        figures |= {"nees": Metric(value=consistency.mean, unit="1"), "nees_low": Metric(value=low, unit="1")}
        figures |= {
            "nees_high": Metric(value=high, unit="1"),
            "nees_freedom": Metric(value=consistency.freedom, unit="1"),
        }
    names = [view_name(*divmod(index, truth.cols)) for index in range(len(truth.mirrors))]
    alignment = "rigid" if rig.unit_mm is not None else "similarity"
    return CalibrationScore(
        figures=figures | _view_figures(aligned),
        not_given=not_given,
        views={view.name: view.camera.name for view in matched},
        missing=tuple(name for index, name in enumerate(names) if index not in indices),
        alignment=alignment if rig.posed else "each view alone",
        mirrored=aligned[0].mirrored,
        nees=consistency,
        distance_mm=distance_mm,
        notes=rig.notes,
        aligned=tuple(aligned),
    )


@dataclass(frozen=True, eq=False)
class _Errors:
    """Errors of pixels (n, 2), calibration minus truth; lengths (m,) of those at the working distance, mm."""

    pixels: FloatArray
    mm: FloatArray
    visible_fraction: float

    @classmethod
    def of(cls, aligned: Sequence[Gauge], view: int | None = None) -> _Errors:
        """Return the errors of all views, or of one."""
        errors, mm, visible = [], [], []
        for gauge in aligned:
            points = gauge.points
            error = gauge.pixels - points.pixels
            finite = np.asarray(np.isfinite(error).all(axis=1))
            used = np.ones(len(error), dtype=bool) if view is None else points.view == view
            mm_per_px: FloatArray = np.linalg.pinv(points.d_point).astype(np.float64)
            shifts = np.linalg.norm(np.einsum("nij,nj->ni", mm_per_px, np.where(finite[:, None], error, 0.0)), axis=1)
            errors.append(error[used & finite])
            mm.append(shifts[used & finite & points.at_distance])
            visible.append(finite[used])
        return cls(np.concatenate(errors), np.concatenate(mm), float(np.concatenate(visible).mean()))

    def figures(self, prefix: str = "") -> dict[str, Metric]:
        """Return RMS, median, 95th percentile, maximum and bias, px; RMS, mm; and the fraction of visible points."""
        length = np.linalg.norm(self.pixels, axis=1)
        bias = self.pixels.mean(axis=0)
        values = {
            "rms_px": (_rms(length), "px"),
            "median_px": (float(np.median(length)), "px"),
            "p95_px": (float(np.percentile(length, P95)), "px"),
            "max_px": (float(length.max()), "px"),
            "bias_x_px": (float(bias[0]), "px"),
            "bias_y_px": (float(bias[1]), "px"),
            "shown_share": (self.visible_fraction, "1"),
        }
        if len(self.mm):
            values["rms_mm"] = (_rms(self.mm), "mm")
        return {f"{prefix}{name}": Metric(value=value, unit=unit) for name, (value, unit) in values.items()}


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _pixel_figures(aligned: Sequence[Gauge]) -> tuple[dict[str, Metric], dict[str, str]]:
    focal = [error for gauge in aligned for error in _focal_errors(gauge).values()]
    figures = _Errors.of(aligned).figures()
    figures["worst_view_rms_px"] = max(
        (_Errors.of([gauge], view.view).figures()["rms_px"] for gauge in aligned for view in gauge.views),
        key=lambda metric: metric.value,
    )
    figures["focal_error_percent"] = Metric(value=float(np.mean(focal)), unit="percent")
    figures["focal_error_rms_percent"] = Metric(value=_rms(np.array(focal)), unit="percent")
    return figures, {} if "rms_mm" in figures else {"rms_mm": NOT_AT_DISTANCE}


def _view_figures(aligned: Sequence[Gauge]) -> dict[str, Metric]:
    figures: dict[str, Metric] = {}
    for gauge in aligned:
        focal = _focal_errors(gauge)
        for view in gauge.views:
            figures |= _Errors.of([gauge], view.view).figures(f"{view.name}_")
            figures[f"{view.name}_focal_error_percent"] = Metric(value=focal[view.view], unit="percent")
    return figures


def _focal_errors(gauge: Gauge) -> dict[int, float]:
    """Return the relative error, %, of each view's picture scale: px per radian at the centre of the sub-image.

    For a pinhole, the scale is proportional to the focal length; it can be compared for any lens model.
    """
    errors = {}
    for view in gauge.views:
        indices = np.flatnonzero((gauge.points.view == view.view) & gauge.points.at_distance)
        pixels = gauge.points.pixels[indices]
        central = indices[np.linalg.norm(pixels - pixels.mean(axis=0), axis=1).argmin()]
        point = gauge.points.points_in_rig[[central]]
        true_centre = view.mirror.apparent.virtual_centre_in_rig_mm
        own_pose = np.eye(4) if view.camera_from_rig is None else view.camera_from_rig
        own_centre = transform(gauge.true_from_rig, centre(own_pose))
        _, d_point = project_with_gradient(partial(view.truth.project, mirror=view.view), point)
        scales = [
            _picture_scale(gradient, point[0] - origin)
            for gradient, origin in ((d_point[0], true_centre), (gauge.d_point[central], own_centre))
        ]
        errors[view.view] = 100.0 * (scales[1] / scales[0] - 1.0)
    return errors


def _picture_scale(d_point: FloatArray, ray: FloatArray) -> float:
    """Return px per radian, the geometric mean over directions, from the gradient (2, 3) at the end of a ray (3,)."""
    perpendicular = np.linalg.svd(ray[None])[2][1:]
    return float(np.sqrt(abs(np.linalg.det(d_point @ perpendicular.T))) * np.linalg.norm(ray))


GEOMETRY = (
    *("baseline_error_rms_mm", "baseline_error_max_mm", "baseline_error_percent"),
    *("angle_error_rms_deg", "angle_error_max_deg"),
)
TRIANGULATION = ("triangulation_rms_mm", "triangulation_median_mm", "triangulation_max_mm", "scale_error_percent")


def _geometry(gauge: Gauge | None) -> tuple[dict[str, Metric], dict[str, str]]:
    """Return the errors of distances and angles between views, over all pairs."""
    if gauge is None:
        return {}, dict.fromkeys(GEOMETRY, NO_POSES)
    poses = np.array([_pose(view) for view in gauge.views])
    true_poses = np.array([view.true_camera_from_rig for view in gauge.views])
    first, second = np.triu_indices(len(poses), 1)
    lengths, true_lengths = (
        np.linalg.norm(centres[first] - centres[second], axis=1)
        for centres in (np.array([centre(pose) for pose in group]) for group in (poses, true_poses))
    )
    if gauge.scaled:
        lengths = lengths / gauge.scale
    rotations, true_rotations = (
        group[first, :3, :3] @ group[second, :3, :3].transpose(0, 2, 1) for group in (poses, true_poses)
    )
    angles = np.degrees(Rotation.from_matrix(rotations @ true_rotations.transpose(0, 2, 1)).magnitude())
    error = lengths - true_lengths
    figures = {
        "baseline_error_rms_mm": (_rms(error), "mm"),
        "baseline_error_max_mm": (float(np.abs(error).max()), "mm"),
        "baseline_error_percent": (100.0 * float(lengths.sum() / true_lengths.sum() - 1.0), "percent"),
        "angle_error_rms_deg": (_rms(angles), "deg"),
        "angle_error_max_deg": (float(angles.max()), "deg"),
    }
    not_given = {}
    if gauge.scaled:
        del figures["baseline_error_percent"]
        not_given["baseline_error_percent"] = NO_SCALE
    return {name: Metric(value=value, unit=unit) for name, (value, unit) in figures.items()}, not_given


def _pose(view: MatchedView) -> FloatArray:
    assert view.camera_from_rig is not None
    return view.camera_from_rig


def _triangulation(gauge: Gauge | None, truth: Layout, *, scaled: bool) -> tuple[dict[str, Metric], dict[str, str]]:
    """Return the errors of triangulated points, and of their scale."""
    points = None if gauge is None else triangulate(gauge, truth)
    if points is None:
        return {}, dict.fromkeys(TRIANGULATION, NO_POSES if gauge is None else NOT_VISIBLE)
    lengths = np.linalg.norm(points.error_mm, axis=1)
    figures = {
        "triangulation_rms_mm": Metric(value=_rms(lengths), unit="mm"),
        "triangulation_median_mm": Metric(value=float(np.median(lengths)), unit="mm"),
        "triangulation_max_mm": Metric(value=float(lengths.max()), unit="mm"),
    }
    if scaled:
        return figures, {"scale_error_percent": NO_SCALE}
    figures["scale_error_percent"] = Metric(value=100.0 * points.scale_error, unit="percent")
    return figures, {}
